"""A new application in a folder: FleetSpec, functions, test, README and two small contexts."""

from __future__ import annotations

import keyword
import re
import shutil
import sys
import sysconfig
from importlib import resources
from importlib.machinery import PathFinder
from pathlib import Path
from string import Template

from fleet.cli.scaffold.field import made_up_field
from fleet.contexts.files import write_cube
from fleet.errors import Problem, SpecError
from fleet.spec.base import NAME_PATTERN
from fleet.storage.local import LocalStorage

FIELDS = {"practice": 1, "field": 2}
"""Seeds of the contexts."""
_LONGEST = 40
_OWN = ("fleet", "fleet_operator")
_SHADOWS = {"fleet", "fleet_operator"}
"""Folders that Python takes for these packages when it is started beside them."""


def make_application(folder: Path) -> tuple[Path, ...]:
    """Make a folder with a new application named after it.

    The folder appears complete or not at all.

    Returns:
        The files, relative to the folder.
    Raises:
        SpecError: the name is not one that a FleetSpec may have, or something is in the folder already.
        OSError: the folder cannot be made.
    """
    folder = folder.absolute()
    _check(folder)
    name, module = folder.name, module_of(folder.name)
    files = {
        "fleetspec.yaml": "fleetspec.yaml",
        f"{module}.py": "module.py",
        f"test_{module}.py": "test.py",
        "README.md": "readme.md",
    }
    draft = folder.with_name(f".{name}.new")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    try:
        for file, template in files.items():
            text = resources.files(__package__).joinpath(f"{template}.tmpl").read_text("utf-8")
            (draft / file).write_text(Template(text).substitute(name=name, module=module), "utf-8")
        for field, seed in FIELDS.items():
            write_cube(made_up_field(field, seed), LocalStorage(draft / "contexts" / field))
        draft.replace(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return tuple(sorted(file.relative_to(folder) for file in folder.rglob("*") if file.is_file()))


def module_of(name: str) -> str:
    """A name for the Python module of an application that neither Python nor an installed package uses."""
    module = name.replace("-", "_")
    taken = keyword.iskeyword(module) or module in sys.stdlib_module_names or module in _OWN or _is_installed(module)
    return f"swarm_{module}" if taken or module[0].isdigit() else module


def _is_installed(module: str) -> bool:
    """Whether a package has the name, wherever `fleet init` is called."""
    places = [sysconfig.get_path(kind) for kind in ("purelib", "platlib")]
    return PathFinder.find_spec(module, places) is not None


def _check(folder: Path) -> None:
    problems = []
    if re.fullmatch(NAME_PATTERN, folder.name) is None or len(folder.name) > _LONGEST:
        hint = f"use at most {_LONGEST} small letters, digits and `-`, such as my-swarm"
        problems.append(Problem("NAME", f"{folder.name!r} is not a name for a fleet", hint))
    if folder.name in _SHADOWS:
        hint = "choose another name, such as my-swarm"
        problems.append(Problem("NAME", f"a folder called {folder.name} hides the package of that name", hint))
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        problems.append(Problem("NAME", f"{folder} is there already", "nothing was changed; choose another name"))
    if problems:
        raise SpecError(problems, source="the command line")
