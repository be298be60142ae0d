"""What Kubernetes' words about pods and Jobs mean for a fleet, and which of it lasts.

A trouble lasts when it ends only after somebody has done something. Room, quotas, webhooks, nodes and storage may get
better by themselves; a FleetSpec that is not valid, or an image that is nowhere, does not.
"""

from __future__ import annotations

from fleet.errors import SpecError, StorageError, StorageFull, StorageReadOnly
from fleet_operator.policy.status import Trouble
from fleet_operator.resources.views import PodView

IMAGE_PATIENCE_S = 300.0
"""How long a pod may wait for its image before that counts as lasting: by then kubelets ask every 5 minutes only.

Source: Kubernetes, "Images", ImagePullBackOff."""
_IMAGE = {"ErrImagePull", "ImagePullBackOff", "ErrImageNeverPull", "InvalidImageName", "ImageInspectError"}
_CONFIG = {"CreateContainerConfigError", "CreateContainerError"}
_FAILING = {"CrashLoopBackOff", "RunContainerError"}
_NO_VOLUME = {"FailedMount", "FailedAttachVolume"}
_NOT_YET = "failed to sync configmap cache"
"""A kubelet that has not heard of a ConfigMap yet; it tries again at once, and says another thing if there is none."""
_OF_STORAGE = (
    (StorageFull, "StorageFull"),
    (StorageReadOnly, "StorageReadOnly"),
    (StorageError, "StorageUnavailable"),
    (SpecError, "Invalid"),
)


def of_pod(job: str, pod: PodView, now_s: float) -> Trouble | None:
    """What is wrong with a pod; pods come and go under other names, so it is told of their Job.

    Args:
        job: Name of its Job.
        now_s: Seconds since the Unix epoch.
    """
    about, said = f"the pod of Job {job}", f": {pod.message}" if pod.message else ""
    if pod.waiting in _IMAGE:
        lasting = bool(pod.started_s) and now_s - pod.started_s > IMAGE_PATIENCE_S
        return Trouble("ImageMissing", f"{about} cannot get an image ({pod.waiting}{said})", lasting)
    if pod.waiting in _CONFIG:
        return Trouble("ConfigMissing", f"{about} cannot be set up ({pod.waiting}{said})")
    if pod.waiting in _FAILING or pod.phase == "Failed" or pod.restarts:
        return Trouble("PodFailing", f"{about} fails and is started again{said or '; see its log'}")
    if pod.waiting:
        return Trouble("Unschedulable", f"{about} finds no node{said}")
    return None


def of_pods_complaint(job: str, reason: str, message: str) -> Trouble | None:
    """What an event about a pod means: that a volume cannot be mounted is told by an event only."""
    if reason not in _NO_VOLUME or _NOT_YET in message:
        return None
    return Trouble("ConfigMissing", f"the pod of Job {job} cannot be set up ({reason}: {message})")


def of_jobs_complaint(job: str, reason: str, message: str) -> Trouble | None:
    """What an event about a Job without pods means."""
    if reason != "FailedCreate":
        return None
    kind = "QuotaExceeded" if "exceeded quota" in message else "PodRefused"
    return Trouble(kind, f"Job {job} gets no pod: {message}")


def of_rejection(message: str) -> Trouble:
    """What the API server refuses to the operator itself."""
    return Trouble("QuotaExceeded" if "exceeded quota" in message else "Rejected", message)


def of_storage(error: StorageError | SpecError) -> Trouble:
    """A storage that refuses; an address that leads nowhere is the FleetSpec's fault, or the installation's."""
    reason = next(word for kind, word in _OF_STORAGE if isinstance(error, kind))
    return Trouble(reason, str(error))


def of_agents(number: int, failures: dict[str, str]) -> Trouble:
    """Agents that a mission goes on without, and why."""
    told = "; ".join(f"{agent} failed: {message}" for agent, message in sorted(failures.items()))
    return Trouble("AgentFailed", f"mission {number}: {told}")


def of_aggregator(number: int, subset: str, message: str) -> Trouble:
    """An aggregator that a mission goes on without, and why."""
    return Trouble("AggregatorFailed", f"mission {number}: the aggregator of {subset} failed: {message}")
