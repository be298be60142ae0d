"""Waiting time and lifetime of aggregators, as the API tells them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from fleet_operator.resources.views import seconds

Body = Mapping[str, Any]
SUBSET = "fleetcomputer.io/subset"


@dataclass(frozen=True)
class Life:
    """What became of one aggregator.

    Args:
        waiting_s: From the creation of its Job to the start of its first container.
        lifetime_s: From there to the end of the container that was done; with what was begun again after preemption.
        pods: How many were started; more than one when some were preempted.
    """

    subset: str
    waiting_s: float
    lifetime_s: float
    pods: int

    @property
    def whole_s(self) -> float:
        """From the creation of the Job to the new model."""
        return self.waiting_s + self.lifetime_s


class Observed:
    """Every pod that was ever there: one that is preempted is deleted."""

    def __init__(self) -> None:
        self._pods: dict[str, Body] = {}

    def add(self, pods: Iterable[Body]) -> None:
        """Remember pods as they are now."""
        for pod in pods:
            if _started_s(pod) is not None or pod["metadata"]["uid"] not in self._pods:
                self._pods[pod["metadata"]["uid"]] = pod

    def lives(self, jobs: Iterable[Body]) -> list[Life]:
        """One for each of these Jobs that is complete."""
        return [life for job in jobs if (life := self._life(job)) is not None]

    def _life(self, job: Body) -> Life | None:
        metadata = job["metadata"]
        pods = [pod for pod in self._pods.values() if _owner(pod) == metadata["uid"]]
        starts = [start for pod in pods if (start := _started_s(pod)) is not None]
        ends = [end for pod in pods if (end := _succeeded_s(pod)) is not None]
        if not starts or not ends:
            return None
        return Life(
            subset=metadata["annotations"][SUBSET],
            waiting_s=min(starts) - seconds(metadata["creationTimestamp"]),
            lifetime_s=max(ends) - min(starts),
            pods=len(starts),
        )


def _owner(pod: Body) -> str:
    return next((owner["uid"] for owner in pod["metadata"].get("ownerReferences", ())), "")


def _state(pod: Body) -> Mapping[str, Any]:
    statuses = pod.get("status", {}).get("containerStatuses", ())
    return statuses[0]["state"] if statuses else {}


def _started_s(pod: Body) -> float | None:
    state = _state(pod)
    stamp = (state.get("running") or state.get("terminated") or {}).get("startedAt")
    return seconds(stamp) if stamp else None


def _succeeded_s(pod: Body) -> float | None:
    ended = _state(pod).get("terminated") or {}
    return seconds(ended["finishedAt"]) if ended and ended["exitCode"] == 0 else None
