"""What a bed is made of: its machines, their sizes, names and addresses."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from enum import StrEnum

GIB = 1024**3


class Role(StrEnum):
    """What a machine is to the Fleet Computer: the value of the node label `fleetcomputer.io/role`."""

    HUB = "hub"
    GATEWAY = "gateway"


@dataclass(frozen=True)
class Size:
    """What a node says that pods may have."""

    cores: float = 2.0  # not more than this computer has
    memory_bytes: int = 4 * GIB
    pods: int = 110

    @property
    def reserved_cores(self) -> float:
        """Cores of this computer that the node keeps from its pods."""
        return max((os.cpu_count() or 1) - self.cores, 0.0)


@dataclass(frozen=True)
class MachineSpec:
    """One machine; the first of a bed is its hub."""

    name: str
    role: Role
    holds_data: bool
    size: Size = field(default_factory=Size)

    @property
    def labels(self) -> dict[str, str]:
        """Labels that its kubelet gives the node."""
        storage = {"fleetcomputer.io/storage": "true"} if self.holds_data else {}
        return {"fleetcomputer.io/role": self.role.value} | storage


@dataclass(frozen=True)
class Site:
    """Names and addresses of one bed, so that several live side by side.

    The LAN is 10.`base`.0.0/24, pods have 10.`base + 1`.0.0/16, Services 10.`base + 2`.0.0/16.
    """

    prefix: str
    base: int

    @property
    def lan(self) -> str:
        """Name of the network namespace with the bridge."""
        return f"{self.prefix}-lan"

    @property
    def cable(self) -> str:
        """Name of the interface that leads from this computer into the LAN."""
        return f"{self.prefix}-mgmt"

    @property
    def own_address(self) -> str:
        """Address of this computer in the LAN."""
        return f"10.{self.base}.0.254"

    @property
    def broadcast(self) -> str:
        """Where Wake-on-LAN packets go."""
        return f"10.{self.base}.0.255"

    @property
    def hub(self) -> str:
        """Address of the hub."""
        return self.address(0)

    @property
    def pods(self) -> str:
        """Addresses of all pods."""
        return f"10.{self.base + 1}.0.0/16"

    @property
    def services(self) -> str:
        """Addresses of Services."""
        return f"10.{self.base + 2}.0.0/16"

    @property
    def api_service(self) -> str:
        """Address of the Service `kubernetes`."""
        return f"10.{self.base + 2}.0.1"

    def address(self, index: int) -> str:
        """Address of a machine."""
        return f"10.{self.base}.0.{index + 1}"

    def mac(self, index: int) -> str:
        """Hardware address of a machine, the one that wakes it."""
        return f"02:f1:ee:{self.base:02x}:00:{index + 1:02x}"

    def pods_of(self, index: int) -> str:
        """Addresses of the pods of a machine."""
        return f"10.{self.base + 1}.{index + 1}.0/24"

    def namespace(self, machine: str) -> str:
        """Name of a machine's network namespace."""
        return f"{self.prefix}-{machine}"


def machines(edges: int = 3, size: Size | None = None) -> tuple[MachineSpec, ...]:
    """A hub, and edge machines that hold data."""
    size = size or Size()
    hub = MachineSpec("hub", Role.HUB, holds_data=False, size=size)
    return (hub, *(MachineSpec(f"edge{i + 1}", Role.GATEWAY, holds_data=True, size=size) for i in range(edges)))


# The cluster that a user makes is at 10.77; tests take the first of theirs that is free.
CLUSTER = Site("fc", 77)
TESTS = tuple(Site(f"ft{i}", 87 + 10 * i) for i in range(4))


@dataclass(frozen=True)
class Timing:
    """How fast a machine that went dark is noticed."""

    grace_s: int = 12  # from the last sign of life to NotReady
    toleration_s: int = 5  # from there until its pods are to go
    boot_delay_s: float = 0.0  # added between the wake-up packet and the start


@dataclass(frozen=True)
class BedSpec:
    """A whole bed."""

    site: Site = CLUSTER
    machines: tuple[MachineSpec, ...] = field(default_factory=machines)
    timing: Timing = field(default_factory=Timing)

    def index(self, machine: str) -> int:
        """Position of the machine of this name."""
        return [one.name for one in self.machines].index(machine)
