"""One run of the fleet: from `kubectl apply` to the end of its missions, and to its removal."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from fleet.storage.layout import FleetPaths
from fleet.storage.open import open_storage
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role
from tests.crash.application import Story
from tests.crash.cluster import FLEETS, Manifest
from tests.crash.picture import Picture, take_picture
from tests.crash.program import Operator
from tests.crash.world import Slot, World
from tests.testbed.faults import Moment

PATIENCE_S = 120.0
_QUIET_S = 0.8
_LOOK_S = 0.2
# What the garbage collector and the operator have to remove with a FleetSpec.
_OWNED = ("Mission", "Job", "Pod", "Service", "ConfigMap", "NetworkPolicy")


@dataclass(frozen=True)
class Kill:
    """When the operator is killed.

    Args:
        door: api or storage.
        write: Number of the write there.
    """

    door: str
    write: int
    moment: Moment

    def __str__(self) -> str:
        return f"killed {self.moment} {self.door} write {self.write}"


@dataclass(frozen=True)
class Result:
    """What came of a run.

    Args:
        picture: When all missions were over; None when the fleet was removed before.
        starts: How many pods each Job had.
        writes: Of the operator, by door, up to the removal.
        starts_of_operator: 1 in an undisturbed run.
        left: What was not removed with the FleetSpec.
        killed_at: The write that the kill came at, as method and path; "" when there was no kill.
    """

    picture: Picture | None
    starts: Mapping[str, int]
    writes: Mapping[str, int]
    starts_of_operator: int
    left: tuple[str, ...]
    killed_at: str


@dataclass
class Trial:
    """Runs the fleet once.

    Args:
        namespace: Of this run alone.
        kill: When the operator is killed; None for never.
        disturb: Called once the FleetSpec is applied; brings faults about.
        environment: More variables of the operator.
        may_end: The operator may end by itself, having lost its lease, and is started again.
    """

    world: World
    slot: Slot
    namespace: str
    story: Story
    kill: Kill | None = None
    disturb: Callable[[Trial], None] | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    may_end: bool = False
    starts_of_operator: int = 0
    killed_at: str = ""
    patience_s: float = PATIENCE_S

    def __post_init__(self) -> None:
        self.image = self.story.image(self.namespace)
        self.operator = self.new_operator("operator-0")
        self.storage = open_storage(self.world.storage_uri(self.world.hdfs.address, self.namespace))
        self.path = f"{FLEETS.format(self.namespace)}/{self.story.fleet}"
        self.paths = FleetPaths(self.namespace, self.story.fleet)

    def run(self) -> Result:
        """From the first start of the operator to the removal of the fleet."""
        self.world.cluster.make_namespace(self.namespace)
        try:
            self._begin()
            if self.disturb is not None:
                self.disturb(self)
            picture = None
            if self.fleet():
                self.wait_until("all missions are over", self.is_over)
                picture = take_picture(self.world.cluster, self.storage, self.namespace)
                self.remove()
            self.wait_until("everything is removed", lambda: self.is_quiet() and not self.left())
            return self._result(picture)
        finally:
            self.operator.close()
            self.world.cluster.delete(f"/api/v1/namespaces/{self.namespace}")

    def _begin(self) -> None:
        for proxy in self.slot.proxies.values():
            proxy.start_counting()
        if self.kill is not None:
            proxy = self.slot.proxies[self.kill.door]
            proxy.at_write(self.kill.write, self.kill.moment, self.kill_operator)
        for program, fault in self.story.faults.items():
            self._set_fault(program, fault)
        self.start_operator()
        self.apply()

    def apply(self) -> None:
        """`kubectl apply` of the FleetSpec."""
        self.world.cluster.apply("FleetSpec", self.story.document(self.world.library, self.namespace))

    # -- the operator

    def new_operator(self, pod: str) -> Operator:
        """A replica that does not run yet."""
        return Operator(self.world, self.slot, self.namespace, self.image, pod, self.environment)

    def start_operator(self) -> None:
        """Start it, for the first time or again."""
        self.operator.start()
        self.starts_of_operator += 1

    def kill_operator(self, write: str) -> None:
        """Kill it; whoever waits for something starts it again."""
        self.killed_at = write
        self.operator.kill()

    # -- what a run waits for

    def wait_until(self, what: str, look: Callable[[], object]) -> None:
        """Wait, and start the operator again when it was killed, as its kubelet would."""
        end = time.monotonic() + self.patience_s
        while not look():
            if not self.operator.running:
                if not self.killed_at and not self.may_end:
                    raise AssertionError(f"{self.namespace}: the operator ended:\n{self.operator.last_words()}")
                self.start_operator()
            if time.monotonic() > end:
                raise AssertionError(f"{self.namespace}: not within {self.patience_s:g} s: {what}\n{self.tell()}")
            time.sleep(_LOOK_S)

    def fleet(self) -> Manifest:
        """The FleetSpec; empty while it is not there."""
        return self.world.cluster.get(self.path) or {}

    def status(self) -> Manifest:
        """Of the FleetSpec."""
        status: Manifest = self.fleet().get("status", {})
        return status

    def condition(self, kind: str) -> tuple[str, str]:
        """Status and reason of a condition of the FleetSpec."""
        for each in self.status().get("conditions", ()):
            if each["type"] == kind:
                return each["status"], each["reason"]
        return "", ""

    def is_over(self) -> bool:
        """Whether all missions were flown and the operator has said all that there is to say."""
        fleet = self.fleet()
        status = fleet.get("status", {})
        is_current = status.get("observedGeneration") == fleet.get("metadata", {}).get("generation")
        return status.get("phase") in {"Done", "Failed"} and is_current and self.is_quiet()

    def is_quiet(self) -> bool:
        """Whether the operator has been ready, and has written nothing, for a while."""
        last = [proxy.writes[-1].at_s for proxy in self.slot.proxies.values() if proxy.writes]
        return bool(last) and time.time() - max(last) > _QUIET_S and self.operator.is_ready_for(_QUIET_S)

    def job(self, role: Role, member: str) -> str:
        """Name of a Job of the first mission."""
        return names.mission_job(role, self.story.fleet, 1, member)

    def hold(self, agent: str, seconds: float) -> None:
        """Have an agent's first flight last, and wait until it flies; a pod that comes after that does not wait."""
        self.wait_until("storage is prepared", lambda: self.storage.exists(self.paths.fleet_spec))
        path = self._set_fault(f"workflow {agent}", {"sleep": seconds, "times": 1})
        self.wait_until(f"{agent} flies", lambda: json.loads(self.storage.read(path))["times"] == 0)

    def _set_fault(self, program: str, fault: Mapping[str, float]) -> str:
        path = f"{self.paths.root}/faults/{program.replace(' ', '/')}.json"
        self.storage.write(path, json.dumps(fault).encode())
        return path

    # -- what a run leaves

    def remove(self) -> None:
        """`kubectl delete` of the FleetSpec."""
        self.world.cluster.delete(self.path)

    def left(self) -> list[str]:
        """What there still is of the fleet."""
        cluster = self.world.cluster
        found = [f"{kind}/{each['metadata']['name']}" for kind in _OWNED for each in cluster.list(kind, self.namespace)]
        found = [each for each in found if each != "ConfigMap/kube-root-ca.crt"]
        found += [f"process {each}" for each in self._processes()]
        return found + [f"storage {entry.path}" for entry in self.storage.list("")]

    def _processes(self) -> list[str]:
        """Pods that have a process."""
        ended = {line["uid"] for line in self.world.kubelet.journal(self.namespace, "ended")}
        started = self.world.kubelet.journal(self.namespace, "started")
        return [line["pod"] for line in started if line["uid"] not in ended]

    def starts(self) -> dict[str, int]:
        """How many pods of each Job were started."""
        started = self.world.kubelet.journal(self.namespace, "started")
        return dict(sorted(Counter(line["job"] for line in started).items()))

    def tell(self) -> str:
        """Where the run is, for a failure."""
        jobs = [
            f"{each['metadata']['name']}: {[one['type'] for one in each.get('status', {}).get('conditions', ())]}"
            for each in self.world.cluster.list("Job", self.namespace)
        ]
        lines = [f"status: {self.status()}", f"jobs: {jobs}", f"left: {self.left()}", f"starts: {self.starts()}"]
        return "\n".join([*lines, "the operator's log:", self.operator.last_words()])

    def _result(self, picture: Picture | None) -> Result:
        writes = {door: len(proxy.writes) for door, proxy in self.slot.proxies.items()}
        return Result(picture, self.starts(), writes, self.starts_of_operator, tuple(self.left()), self.killed_at)


@dataclass(frozen=True)
class Plan:
    """A run that is to be.

    Args:
        name: Part of its namespace.
    """

    name: str
    story: Story
    kill: Kill | None = None
    disturb: Callable[[Trial], None] | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    may_end: bool = False


def run_trial(world: World, plan: Plan) -> Result:
    """Run the fleet once in a slot of the world."""
    with world.slot() as slot:
        trial = Trial(world, slot, plan.name, plan.story, plan.kill, plan.disturb, plan.environment, plan.may_end)
        return trial.run()
