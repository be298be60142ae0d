"""What names an object of the cluster: its kind, namespace and name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fleet.spec.base import API_VERSION

Manifest = dict[str, Any]


@dataclass(frozen=True, order=True, slots=True)
class ObjectRef:
    """An object of a known kind; the namespace is "" when the kind has none."""

    namespace: str
    name: str

    def __str__(self) -> str:
        return f"{self.namespace}/{self.name}" if self.namespace else self.name

    @staticmethod
    def of(body: Mapping[str, Any]) -> ObjectRef:
        """The reference of an object."""
        metadata = body["metadata"]
        return ObjectRef(metadata.get("namespace", ""), metadata["name"])


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of the Kubernetes API.

    Args:
        api_version: `group/version`, or `v1` for the core group.
        kind: As manifests write it.
        plural: As addresses write it.
        namespaced: Whether its objects live in a namespace.
    """

    api_version: str
    kind: str
    plural: str
    namespaced: bool = True

    def path(self, namespace: str = "", name: str = "") -> str:
        """Address in the REST API: of one object, of a namespace's, or of all.

        Source: Kubernetes, "API Concepts", Resource URIs.
        """
        root = "apis" if "/" in self.api_version else "api"
        scope = f"/namespaces/{namespace}" if self.namespaced and namespace else ""
        return f"/{root}/{self.api_version}{scope}/{self.plural}" + (f"/{name}" if name else "")


FLEET_SPEC = Kind(API_VERSION, "FleetSpec", "fleetspecs")
MISSION = Kind(API_VERSION, "Mission", "missions")
EDGE_NODE = Kind(API_VERSION, "EdgeNode", "edgenodes", namespaced=False)
JOB = Kind("batch/v1", "Job", "jobs")
POD = Kind("v1", "Pod", "pods")
NODE = Kind("v1", "Node", "nodes", namespaced=False)
SERVICE = Kind("v1", "Service", "services")
CONFIG_MAP = Kind("v1", "ConfigMap", "configmaps")
EVENT = Kind("v1", "Event", "events")
NETWORK_POLICY = Kind("networking.k8s.io/v1", "NetworkPolicy", "networkpolicies")
LEASE = Kind("coordination.k8s.io/v1", "Lease", "leases")
PRIORITY_CLASS = Kind("scheduling.k8s.io/v1", "PriorityClass", "priorityclasses", namespaced=False)

_KINDS = {
    (kind.api_version, kind.kind): kind
    for kind in (
        FLEET_SPEC, MISSION, EDGE_NODE, JOB, POD, NODE, SERVICE, CONFIG_MAP, EVENT, NETWORK_POLICY, LEASE,
        PRIORITY_CLASS,
    )
}  # fmt: skip


def kind_of(manifest: Mapping[str, Any]) -> Kind:
    """The kind that a manifest says it is of.

    Raises:
        LookupError: the operator does not know this kind.
    """
    try:
        return _KINDS[manifest["apiVersion"], manifest["kind"]]
    except KeyError as error:
        said = f"{manifest.get('apiVersion')} {manifest.get('kind')}"
        raise LookupError(f"{said} is not a kind that the operator knows") from error
