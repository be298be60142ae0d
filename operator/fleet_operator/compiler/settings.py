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
        storage_claim: PersistentVolumeClaim that is mounted in every pod where the storage is a folder; "" for none.
        storage_hosts: Hosts that FleetSpecs may name beside that of the platform's own storage; none means any.
        storage_ports: Ports on which pods reach the storage, as far as the address of the storage does not say.
        network_policies: Whether each fleet gets NetworkPolicies.
        lost_node_s: How long a pod waits for its machine when that is gone, before another takes its place.
        user_id: User and group that all containers run as.
    """

    runtime_image: str = f"fleet-computer/runtime:{fleet.__version__}"
    role_command: tuple[str, ...] = ("python", "-m", "fleet.runtime")
    serve_command: tuple[str, ...] = ("fleet", "serve")
    pull_policy: str = "IfNotPresent"
    storage_uri: str = "webhdfs://fleet@fleet-computer-namenode.fleet-system:9870/fleet"
    storage_claim: str = ""
    storage_hosts: tuple[str, ...] = ()
    storage_ports: tuple[int, ...] = (9870, 9864)
    network_policies: bool = True
    lost_node_s: int = 30
    user_id: int = 65532
    ports: Ports = field(default_factory=Ports)
