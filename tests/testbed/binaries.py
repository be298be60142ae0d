"""The programs of the test bed: built once from their sources, and found afterwards."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from tests.testbed import packages, versions
from tests.testbed.builder import Workshop, fetch_hadoop
from tests.testbed.errors import Missing
from tests.testbed.recipes import ON_REQUEST, RECIPES, Recipe, recipe_of

OWN = {program for recipe in RECIPES.values() for program in recipe.commands}
HADOOP = "hadoop"
EVERYTHING = (*(name for name in RECIPES if name not in ON_REQUEST), HADOOP)


def cache() -> Path:
    """Where everything is kept that takes long to make."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fleet-computer" / "testbed"


def tool(name: str) -> Path:
    """The program of this name, built if it is not there yet.

    It is looked for in the folder FLEET_TESTBED_BIN if that is set, else in the cache.

    Raises:
        Missing: it is not in FLEET_TESTBED_BIN, or there is no Go to build it with.
        CommandFailed: the build failed.
    """
    given = os.environ.get("FLEET_TESTBED_BIN") or None
    if given:
        path = Path(given).resolve() / name
        if not path.is_file():
            raise Missing(f"{name} is not in {given}, which FLEET_TESTBED_BIN names")
        return path
    recipe = recipe_of(name)
    if not _folder(recipe).is_dir():
        build([recipe.name])
    return _folder(recipe) / name


def is_there(name: str) -> bool:
    """Whether a program, or "hadoop", is there without being made first."""
    given = os.environ.get("FLEET_TESTBED_BIN") or None
    if name == HADOOP:
        return _hadoop_folder().is_dir() or (given is not None and _beside(given).is_dir())
    return given is not None or _folder(recipe_of(name)).is_dir()


def hadoop_jars() -> Path:
    """The folder of Hadoop's jars, fetched if it is not there yet; beside FLEET_TESTBED_BIN if that is set.

    Raises:
        Missing: there is no Maven to fetch it with.
        CommandFailed: Maven failed.
    """
    given = os.environ.get("FLEET_TESTBED_BIN") or None
    if given and _beside(given).is_dir():
        return _beside(given)
    if not _hadoop_folder().is_dir():
        build([HADOOP])
    return _hadoop_folder()


def build(names: Iterable[str]) -> None:
    """Make what is not there yet; another process that makes it too is waited for.

    Args:
        names: Of recipes, and "hadoop".
    """
    root = cache()
    (root / "programs").mkdir(parents=True, exist_ok=True)
    with (root / "build.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        wanted = list(names)
        missing = [RECIPES[name] for name in wanted if name != HADOOP and not _folder(RECIPES[name]).is_dir()]
        if HADOOP in wanted and not _hadoop_folder().is_dir():
            packages.ensure(packages.MAVEN | packages.HADOOP)
            fetch_hadoop(_hadoop_folder())
        if missing:
            _build(missing, root)
        _forget_old(root / "programs")


def _build(recipes: Iterable[Recipe], root: Path) -> None:
    workshop = Workshop(root / "workshop", root / "toolchain")
    try:
        for recipe in recipes:
            workshop.build(recipe, _folder(recipe))
    finally:
        workshop.close()


def _forget_old(programs: Path) -> None:
    """Remove what was built for other versions."""
    current = {_folder(recipe).name for recipe in RECIPES.values()} | {_hadoop_folder().name}
    for folder in programs.iterdir():
        if folder.name not in current:
            shutil.rmtree(folder)


def _beside(programs: str) -> Path:
    return Path(programs).resolve().parent / "hdfs-lib"


def _folder(recipe: Recipe) -> Path:
    return cache() / "programs" / recipe.key


def _hadoop_folder() -> Path:
    return cache() / "programs" / f"hadoop-{versions.HADOOP}"
