"""What of a container differs on this machine: addresses, folders, programs; and nothing else."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fleet_operator.local.environment import Place, check_command, command_of
from fleet_operator.local.workloads import Container, Service, UnsupportedManifest

CONTAINER = Container(
    name="map",
    image="runtime",
    command=("fleet", "serve", "map", "own:f", "--host", "$(FLEET_BIND)", "$$(HOME)", "$(UNKNOWN)"),
    working_folder="/fleet/functions",
    environment={"FLEET_BIND": "0.0.0.0", "HOME": "/tmp", "PYTHONPATH": "/fleet/functions"},
    mounts={"/tmp": "tmp", "/fleet/functions": "functions"},
    ports={"map": 8081},
    cpu_cores=0.1,
    memory_bytes=1.0,
    memory_limit_bytes=1.0,
)
PLACE = Place(
    address="127.9.9.2",
    hosts=dict.fromkeys(Service("crop-sensor", "default", {}).hosts, "127.9.9.3"),
    folders={"tmp": Path("/run/tmp-1"), "functions": Path("/run/functions")},
    ports=frozenset({8081, 8082}),
)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("0.0.0.0", "127.9.9.2"),
        ("http://localhost:8081", "http://127.9.9.2:8081"),
        ("http://localhost:80810", "http://localhost:80810"),
        ("hdfs://localhost:8020", "hdfs://localhost:8020"),
        ("http://crop-sensor:8080/x", "http://127.9.9.3:8080/x"),
        ("http://crop-sensor.default:8080", "http://127.9.9.3:8080"),
        ("http://crop-sensor.default.svc.cluster.local:8080", "http://127.9.9.3:8080"),
        ("http://my-crop-sensor:8080", "http://my-crop-sensor:8080"),
        ("crop-sensor-2", "crop-sensor-2"),
        ("/tmp", "/run/tmp-1"),
        ("/fleet/functions/own.py", "/run/functions/own.py"),
        ("/tmpfile", "/tmpfile"),
        ("file:///tmp/storage", "file:///tmp/storage"),
        ("plain text", "plain text"),
    ],
)
def test_values_are_changed_where_they_are_addresses_or_mounted_paths(value: str, expected: str) -> None:
    assert PLACE.localised(value, CONTAINER) == expected


def test_the_environment_is_the_images_and_the_manifests_and_not_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SECRET_OF_THE_SHELL", "x")
    environment = PLACE.environment(CONTAINER)
    assert environment.pop("PATH").startswith(str(Path(sys.executable).parent))
    assert environment.pop("PYTHONPATH").split(":")[0] == "/run/functions"
    environment.pop("NUMBA_CACHE_DIR", None)
    environment.pop("LD_LIBRARY_PATH", None)
    assert environment == {"LANG": "C.UTF-8", "FLEET_BIND": "127.9.9.2", "HOME": "/run/tmp-1"}


def test_variables_in_commands_are_filled_in_as_kubernetes_does() -> None:
    command = command_of(CONTAINER, {"FLEET_BIND": "127.9.9.2", "HOME": "/x"})
    assert command[0] == sys.executable
    assert command[-6:] == ("map", "own:f", "--host", "127.9.9.2", "$(HOME)", "$(UNKNOWN)")


def test_an_image_without_a_command_cannot_run_here_and_it_is_said_what_can() -> None:
    with pytest.raises(UnsupportedManifest, match=r"write its program in spec\.map\.command"):
        check_command(replace(CONTAINER, command=()))
