"""What goes wrong with a run, other than a kill of the operator after a write."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from fleet_operator.resources import names
from fleet_operator.resources.roles import Role
from tests.crash.application import AGENTS, FLEET, REAL, SMOOTH, Story
from tests.crash.campaign import NOTHING, Allowed
from tests.crash.program import Operator
from tests.crash.trial import Plan, Trial
from tests.testbed.faults import WRITES, Fault, Moment

AGENT = "agent-1"
_LONG_S = 600.0
_SOME_RECORDS = 10
_SOME_WRITES = "|".join(sorted(WRITES))


# -- the API server refuses, is slow, or is away


def conflicts(trial: Trial) -> None:
    """Every third write is refused with 409."""
    trial.slot.api.faults.append(Fault(method=_SOME_WRITES, share=0.3, status=409))


def throttled(trial: Trial) -> None:
    """A quarter of all requests, watches too, are refused with 429."""
    trial.slot.api.faults.append(Fault(share=0.25, status=429, retry_after_s=1))


def server_errors(trial: Trial) -> None:
    """A quarter of all requests fail with 500, half of them after the server has done them."""
    trial.slot.api.faults.append(Fault(share=0.12, status=500))
    trial.slot.api.faults.append(Fault(method=_SOME_WRITES, share=0.14, status=500, moment=Moment.AFTER))


def slow_and_cut(trial: Trial) -> None:
    """Answers take long, and every tenth connection is reset, half of these after the server has done its work."""
    trial.slot.api.faults.append(Fault(share=0.05, reset=True))
    trial.slot.api.faults.append(Fault(method=_SOME_WRITES, share=0.05, reset=True, moment=Moment.AFTER))
    trial.slot.api.faults.append(Fault(delay_s=0.3))


def api_storm(trial: Trial) -> None:
    """All of that at once."""
    faults = trial.slot.api.faults
    faults.append(Fault(method=_SOME_WRITES, share=0.1, status=409))
    faults.append(Fault(share=0.05, status=429, retry_after_s=1))
    faults.append(Fault(share=0.05, status=500))
    faults.append(Fault(method=_SOME_WRITES, share=0.05, status=500, moment=Moment.AFTER))
    faults.append(Fault(share=0.05, reset=True))
    faults.append(Fault(method=_SOME_WRITES, share=0.05, reset=True, moment=Moment.AFTER))
    faults.append(Fault(delay_s=0.1))


def storage_errors(trial: Trial) -> None:
    """Storage fails in all these ways."""
    faults = trial.slot.storage.faults
    faults.append(Fault(share=0.1, status=503))
    faults.append(Fault(method=_SOME_WRITES, share=0.1, status=500, moment=Moment.AFTER))
    faults.append(Fault(share=0.1, reset=True))
    faults.append(Fault(share=0.2, delay_s=0.3))


def watches_cut(trial: Trial) -> None:
    """All watches break, again and again."""
    for _ in range(8):
        time.sleep(0.7)
        trial.slot.api.cut_watches()


def watches_stalled(trial: Trial) -> None:
    """Nothing more comes over any watch, and nothing says so."""
    trial.patience_s = 400.0  # of a dead connection the operator only knows by the bookmarks that do not come
    trial.hold(AGENT, 1.0)
    trial.slot.api.stall_watches()


def api_away(trial: Trial) -> None:
    """The operator cannot reach the API server for a while in which the mission goes on."""
    trial.hold(AGENT, 1.0)
    trial.slot.api.down()
    time.sleep(4.0)
    trial.slot.api.up()


# -- the operator


def stopped_and_started(trial: Trial) -> None:
    """It is asked to end in mid-flight, as by a rolling update, and comes back after the mission."""
    trial.hold(AGENT, 1.0)
    trial.operator.stop()
    time.sleep(3.0)
    trial.start_operator()


def leader_killed(trial: Trial) -> None:
    """Of two operators the one at work is killed in mid-flight, and does not come back."""
    with _second(trial) as second:
        trial.hold(AGENT, 1.0)
        trial.operator.close()
        trial.operator = second


def leader_frozen(trial: Trial) -> None:
    """It hangs in mid-flight until the other has taken over; when it goes on, it must not write any more."""
    with _second(trial) as second:
        trial.hold(AGENT, 1.0)
        first, trial.operator = trial.operator, second
        first.freeze()
        trial.wait_until("the other operator has taken over", lambda: trial.storage.exists(trial.paths.weights(2)))
        first.thaw()
        trial.wait_until("the one that hung ends", lambda: not first.running)
        first.close()


@contextmanager
def _second(trial: Trial) -> Iterator[Operator]:
    """Another replica, which waits for the lease; it is the trial's own operator in the end."""
    path = f"/apis/coordination.k8s.io/v1/namespaces/{trial.namespace}/leases/fleet-operator"
    trial.wait_until("the first operator has the lease", lambda: trial.world.cluster.get(path))
    second = trial.new_operator("operator-1")
    second.start()
    try:
        yield second
    finally:
        if trial.operator is not second:
            second.close()


# -- pods, nodes, images, quotas


def evicted(trial: Trial) -> None:
    """The pod of a workflow is evicted in mid-flight."""
    trial.hold(AGENT, _LONG_S)
    _evict(trial, _pod_of(trial, Role.WORKFLOW, AGENT))


def made_anew(trial: Trial) -> None:
    """The FleetSpec is deleted in mid-flight, and applied again."""
    trial.hold(AGENT, _LONG_S)
    trial.remove()
    trial.wait_until("the FleetSpec is gone", lambda: not trial.fleet())
    trial.apply()


def flight_killed(trial: Trial) -> None:
    """With real roles: the pod of a workflow is evicted, and the operator killed, after some states of the flight."""
    log = trial.paths.log(1, AGENT)
    trial.wait_until("the agent has flown a part", lambda: _records(trial, log) >= _SOME_RECORDS)
    _evict(trial, _pod_of(trial, Role.WORKFLOW, AGENT))
    trial.kill_operator("in flight")


def node_lost(trial: Trial) -> None:
    """The machine of a workflow loses its power in mid-flight, and comes back when its pods were given up."""
    trial.hold(AGENT, _LONG_S)
    pod = _pod_of(trial, Role.WORKFLOW, AGENT)
    path = f"/api/v1/namespaces/{trial.namespace}/pods/{pod}"
    node = (trial.world.cluster.get(path) or {})["spec"]["nodeName"]
    trial.world.kubelet.power_off(node)
    try:
        trial.wait_until("the pods of the lost node are given up", lambda: _is_leaving(trial, path))
    finally:
        trial.world.kubelet.power_on(node)


def image_missing(trial: Trial) -> None:
    """No node has the image, until somebody loads it."""
    trial.world.kubelet.lose_image(trial.image)
    trial.wait_until("the missing image is told", lambda: trial.condition("Degraded") == ("True", "ImageMissing"))
    trial.world.kubelet.load_image(trial.image)
    trial.wait_until("nothing is told any more", lambda: trial.condition("Degraded")[0] == "False")


def quota_exceeded(trial: Trial) -> None:
    """The namespace may have no pods, until somebody raises its quota."""
    path = f"/api/v1/namespaces/{trial.namespace}/resourcequotas"
    trial.world.cluster.post(path, {"metadata": {"name": "few"}, "spec": {"hard": {"pods": "0"}}})
    trial.wait_until("the quota is told", lambda: trial.condition("Degraded") == ("True", "QuotaExceeded"))
    trial.world.cluster.patch(f"{path}/few", {"spec": {"hard": {"pods": "50"}}})
    trial.wait_until("nothing is told any more", lambda: trial.condition("Degraded")[0] == "False")


# -- removal


def deleted_in_flight(trial: Trial) -> None:
    """The FleetSpec is deleted in mid-flight."""
    trial.hold(AGENT, _LONG_S)
    trial.remove()
    trial.wait_until("the FleetSpec is gone", lambda: not trial.fleet())


def deleted_without_operator(trial: Trial) -> None:
    """The same while no operator runs: what storage has is removed by the next one."""
    trial.hold(AGENT, _LONG_S)
    trial.operator.stop()
    trial.remove()
    time.sleep(1.0)
    if trial.fleet():
        raise AssertionError("the FleetSpec does not go without its operator")
    trial.start_operator()


def deleted_unheard(trial: Trial) -> None:
    """The same while the operator cannot reach the API server, which then knows nothing of the past any more."""
    trial.hold(AGENT, _LONG_S)
    trial.slot.api.down()
    trial.remove()
    trial.wait_until("the FleetSpec is gone", lambda: not trial.fleet())
    trial.world.plane.restart_api_server()
    trial.slot.api.up()


# -- what is underneath


def everything_restarts(trial: Trial) -> None:
    """NameNode and a DataNode are killed in mid-flight, the API server while models are retrained."""
    trial.hold(AGENT, 4.0)
    trial.world.hdfs.stop_datanode(0)
    try:
        trial.world.hdfs.restart_namenode()
        trial.wait_until("models are retrained", lambda: trial.job(Role.AGGREGATOR, "1") in trial.starts())
        trial.world.plane.restart_api_server()
    finally:
        trial.world.hdfs.start_datanode(0)


def _pod_of(trial: Trial, role: Role, agent: str) -> str:
    job = trial.job(role, agent)
    started = trial.world.kubelet.journal(trial.namespace, "started")
    pod: str = next(line["pod"] for line in started if line["job"] == job)
    return pod


def _evict(trial: Trial, pod: str) -> None:
    path = f"/api/v1/namespaces/{trial.namespace}/pods/{pod}/eviction"
    metadata = {"name": pod, "namespace": trial.namespace}
    trial.world.cluster.post(path, {"apiVersion": "policy/v1", "kind": "Eviction", "metadata": metadata})


def _records(trial: Trial, log: str) -> int:
    return trial.storage.read(log).count(b"\n") if trial.storage.exists(log) else 0


def _is_leaving(trial: Trial, path: str) -> bool:
    pod = trial.world.cluster.get(path)
    return pod is None or "deletionTimestamp" in pod["metadata"]


def _told(reason: str) -> Allowed:
    """A trouble is told, and its end."""
    return Allowed(frozenset({reason, "Recovered"}))


@dataclass(frozen=True)
class Scenario:
    """A fault, and what it may change in the results.

    Args:
        alone: No other run goes on meanwhile.
        quick: Part of `make test`; the rest is in `make crash-test`.
        environment: More variables of the operator.
        story: What goes on by itself.
        may_end: The operator may lose its lease by it.
    """

    disturb: Callable[[Trial], None]
    allowed: Allowed = NOTHING
    alone: bool = False
    quick: bool = True
    environment: Mapping[str, str] = field(default_factory=dict)
    story: Story = SMOOTH
    may_end: bool = False

    @property
    def name(self) -> str:
        return self.disturb.__name__.replace("_", "-")

    @property
    def plan(self) -> Plan:
        """The run with this fault."""
        return Plan(self.name, self.story, None, self.disturb, self.environment, self.may_end)


_WORKFLOW = names.mission_job(Role.WORKFLOW, FLEET, 1, AGENT)
_TRIED_LESS = Allowed(lost_events=True)
_SHORT_LEASE = {"FLEET_OPERATOR_LEASE_SECONDS": "6"}
_FLIGHTS = {
    names.mission_job(role, FLEET, 1, f"agent-{index + 1}")
    for role in (Role.SENSOR, Role.WORKFLOW)
    for index in range(AGENTS)
}
# A machine that is back reports the pods that ran on it as failed, until they are removed: it depends on who is faster
# whether the operator sees that.
_NODE_LOST = Allowed(frozenset({"NodeLost", "PodFailing", "Recovered"}), started_again=frozenset(_FLIGHTS))
_MADE_ANEW = Allowed(started_again=frozenset({names.training_job(FLEET), *_FLIGHTS}))
_REAL_FLIGHT = Allowed(started_again=frozenset({names.mission_job(Role.WORKFLOW, REAL.fleet, 1, AGENT)}))
SCENARIOS = (
    Scenario(api_storm, _TRIED_LESS, may_end=True),
    Scenario(conflicts, _TRIED_LESS, may_end=True, quick=False),
    Scenario(throttled, _TRIED_LESS, may_end=True, quick=False),
    Scenario(server_errors, _TRIED_LESS, may_end=True, quick=False),
    Scenario(slow_and_cut, _TRIED_LESS, may_end=True, quick=False),
    Scenario(storage_errors, _told("StorageUnavailable")),
    Scenario(watches_cut, quick=False),
    Scenario(watches_stalled, quick=False),
    Scenario(api_away, _TRIED_LESS, may_end=True, quick=False),
    Scenario(stopped_and_started, quick=False),
    Scenario(leader_killed, environment=_SHORT_LEASE, may_end=True),
    Scenario(leader_frozen, environment=_SHORT_LEASE, may_end=True, quick=False),
    Scenario(evicted, Allowed(started_again=frozenset({_WORKFLOW}))),
    Scenario(flight_killed, _REAL_FLIGHT, story=REAL, quick=False),
    Scenario(image_missing, _told("ImageMissing")),
    Scenario(quota_exceeded, _told("QuotaExceeded")),
    Scenario(deleted_in_flight, quick=False),
    Scenario(deleted_without_operator),
    Scenario(made_anew, _MADE_ANEW, quick=False),
    Scenario(deleted_unheard, alone=True, quick=False, may_end=True),
    Scenario(node_lost, _NODE_LOST),
    Scenario(everything_restarts, _told("StorageUnavailable"), alone=True, may_end=True),
)
