"""What the installation tells the operator through its environment."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from fleet.errors import ExitCode, FleetError
from fleet.storage.limits import Limits
from fleet_operator.cluster.credentials import own_namespace
from fleet_operator.compiler.settings import Settings

T = TypeVar("T")
PREFIX = "FLEET_OPERATOR_"
_NAMES = (
    "RUNTIME_IMAGE", "PULL_POLICY", "STORAGE_URI", "STORAGE_CLAIM", "NAMESPACE", "WATCH_NAMESPACES", "WORKERS",
    "STORAGE_PORTS", "STORAGE_HOSTS", "STORAGE_LARGEST_MIB", "NETWORK_POLICIES", "LIBRARY", "HEALTH_PORT", "LEASE",
    "LEASE_SECONDS", "IDENTITY", "STOP_SECONDS", "LOG_FORMAT", "LOG_LEVEL",
)  # fmt: skip
# What Kubernetes itself sets in pods beside a Service called fleet-operator ("Service", environment variables).
_SERVICE_LINK = re.compile(r"SERVICE_(HOST|PORT(_\w+)?)|PORT(_\d+_\w+)?")
_HOST = re.compile(r"(\*\.)?[A-Za-z0-9._-]+(:[0-9]{1,5})?|\[[0-9A-Fa-f:.]+\](:[0-9]{1,5})?")
_PULL_POLICIES = ("Always", "IfNotPresent", "Never")
_LOG_FORMATS = ("plain", "json")
_LOG_LEVELS = ("debug", "info", "warning", "error")


class ConfigError(FleetError):
    """A variable of the environment says something that the operator cannot do."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True)
class Config:
    """Configuration of one operator process.

    Args:
        settings: What the compiler needs to know.
        namespace: Where the operator itself runs, and its Lease is.
        watch_namespaces: Where fleets are looked for; none means everywhere.
        workers: Fleets that are worked on at the same time.
        limits: What one call to a storage may take; the size is FLEET_OPERATOR_STORAGE_LARGEST_MIB.
        library: Folder with files of applications by fleet name.
        health_port: Where probes and Prometheus ask; 0 takes a free one.
        lease: Name of the Lease.
        lease_s: How long a lease that is not renewed is left alone.
        identity: Name of this replica in the Lease.
        stop_s: How long passes that are at work may go on after SIGTERM.
        log_format: plain or json.
        log_level: debug, info, warning or error.
    """

    settings: Settings = field(default_factory=Settings)
    namespace: str = "default"
    watch_namespaces: tuple[str, ...] = ()
    workers: int = 8
    limits: Limits = field(default=Limits(object_bytes=128 << 20, call_s=60.0))
    library: Path = Path("/fleet/library")
    health_port: int = 8080
    lease: str = "fleet-operator"
    lease_s: float = 15.0
    identity: str = "operator"
    stop_s: float = 20.0
    log_format: str = "plain"
    log_level: str = "info"


def from_environment(environment: Mapping[str, str]) -> Config:
    """The configuration that the variables FLEET_OPERATOR_* ask for.

    Raises:
        ConfigError: a variable is misspelt, or its value is none of those that are possible.
    """
    given = {
        name.removeprefix(PREFIX): text
        for name, text in environment.items()
        if name.startswith(PREFIX) and not _SERVICE_LINK.fullmatch(name.removeprefix(PREFIX))
    }
    unknown = sorted(set(given) - set(_NAMES))
    if unknown:
        names = ", ".join(PREFIX + name for name in _NAMES)
        raise ConfigError(f"{PREFIX}{unknown[0]} is not a variable of the operator; these are: {names}")
    plain, settings = Config(), Settings()
    return Config(
        settings=Settings(
            runtime_image=_text(given, "RUNTIME_IMAGE", settings.runtime_image),
            pull_policy=_one_of(given, "PULL_POLICY", _PULL_POLICIES, settings.pull_policy),
            storage_uri=_text(given, "STORAGE_URI", settings.storage_uri),
            storage_claim=_text(given, "STORAGE_CLAIM", settings.storage_claim),
            storage_hosts=_hosts(given, "STORAGE_HOSTS"),
            storage_ports=_ports(given, "STORAGE_PORTS") or settings.storage_ports,
            network_policies=_one_of(given, "NETWORK_POLICIES", ("true", "false"), "true") == "true",
        ),
        namespace=_text(given, "NAMESPACE", own_namespace() or plain.namespace),
        watch_namespaces=_list(given, "WATCH_NAMESPACES"),
        workers=_number(given, "WORKERS", plain.workers, least=1, most=256),
        limits=replace(
            plain.limits,
            object_bytes=_number(given, "STORAGE_LARGEST_MIB", plain.limits.object_bytes >> 20, least=1, most=65536)
            << 20,
        ),
        library=Path(_text(given, "LIBRARY", str(plain.library))),
        health_port=_number(given, "HEALTH_PORT", plain.health_port, least=0, most=65535),
        lease=_text(given, "LEASE", plain.lease),
        lease_s=float(_number(given, "LEASE_SECONDS", round(plain.lease_s), least=3, most=3600)),
        identity=_text(given, "IDENTITY", f"{socket.gethostname()}-{os.getpid()}"),
        stop_s=float(_number(given, "STOP_SECONDS", round(plain.stop_s), least=0, most=3600)),
        log_format=_one_of(given, "LOG_FORMAT", _LOG_FORMATS, plain.log_format),
        log_level=_one_of(given, "LOG_LEVEL", _LOG_LEVELS, plain.log_level),
    )


def _text(given: Mapping[str, str], name: str, default: str) -> str:
    return given.get(name, "").strip() or default


def _list(given: Mapping[str, str], name: str) -> tuple[str, ...]:
    return tuple(sorted({part.strip() for part in given.get(name, "").split(",")} - {""}))


def _hosts(given: Mapping[str, str], name: str) -> tuple[str, ...]:
    def fits(text: str) -> bool:
        return all(_HOST.fullmatch(part.strip()) for part in text.split(",") if part.strip())

    wanted = "hosts joined by commas: name, name:port or *.domain"
    _checked(given, name, "any", fits, wanted)
    return tuple(host.lower() for host in _list(given, name))


def _ports(given: Mapping[str, str], name: str) -> tuple[int, ...]:
    def fits(text: str) -> bool:
        return all(part.strip().isdecimal() and 0 < int(part) < 65536 for part in text.split(","))

    text = _checked(given, name, "1", fits, "ports joined by commas, such as 9870,9864")
    return tuple(int(part) for part in text.split(",")) if given.get(name, "").strip() else ()


def _one_of(given: Mapping[str, str], name: str, choices: tuple[str, ...], default: str) -> str:
    return _checked(given, name, default, lambda text: text in choices, f"one of {', '.join(choices)}")


def _number(given: Mapping[str, str], name: str, default: int, least: int, most: int) -> int:
    def fits(text: str) -> bool:
        return text.isdecimal() and least <= int(text) <= most

    return int(_checked(given, name, str(default), fits, f"a whole number from {least} to {most}"))


def _checked(given: Mapping[str, str], name: str, default: str, fits: Callable[[str], bool], wanted: str) -> str:
    text = _text(given, name, default)
    if not fits(text):
        raise ConfigError(f'{PREFIX}{name} is "{text}"; it must be {wanted}')
    return text
