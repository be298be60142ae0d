"""Addresses and volumes of pods."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fleet_operator.local.addresses import Addresses, free_ports
from fleet_operator.local.environment import Place
from fleet_operator.local.volumes import Volumes
from fleet_operator.local.workloads import Job, parse_service
from tests.testbed.stand_in.api import Api, Refused

Manifest = dict[str, Any]


class Places:
    """Loopback addresses of pods and Services, and folders of volumes.

    Args:
        folder: Of the volumes, one folder for each namespace.
    """

    def __init__(self, api: Api, folder: Path) -> None:
        self._api = api
        self._folder = folder
        self._addresses = Addresses(os.getpid())
        self._names: dict[tuple[str, str], str] = {}
        self._volumes: dict[str, Volumes] = {}

    def close(self) -> None:
        self._addresses.close()

    async def volumes_of(self, job: Job) -> Volumes | None:
        """The volumes of a pod's namespace with all ConfigMaps of the pod; None when one is not there."""
        if job.namespace not in self._volumes:  # making one removes what is in its folder
            self._volumes[job.namespace] = Volumes(self._folder / job.namespace)
        volumes = self._volumes[job.namespace]
        for wanted in job.volumes.values():
            if wanted is None:
                continue
            path = f"/api/v1/namespaces/{job.namespace}/configmaps/{wanted.config_map}"
            try:
                volumes.add_config_map(await self._api.call("GET", path))
            except Refused:
                return None
        return volumes

    def take(self, job: Job, number: int, services: Iterable[Manifest], volumes: Volumes, address: str) -> Place:
        """Where a pod is; one behind a Service has the Service's address, so that names never change meaning.

        Args:
            number: Of the pod; no two pods have the same.
            address: One that the pod has already; "" for a new one.
        """
        hosts: dict[str, str] = {}
        for manifest in services:
            metadata, spec = manifest["metadata"], manifest["spec"]
            if metadata["namespace"] != job.namespace or spec.get("clusterIP") != "None" or not spec.get("selector"):
                continue
            service = parse_service(manifest)
            key = (service.namespace, service.name)
            if key not in self._names:
                self._names[key] = self._addresses.take()
            hosts.update(dict.fromkeys(service.hosts, self._names[key]))
            if service.selects(job):
                address = self._names[key]
        return Place(address or self._addresses.take(), hosts, volumes.folders(job, number), _ports(job))

    def is_free(self, place: Place) -> bool:
        """Whether no other pod listens there any more."""
        return free_ports(place.address, sorted(place.ports))

    def give_back(self, place: Place, job: Job, number: int) -> None:
        """The pod has ended."""
        self._volumes[job.namespace].forget(job, number)
        if place.address not in self._names.values():
            self._addresses.give_back(place.address)


def _ports(job: Job) -> frozenset[int]:
    return frozenset(port for each in job.containers for port in each.ports.values())
