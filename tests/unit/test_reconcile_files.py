"""The files beside a FleetSpec on their way through ConfigMaps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from fleet.errors import SpecError
from fleet_operator.flow import files as module
from fleet_operator.flow.commands import files
from fleet_operator.flow.files import from_config_maps, place, to_config_maps
from fleet_operator.resources import names
from tests.conftest import ROOT
from tests.fleet_runs import write_application
from tests.reconciled import REF, Reconciled

APP = typer.Typer()
APP.command()(files)
CONTENTS = st.dictionaries(
    st.from_regex(r"[a-z]{1,8}(/[a-z]{1,8}){0,2}\.(py|bin)", fullmatch=True), st.binary(max_size=300), max_size=6
)


@given(CONTENTS, st.randoms(use_true_random=False))
def test_files_come_out_of_configmaps_as_they_went_in(contents: dict[str, bytes], random: Any) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "LARGEST_BYTES", 100)
        manifests = to_config_maps("plots", contents)
    assert all(_size(manifest) <= 100 for manifest in manifests)
    random.shuffle(manifests)
    assert from_config_maps(manifests) == contents


def _size(manifest: dict[str, Any]) -> int:
    return sum(len(text.encode()) for text in manifest.get("data", {}).values())


def test_configmaps_of_an_older_set_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LARGEST_BYTES", 4)
    old = to_config_maps("plots", {"a.py": b"old", "b.py": b"old", "c.py": b"old"})
    new = to_config_maps("plots", {"a.py": b"new", "b.py": b"new"})
    assert from_config_maps([*new, old[2]]) == {"a.py": b"new", "b.py": b"new"}
    with pytest.raises(SpecError, match="1 of 2 ConfigMaps"):
        from_config_maps([new[0], *old[1:]])


def test_a_configmap_of_the_users_own_making_needs_its_label_and_paths_only() -> None:
    annotations = {names.PATHS_ANNOTATION: json.dumps({"own": "deep/own.py"})}
    manifest = {"metadata": {"name": "mine", "annotations": annotations}, "data": {"own": "x = 1\n"}}
    assert from_config_maps([manifest]) == {"deep/own.py": b"x = 1\n"}


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        ('{"own": "../own.py"}', "leads out of the folder"),
        ('{"own": "/etc/own.py"}', "leads out of the folder"),
        ('{"other": "own.py"}', "it has no key other"),
        ("[1]", "is not JSON from keys to paths"),
        ("{", "is not JSON from keys to paths"),
    ],
)
def test_a_configmap_that_cannot_be_unpacked_says_why(paths: str, message: str) -> None:
    manifest = {"metadata": {"name": "mine", "annotations": {names.PATHS_ANNOTATION: paths}}, "data": {"own": ""}}
    with pytest.raises(SpecError, match=message):
        from_config_maps([manifest])


def unpacked(paths: Any) -> dict[str, bytes]:
    keys = {f"key-{number}": path for number, path in enumerate(paths)}
    metadata = {"name": "mine", "annotations": {names.PATHS_ANNOTATION: json.dumps(keys)}}
    return from_config_maps([{"metadata": metadata, "data": dict.fromkeys(keys, "")}])


@pytest.mark.parametrize(
    ("paths", "message"),
    [
        (["m.py#1/999999"], "m.py: 999998 of its 999999 pieces are not there"),
        (["m.py#1/2", "m.py#7/2"], "m.py: 1 of its 2 pieces are not there"),
        ([""], "'': is no name that a file can have"),
        (["."], "'.': is no name that a file can have"),
        (["d/"], "'d/': is no name that a file can have"),
        (["d//e.py"], "'d//e.py': is no name that a file can have"),
        (["a\0b"], r"'a\x00b': is no name that a file can have"),
        (["\ud800"], r"'\ud800': is no name that a file can have"),
        (["x" * 300], f"'{'x' * 80}': is no name that a file can have"),
        (["a/" * 600 + "b"], "is no name that a file can have"),
        (["d", "d/e"], "d/e: d is a file, and not the folder of d/e"),
        (["d/e/f.py", "d"], "d/e/f.py: d is a file, and not the folder of d/e/f.py"),
    ],
    ids=lambda value: repr(value)[:30],
)
def test_a_path_that_no_file_can_have_is_refused(paths: list[str], message: str) -> None:
    with pytest.raises(SpecError) as caught:
        unpacked(paths)
    assert message in str(caught.value)


def test_a_piece_of_a_file_with_more_pieces_than_there_are_numbers_is_no_piece() -> None:
    assert unpacked(["m.py#1/9999999999"]) == {"m.py#1/9999999999": b""}  # which no module is called


def test_annotations_that_nest_without_end_are_told_as_damaged() -> None:
    annotations = {names.PATHS_ANNOTATION: "[" * 200_000}
    with pytest.raises(SpecError, match="is not JSON from keys to paths"):
        from_config_maps([{"metadata": {"name": "mine", "annotations": annotations}, "data": {}}])


def test_nothing_is_placed_outside_of_the_folder(tmp_path: Path) -> None:
    for path in ("../own.py", str(tmp_path / "own.py"), "deep/../../own.py", "deep/../own.py"):
        with pytest.raises(SpecError, match="leads out of the folder"):
            place({path: b""}, tmp_path / "folder")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_the_place_of_a_file_is_told_of_the_path(tmp_path: Path) -> None:
    (tmp_path / "own.py").mkdir()
    with pytest.raises(SpecError, match=r"own\.py: cannot be written as a file"):
        place({"own.py": b""}, tmp_path)


def test_damaged_configmaps_are_said_in_the_status(tmp_path: Path, quick_disk: None) -> None:
    run = Reconciled(tmp_path)
    metadata = {
        "name": "mine",
        "namespace": REF.namespace,
        "labels": {names.FILES_LABEL: REF.name},
        "annotations": {names.PATHS_ANNOTATION: json.dumps({"one": "d", "two": "d/e"})},
    }
    run.cluster.put({"apiVersion": "v1", "kind": "ConfigMap", "metadata": metadata, "data": {"one": "", "two": ""}})
    run.ask()
    run.look()
    assert run.conditions()["Compiled"] == ("False", "FilesMissing")
    assert "d is a file, and not the folder of d/e" in run.message("Compiled")


def test_fleet_files_prints_what_the_operator_needs(tmp_path: Path, quick_disk: None) -> None:
    run = Reconciled(tmp_path)
    run.ask()
    (tmp_path / "library").rename(tmp_path / "mine")
    run.look()
    assert run.conditions()["Compiled"] == ("False", "FilesMissing")
    assert "fleet files fleetspec.yaml | kubectl apply --server-side -f -" in run.message("Compiled")
    (tmp_path / "library" / REF.name).mkdir(parents=True)  # so that `ask` writes nothing there
    spec = write_application(tmp_path / "mine" / REF.name)
    answer = CliRunner().invoke(APP, [str(spec), "--namespace", "default", "--json"], catch_exceptions=False)
    for manifest in json.loads(answer.stdout):
        run.cluster.put(manifest)
    assert run.settle()[-1] == "Done"


def test_the_example_fits_into_one_configmap() -> None:
    answer = CliRunner().invoke(APP, [str(ROOT / "examples/crop-scouting/fleetspec.yaml"), "--json"])
    (manifest,) = json.loads(answer.stdout)
    assert "namespace" not in manifest["metadata"]
    assert "crop_scouting.py" in json.loads(manifest["metadata"]["annotations"][names.PATHS_ANNOTATION]).values()
