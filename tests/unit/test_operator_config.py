"""What the environment tells the operator."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.errors import ExitCode
from fleet.storage.limits import Limits
from fleet_operator.compiler.settings import Settings
from fleet_operator.config import Config, ConfigError, from_environment


def test_every_variable_has_its_place() -> None:
    environment = {
        "RUNTIME_IMAGE": "registry/runtime:1",
        "PULL_POLICY": "Never",
        "STORAGE_URI": "file:///fleet/storage",
        "STORAGE_CLAIM": "fleet-storage",
        "STORAGE_HOSTS": "nn2:9870, *.Farm.example,[fd00::1]",
        "STORAGE_LARGEST_MIB": "64",
        "NAMESPACE": "fleet-system",
        "WATCH_NAMESPACES": "west, east,",
        "WORKERS": "3",
        "LIBRARY": "/library",
        "HEALTH_PORT": "0",
        "LEASE": "other",
        "LEASE_SECONDS": "30",
        "IDENTITY": "pod-1",
        "STOP_SECONDS": "5",
        "LOG_FORMAT": "json",
        "LOG_LEVEL": "debug",
    }
    given = {f"FLEET_OPERATOR_{name}": text for name, text in environment.items()} | {"PATH": "/bin"}
    assert from_environment(given) == Config(
        settings=Settings(
            runtime_image="registry/runtime:1",
            pull_policy="Never",
            storage_uri="file:///fleet/storage",
            storage_claim="fleet-storage",
            storage_hosts=("*.farm.example", "[fd00::1]", "nn2:9870"),
        ),
        limits=Limits(object_bytes=64 << 20, call_s=60.0),
        namespace="fleet-system",
        watch_namespaces=("east", "west"),
        workers=3,
        library=Path("/library"),
        health_port=0,
        lease="other",
        lease_s=30.0,
        identity="pod-1",
        stop_s=5.0,
        log_format="json",
        log_level="debug",
    )


def test_an_empty_environment_is_the_defaults() -> None:
    config = from_environment({})
    assert config == Config(identity=config.identity)


@pytest.mark.parametrize(
    ("name", "text", "wanted"),
    [
        ("WORKERS", "many", "a whole number from 1 to 256"),
        ("WORKERS", "0", "a whole number from 1 to 256"),
        ("STORAGE_HOSTS", "http://nn", "hosts joined by commas: name, name:port or *.domain"),
        ("STORAGE_HOSTS", "nn1 nn2", "hosts joined by commas: name, name:port or *.domain"),
        ("STORAGE_LARGEST_MIB", "0", "a whole number from 1 to 65536"),
        ("HEALTH_PORT", "70000", "a whole number from 0 to 65535"),
        ("PULL_POLICY", "Sometimes", "one of Always, IfNotPresent, Never"),
        ("LOG_FORMAT", "xml", "one of plain, json"),
    ],
)
def test_a_value_that_is_not_possible_is_refused_with_those_that_are(name: str, text: str, wanted: str) -> None:
    with pytest.raises(ConfigError) as caught:
        from_environment({f"FLEET_OPERATOR_{name}": text})
    assert str(caught.value) == f'FLEET_OPERATOR_{name} is "{text}"; it must be {wanted}'
    assert caught.value.exit_code == ExitCode.USAGE


def test_a_misspelt_variable_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"FLEET_OPERATOR_WORKER is not a variable.*FLEET_OPERATOR_WORKERS"):
        from_environment({"FLEET_OPERATOR_WORKER": "3"})


def test_variables_that_kubernetes_sets_for_a_service_of_this_name_are_not_meant_for_the_operator() -> None:
    links = ("SERVICE_HOST", "SERVICE_PORT", "SERVICE_PORT_HEALTH", "PORT", "PORT_8080_TCP", "PORT_8080_TCP_PROTO")
    config = from_environment({f"FLEET_OPERATOR_{name}": "tcp://10.96.3.4:8080" for name in links})
    assert config == Config(identity=config.identity)
