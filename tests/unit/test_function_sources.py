"""Which files beside a FleetSpec go to its pods."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from fleet.errors import SpecError
from fleet.spec.resources import Fleet
from fleet_operator.flow.sources import read_bundle
from tests.fleet_runs import spec_document


def fleet(**changes: Any) -> Fleet:
    return Fleet.model_validate(spec_document(**changes)["spec"])


def write(folder: Path, files: dict[str, str]) -> None:
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)


def test_a_module_brings_the_modules_beside_it_that_it_imports(tmp_path: Path) -> None:
    write(tmp_path, {"own.py": "import near\nimport numpy\n", "near.py": "from far.deep import x\n", "other.py": ""})
    write(tmp_path, {"far/__init__.py": "", "far/deep.py": "from . import wide\nx = 1\n", "far/wide.py": ""})
    assert sorted(read_bundle(fleet(), tmp_path).files) == [
        "far/__init__.py", "far/deep.py", "far/wide.py", "near.py", "own.py",
    ]  # fmt: skip


def test_installed_modules_are_the_images(tmp_path: Path) -> None:
    installed = {"function": "fleet.functions.contract:MapClient"}
    assert not read_bundle(fleet(map=installed, eval=installed), tmp_path)


def test_images_need_no_files(tmp_path: Path) -> None:
    assert not read_bundle(fleet(map={"image": "mine/map"}, eval={"image": "mine/eval"}), tmp_path)


def test_profiles_and_models_that_are_files_are_carried_too(tmp_path: Path) -> None:
    write(tmp_path, {"own.py": "", "energy/mine.yaml": "a: 1\n", "start.npz": "model"})
    changed = fleet(agents={"count": 1, "energyProfile": "energy/mine.yaml#spark"}, sa={"pretrained": "start.npz"})
    assert sorted(read_bundle(changed, tmp_path).files) == ["energy/mine.yaml", "own.py", "start.npz"]


def test_a_module_of_another_fleet_in_this_process_is_not_taken_for_an_installed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "own", ModuleType("own"))
    with pytest.raises(SpecError, match="no module 'own'"):
        read_bundle(fleet(), tmp_path)


def test_everything_that_is_missing_is_told_at_once(tmp_path: Path) -> None:
    changed = fleet(agents={"count": 1, "energyProfile": "../mine.yaml#spark"}, sa={"pretrained": "start.npz"})
    with pytest.raises(SpecError) as caught:
        read_bundle(changed, tmp_path)
    assert str(caught.value).replace(str(tmp_path), "HERE") == (
        "spec.agents.energyProfile: ../mine.yaml is not below the folder of the FleetSpec; copy it there\n"
        "spec.eval.function: there is no module 'own' beside the FleetSpec in HERE; put own.py beside the FleetSpec\n"
        "spec.map.function: there is no module 'own' beside the FleetSpec in HERE; put own.py beside the FleetSpec\n"
        "spec.sa.pretrained: cannot read HERE/start.npz: No such file or directory; "
        "write its path relative to the FleetSpec"
    )


def test_a_module_that_is_not_python_is_told_with_its_line(tmp_path: Path) -> None:
    write(tmp_path, {"own.py": "x = 1\ndef broken(:\n"})
    with pytest.raises(SpecError, match=r"own\.py, line 2"):
        read_bundle(fleet(), tmp_path)
