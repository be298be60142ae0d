"""One pod of the API server as processes of this computer."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from fleet_operator.local.environment import Place
from fleet_operator.local.pod import Phase, Pod
from fleet_operator.local.probe import HttpProbe
from fleet_operator.local.processes import Nursery
from fleet_operator.local.workloads import Job, parse_job
from tests.testbed.stand_in.statuses import View

Manifest = dict[str, Any]
_FOR_EVER = 10**9
_PROBE_TIMEOUT_S = 2.0
_TERMINATED = 143


class RunningPod:
    """The containers of a pod; `step` moves it on and never waits.

    Args:
        died: Told when a sidecar is started again.
    """

    def __init__(
        self, manifest: Manifest, place: Place, nursery: Nursery, logs: Path, died: Callable[[str, str], None]
    ) -> None:
        self.job = job_of(manifest)
        self.place = place
        self.restarts: Counter[str] = Counter()
        self._died = died
        self._last_words = ""
        self._pod = Pod(self.job, place, nursery, logs, self._sidecar_died)
        self._probe = _readiness(manifest, place.address)
        self._ready = False
        self._stopped_from_outside = False

    @property
    def stopped(self) -> bool:
        return self._pod.phase is Phase.STOPPED

    def step(self) -> None:
        now_s = time.monotonic()
        self._pod.step(now_s)
        if self._pod.phase is Phase.RUNNING and not self._ready:
            self._ready = self._probe is None or self._probe.passed(now_s)

    def stop(self, grace_s: float) -> None:
        """Ask all containers to end; called again it shortens the grace period."""
        self._stopped_from_outside = True
        self._pod.stop(time.monotonic(), grace_s)

    @property
    def pids(self) -> list[int]:
        return [process.pid for _, process in self._pod.running]

    def view(self) -> View:
        """How far it is."""
        running = frozenset(container.name for container, _ in self._pod.running)
        if self.stopped:
            outcome = self._pod.outcome
            code = _TERMINATED if outcome is None else outcome.code
            reason = "" if outcome is None else outcome.reason
            phase = "Succeeded" if code == 0 else "Failed"
            return View(phase, restarts=dict(self.restarts), message=reason, code=code)
        begun = self._pod.phase is not Phase.STARTING
        return View(
            phase="Running" if begun else "Pending",
            running=running,
            started=running if begun else frozenset(),
            ready=self._ready and self._pod.phase is Phase.RUNNING,
            restarts=dict(self.restarts),
            message=self._last_words,
        )

    def _sidecar_died(self, container: str, reason: str) -> None:
        self.restarts[container] += 1
        self._last_words = reason
        self._died(container, reason)


def job_of(pod: Manifest) -> Job:
    """A pod as a Job of one try whose sidecars are started again for ever, as a kubelet does.

    Raises:
        UnsupportedManifest: it has something that processes of this computer do not.
    """
    metadata = pod["metadata"]
    # What the API server adds for the token of a service account; no process here asks for one.
    spec = dict(pod["spec"])
    spec["volumes"] = [each for each in spec.get("volumes", ()) if "projected" not in each]
    manifest = {
        "metadata": {"name": metadata["name"], "namespace": metadata["namespace"]},
        "spec": {
            "suspend": False,
            "backoffLimit": _FOR_EVER,
            "template": {"metadata": {"labels": metadata.get("labels", {})}, "spec": spec},
        },
    }
    return parse_job(manifest)


def missing_image(pod: Manifest, missing: Collection[str]) -> tuple[str, str] | None:
    """Why a kubelet would not start the containers of a pod: reason and message."""
    for container in (*pod["spec"].get("initContainers", ()), *pod["spec"]["containers"]):
        image = container["image"]
        if image in missing:
            if container.get("imagePullPolicy") == "Never":
                return "ErrImageNeverPull", f'Container image "{image}" is not present with pull policy of Never'
            return (
                "ImagePullBackOff",
                f'Back-off pulling image "{image}": ErrImagePull: failed to resolve image: not found',
            )
    return None


def _readiness(manifest: Manifest, address: str) -> HttpProbe | None:
    container = manifest["spec"]["containers"][0]
    wanted = container.get("readinessProbe")
    if wanted is None:
        return None
    ports = {port.get("name"): port["containerPort"] for port in container.get("ports", ())}
    get = wanted["httpGet"]
    port = ports[get["port"]] if isinstance(get["port"], str) else get["port"]
    return HttpProbe(address, port, get.get("path", "/"), _PROBE_TIMEOUT_S)
