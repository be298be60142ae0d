"""Volumes on demand, as a cluster's storage class makes them: a folder on the disk of the node that the pod got."""

from __future__ import annotations

import shutil
import threading
from http import HTTPStatus
from pathlib import Path
from typing import Any

from tests.testbed.api import Api

CLASS = "local"
PROVISIONER = "testbed.fleetcomputer.io/local"
PROVISIONED_BY = "pv.kubernetes.io/provisioned-by"
NODE = "volume.kubernetes.io/selected-node"
# In a machine; it survives a power cut.
SEEN = Path("/var/lib/fleet-volumes")
PERIOD_S = 0.5
Object = dict[str, Any]


class Volumes:
    """Makes a volume for each claim of the class that has a node, and removes it when the claim is gone."""

    def __init__(self, api: Api, folder: Path) -> None:
        self._api = api
        self._folder = folder
        self._stop = threading.Event()
        self._has_class = False

    def start(self) -> None:
        """Look after claims in a thread of its own until the process ends."""
        threading.Thread(target=self._run, name="volumes", daemon=True).start()

    def _run(self) -> None:
        while not self._stop.wait(PERIOD_S):
            try:
                self.step()
            except OSError:  # the hub is off or boots: whatever is missing is seen at the next look
                continue

    def step(self) -> None:
        """Bring the volumes up to date with the claims that are there now.

        Raises:
            OSError: the API server is not there.
        """
        if not self._has_class:
            status, _ = self._api.call("POST", "/apis/storage.k8s.io/v1/storageclasses", storage_class())
            self._has_class = status in {HTTPStatus.CREATED, HTTPStatus.CONFLICT}
        status, claims = self._api.call("GET", "/api/v1/persistentvolumeclaims")
        if status != HTTPStatus.OK:
            return
        for claim in claims["items"]:
            if _is_ours(claim):
                self._make(claim)
        _, volumes = self._api.call("GET", "/api/v1/persistentvolumes")
        for volume in volumes["items"]:
            if _is_over(volume):
                self._remove(volume)

    def stop(self) -> None:
        """Make nothing more."""
        self._stop.set()

    def _make(self, claim: Object) -> None:
        volume = volume_of(claim)
        path = self._place(volume)
        path.mkdir(parents=True, exist_ok=True)
        path.chmod(0o777)  # as local-path provisioners do: pods have users of their own
        self._api.call("POST", "/api/v1/persistentvolumes", volume)

    def _remove(self, volume: Object) -> None:
        self._api.call("DELETE", f"/api/v1/persistentvolumes/{volume['metadata']['name']}")
        shutil.rmtree(self._place(volume), ignore_errors=True)

    def _place(self, volume: Object) -> Path:
        """Where this computer sees the folder of a volume."""
        terms = volume["spec"]["nodeAffinity"]["required"]["nodeSelectorTerms"]
        node: str = terms[0]["matchExpressions"][0]["values"][0]
        return self._folder / node / "disk/lib" / SEEN.name / str(volume["metadata"]["name"])


def storage_class() -> Object:
    """The default class: a volume is made where the scheduler puts the pod."""
    return {
        "apiVersion": "storage.k8s.io/v1",
        "kind": "StorageClass",
        "metadata": {"name": CLASS, "annotations": {"storageclass.kubernetes.io/is-default-class": "true"}},
        "provisioner": PROVISIONER,
        "volumeBindingMode": "WaitForFirstConsumer",
        "reclaimPolicy": "Delete",
    }


def volume_of(claim: Object) -> Object:
    """The volume that a claim gets; its name says for which claim, so that there is never a second one."""
    meta, spec = claim["metadata"], claim["spec"]
    name = f"pvc-{meta['uid']}"
    on_node = {"key": "kubernetes.io/hostname", "operator": "In", "values": [meta["annotations"][NODE]]}
    reference = {"apiVersion": "v1", "kind": "PersistentVolumeClaim"}
    reference |= {key: meta[key] for key in ("namespace", "name", "uid")}
    return {
        "apiVersion": "v1",
        "kind": "PersistentVolume",
        "metadata": {"name": name, "annotations": {PROVISIONED_BY: PROVISIONER}},
        "spec": {
            "storageClassName": CLASS,
            "capacity": {"storage": spec["resources"]["requests"]["storage"]},
            "accessModes": spec["accessModes"],
            "volumeMode": "Filesystem",
            "persistentVolumeReclaimPolicy": "Delete",
            "local": {"path": str(SEEN / name)},
            "nodeAffinity": {"required": {"nodeSelectorTerms": [{"matchExpressions": [on_node]}]}},
            "claimRef": reference,
        },
    }


def _is_ours(claim: Object) -> bool:
    """Whether a claim waits for us: the scheduler has chosen a node, and no volume is bound."""
    spec = claim["spec"]
    chosen = NODE in claim["metadata"].get("annotations", {})
    return bool(spec.get("storageClassName") == CLASS and chosen and not spec.get("volumeName"))


def _is_over(volume: Object) -> bool:
    ours = volume["metadata"].get("annotations", {}).get(PROVISIONED_BY) == PROVISIONER
    deletes = volume["spec"]["persistentVolumeReclaimPolicy"] == "Delete"
    return bool(ours and deletes and volume["status"].get("phase") == "Released")
