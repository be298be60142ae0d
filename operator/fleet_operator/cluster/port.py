"""What the operator asks of a cluster."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from fleet_operator.resources.refs import Kind, Manifest, ObjectRef
from fleet_operator.resources.views import JobView, NodeView, PodView


class Cluster(Protocol):
    """A Kubernetes cluster: what the watches have seen, and calls that change it.

    Calls raise an error of `fleet_operator.cluster.errors`. What they return was acknowledged; the memory of the
    watches has it at once.
    """

    def fleets(self) -> tuple[ObjectRef, ...]:
        """All FleetSpecs, from memory."""

    def fleet(self, ref: ObjectRef) -> Manifest | None:
        """A FleetSpec with its status, from memory; without managedFields; not to be changed."""

    def jobs(self, ref: ObjectRef) -> tuple[JobView, ...]:
        """The Jobs of a fleet in the order of their names, from memory; those of an earlier FleetSpec of the same
        name too, as long as they are there (`owner_uid`).
        """

    def missions(self, ref: ObjectRef) -> Mapping[int, Manifest]:
        """The Missions of a fleet by number, from memory."""

    def files(self, ref: ObjectRef) -> tuple[Manifest, ...]:
        """The ConfigMaps that carry a fleet's files, in the order of their names, from memory."""

    def nodes(self) -> tuple[NodeView, ...]:
        """The machines in the order of their names, from memory."""

    async def apply(self, manifest: Manifest) -> bool:
        """Have an object as this manifest says: server-side apply, with a hash of the manifest as annotation.

        Returns:
            False when the hash is the one last seen or applied: no call is made. See resources.applied.
        Raises:
            Invalid: the API server refuses the manifest; a field that cannot be changed is one reason.
            Forbidden: by RBAC or by a quota.
        """

    async def apply_status(self, kind: Kind, ref: ObjectRef, status: Manifest) -> bool:
        """Have an object's status as said; False when it was seen to be so: no call is made.

        Raises:
            NotFound: the object is gone.
        """

    async def delete(self, kind: Kind, ref: ObjectRef, uid: str = "") -> None:
        """Delete an object, and in the background what it owns; one that is gone, or has another uid, is fine."""

    async def pods(self, fleet: ObjectRef, job: str = "") -> tuple[PodView, ...]:
        """The Pods of a fleet, or of one of its Jobs, in the order of their names; one call."""

    async def complaints(self, ref: ObjectRef, kind: str) -> tuple[tuple[str, str], ...]:
        """Reason and message of the Warning events about an object, newest first; one call.

        Args:
            kind: As manifests write it: Job, Pod.
        """

    async def resize(self, pod: PodView, container: str, resources: Manifest) -> bool:
        """Change a running container's resources in place; False when the cluster or the node cannot, or it is gone."""

    async def record(self, about: Manifest, kind: str, reason: str, message: str) -> None:
        """Post an Event about an object; the same again counts up. Never raises: an Event is not worth a pass.

        Args:
            about: The object; apiVersion, kind, name, namespace and uid are used.
            kind: Normal or Warning.
        """
