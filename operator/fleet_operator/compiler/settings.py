"""What the installation, not the FleetSpec, decides about the compiled objects."""

from __future__ import annotations

from dataclasses import dataclass, field

import fleet


@dataclass(frozen=True)
class Ports:
    """Ports of the servers in a pod."""

    sensor: int = 8080
    map: int = 8081
    eval: int = 8082


@dataclass(frozen=True)
class Settings:
    """Images, ports and addresses.

    Args:
        runtime_image: Image with the platform's programs.
        role_command: In that image, what starts a role; the role's name follows.
        serve_command: In that image, what serves a Python function; `map` or `eval` and the function follow.
        pull_policy: When nodes fetch images.
        storage_uri: The platform's own storage, for fleets that name none.
        user_id: User and group that all containers run as.
    """

    runtime_image: str = f"fleet-computer/runtime:{fleet.__version__}"
    role_command: tuple[str, ...] = ("python", "-m", "fleet.runtime")
    serve_command: tuple[str, ...] = ("fleet", "serve")
    pull_policy: str = "IfNotPresent"
    storage_uri: str = "hdfs://fleet-storage:8020"
    user_id: int = 65532
    ports: Ports = field(default_factory=Ports)
