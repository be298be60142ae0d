"""What images are made from: versions as tested, nothing missing, and a digest that depends on content alone."""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import grimp
import pytest

from tests.testbed.imaging.inputs import INPUTS, ROOT, digest, stage

PYTHON_IMAGES = ("runtime", "function", "operator")
LEARNERS_OF_CHOICE = {"torch", "stable_baselines3", "gymnasium", "pettingzoo"}
"""Not in the image: who wants deep models builds an image with them."""


def _name(requirement: str) -> str:
    return re.split(r"[<>=!~\[ ]", requirement, maxsplit=1)[0].lower().replace("_", "-")


def _pinned(path: Path) -> dict[str, str]:
    lines = path.read_text("utf-8").splitlines()
    pins = [line.rstrip(" \\").split("==") for line in lines if "==" in line]
    return {_name(name): version for name, version in pins}


def _wanted(image: str) -> set[str]:
    return {_name(line) for line in (ROOT / f"containers/{image}/requirements.in").read_text("utf-8").splitlines()}


@pytest.mark.parametrize("image", PYTHON_IMAGES)
def test_an_image_has_the_versions_that_the_tests_passed_with(image: str) -> None:
    tested = _pinned(ROOT / "constraints.txt")
    pins = _pinned(ROOT / f"containers/{image}/requirements.txt")
    assert pins == {name: tested.get(name) for name in pins}, "run: python containers/lock.py"
    assert _wanted(image) <= set(pins), "run: python containers/lock.py"


@pytest.mark.parametrize("image", PYTHON_IMAGES)
def test_each_package_of_an_image_comes_with_its_hash(image: str) -> None:
    text = (ROOT / f"containers/{image}/requirements.txt").read_text("utf-8").replace("\\\n", "")
    assert [line for line in text.splitlines() if "==" in line and "--hash=sha256:" not in line] == []


def test_images_have_no_package_that_the_project_does_not_name() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    named = {_name(line) for line in project["dependencies"] + project["optional-dependencies"]["operator"]}
    assert {image: _wanted(image) - named for image in PYTHON_IMAGES} == {image: set() for image in PYTHON_IMAGES}


def test_the_runtime_image_has_all_that_roles_and_functions_import() -> None:
    graph = grimp.build_graph("fleet", include_external_packages=True, cache_dir=None)
    modules = {"fleet.runtime.__main__", "fleet.cli.serving", "fleet.functions.vision"}
    modules |= set().union(*(graph.find_upstream_modules(module) for module in modules))
    imported = {module for module in modules if not module.startswith("fleet")} - LEARNERS_OF_CHOICE
    distributions = packages_distributions()
    needed = {_name(distributions[module][0]) for module in imported if module in distributions}
    assert needed <= set(_pinned(ROOT / "containers/runtime/requirements.txt")), "add it to requirements.in"


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A copy of what the hdfs image is made from."""
    copy = tmp_path / "repository"
    shutil.copytree(ROOT / "containers/hdfs", copy / "containers/hdfs")
    return copy


def test_the_digest_is_that_of_content_and_not_of_times_or_umask(repository: Path) -> None:
    before = digest("hdfs", "parent", repository)
    for path in repository.rglob("*"):
        os.utime(path, (1.0, 1.0))
        path.chmod(path.stat().st_mode & 0o700)
    assert digest("hdfs", "parent", repository) == before


@pytest.mark.parametrize("change", ["text", "mode", "name", "parent"])
def test_the_digest_changes_with_whatever_changes_the_image(repository: Path, change: str) -> None:
    before = digest("hdfs", "parent", repository)
    script = repository / "containers/hdfs/hdfs-node"
    if change == "text":
        script.write_text(script.read_text("utf-8") + "\n", encoding="utf-8")
    elif change == "mode":
        script.chmod(0o644)
    elif change == "name":
        script.rename(script.with_name("node"))
    assert digest("hdfs", "other" if change == "parent" else "parent", repository) != before


def test_images_are_built_from_a_copy_without_leftovers_of_python(tmp_path: Path) -> None:
    stage("runtime", tmp_path / "context")
    found = {path.name for path in (tmp_path / "context").rglob("*")}
    assert not found & {"__pycache__", "fleet_computer.egg-info"}
    assert {"Containerfile", "pyproject.toml"} <= found
    assert all((ROOT / path).exists() for paths in INPUTS.values() for path in paths)
