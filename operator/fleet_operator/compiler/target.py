"""What the compiler is given: the FleetSpec, and what was decided about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fleet.spec.functions import EvalSpec, FunctionSpec, MapSpec
from fleet.spec.resources import Fleet, FleetSpec
from fleet.storage.webhdfs_address import with_copies
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.compiler.settings import Settings
from fleet_operator.policy.shares import Share


@dataclass(frozen=True)
class Owner:
    """The object that owns what is made for it: Kubernetes deletes all that when the owner is gone.

    Args:
        uid: Tells it from an earlier or later object of the same name.
    """

    api_version: str
    kind: str
    name: str
    uid: str


@dataclass(frozen=True)
class Target:
    """A fleet, and where it runs.

    Args:
        spec: The validated FleetSpec.
        bundle: Function sources and other small files beside the FleetSpec.
        settings: What the installation decides.
        storage_uri: Address of the storage; that of the FleetSpec, or the installation's, when empty.
        owner: Owner of every object that is made in the fleet's namespace; none when it is only printed.
    """

    spec: FleetSpec
    bundle: Bundle = field(default_factory=Bundle)
    settings: Settings = field(default_factory=Settings)
    storage_uri: str = ""
    owner: Owner | None = None

    @property
    def fleet(self) -> Fleet:
        """`spec` of the FleetSpec."""
        return self.spec.spec

    @property
    def storage(self) -> str:
        """Address of the storage for the roles; with the copies that the FleetSpec or the address itself asks for."""
        address = self.storage_uri or self.fleet.storage.uri or self.settings.storage_uri
        return with_copies(address, self.fleet.storage.replication)


@dataclass(frozen=True)
class UserFunction:
    """Map() or Eval() as a server in a pod.

    Args:
        name: `map` or `eval`: container, part of the command and of the variable with the address.
        spec: The user's function.
        port: Where it listens.
    """

    name: str
    spec: FunctionSpec
    port: int


def user_functions(target: Target) -> tuple[UserFunction, UserFunction]:
    """Map() and Eval() of a fleet."""
    ports = target.settings.ports
    map_spec: MapSpec = target.fleet.map
    eval_spec: EvalSpec = target.fleet.eval
    return UserFunction("map", map_spec, ports.map), UserFunction("eval", eval_spec, ports.eval)


@dataclass(frozen=True)
class AggregatorTerms:
    """What was decided about the aggregator of one subset.

    Args:
        subset: Key of the subset.
        level: Scheduling level 0..9; 0 is suspended.
        share: Its CPU and memory; None leaves the defaults.
    """

    subset: str
    level: int
    share: Share | None = None


@dataclass(frozen=True)
class Placement:
    """Where the data of an aggregator is.

    Args:
        nodes: Bytes of its data on each node, by the node's name; only nodes that hold some.
    """

    nodes: Mapping[str, int] = field(default_factory=dict)
