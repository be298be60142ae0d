"""Compiled manifests as typed values: the part of Kubernetes' objects that a machine can run.

Everything that the compiler writes is read here. A manifest with something else in it is refused: a part that is
silently left out would be true only in the cluster.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fleet.errors import ExitCode, FleetError
from fleet.spec.base import quantity_value

Manifest = Mapping[str, Any]


class UnsupportedManifest(FleetError):
    """A manifest asks for something that the local runner does not have."""

    exit_code = ExitCode.USAGE


@dataclass(frozen=True)
class Probe:
    """An HTTP GET that says whether a container has started."""

    path: str
    port: int
    timeout_s: float


@dataclass(frozen=True)
class Container:
    """One process of a pod.

    Args:
        mounts: Volume by mount path.
        ports: Port numbers by name.
        cpu_cores, memory_bytes: Requests.
        memory_limit_bytes: Above this it is killed.
        probe: What must answer before the main container starts; sidecars only.
    """

    name: str
    image: str
    command: tuple[str, ...]
    working_folder: str
    environment: Mapping[str, str]
    mounts: Mapping[str, str]
    ports: Mapping[str, int]
    cpu_cores: float
    memory_bytes: float
    memory_limit_bytes: float
    probe: Probe | None = None


@dataclass(frozen=True)
class ConfigMapVolume:
    """A volume with the entries of a ConfigMap as files: path by key."""

    config_map: str
    paths: Mapping[str, str]


@dataclass(frozen=True)
class Job:
    """A Job of one pod.

    Args:
        priority_class: Name of its PriorityClass.
        permanent_codes: Exit codes of the main container that end the Job at once.
        volumes: A ConfigMap's files by volume; None is an empty folder.
    """

    name: str
    namespace: str
    labels: Mapping[str, str]
    suspended: bool
    backoff_limit: int
    permanent_codes: frozenset[int]
    priority_class: str
    grace_s: float
    main: Container
    sidecars: tuple[Container, ...]
    volumes: Mapping[str, ConfigMapVolume | None]

    @property
    def containers(self) -> tuple[Container, ...]:
        """Sidecars, then the main container."""
        return (*self.sidecars, self.main)

    @property
    def cpu_cores(self) -> float:
        """What all containers request together."""
        return sum(container.cpu_cores for container in self.containers)

    @property
    def memory_bytes(self) -> float:
        """What all containers request together."""
        return sum(container.memory_bytes for container in self.containers)


@dataclass(frozen=True)
class Service:
    """A headless Service: a name for the pods that a selector matches."""

    name: str
    namespace: str
    selector: Mapping[str, str]

    @property
    def hosts(self) -> tuple[str, ...]:
        """Every name that the cluster's DNS gives it, the longest first."""
        qualified = f"{self.name}.{self.namespace}"
        return (f"{qualified}.svc.cluster.local", f"{qualified}.svc", qualified, self.name)

    def selects(self, job: Job) -> bool:
        """Whether the pods of a Job are behind this name."""
        same_namespace = job.namespace == self.namespace
        return same_namespace and all(job.labels.get(key) == value for key, value in self.selector.items())


def parse_job(manifest: Manifest) -> Job:
    """Read a Job.

    Raises:
        UnsupportedManifest: it has more than one main container, an init container that ends, or another volume.
    """
    name, spec = manifest["metadata"]["name"], manifest["spec"]
    pod = spec["template"]["spec"]
    if len(pod["containers"]) != 1 or pod["restartPolicy"] != "Never":
        raise UnsupportedManifest(f"Job {name}: one container and restartPolicy Never are supported")
    if any(each.get("restartPolicy") != "Always" for each in pod.get("initContainers", ())):
        raise UnsupportedManifest(f"Job {name}: of init containers, only native sidecars are supported")
    return Job(
        name=name,
        namespace=manifest["metadata"]["namespace"],
        labels=spec["template"]["metadata"]["labels"],
        suspended=spec["suspend"],
        backoff_limit=spec["backoffLimit"],
        permanent_codes=_permanent_codes(spec),
        priority_class=pod["priorityClassName"],
        grace_s=pod["terminationGracePeriodSeconds"],
        main=_container(pod["containers"][0]),
        sidecars=tuple(_container(each) for each in pod.get("initContainers", ())),
        volumes={each["name"]: _volume(name, each) for each in pod.get("volumes", ())},
    )


def parse_service(manifest: Manifest) -> Service:
    """Read a headless Service.

    Raises:
        UnsupportedManifest: it has an address of its own.
    """
    name = manifest["metadata"]["name"]
    if manifest["spec"]["clusterIP"] != "None":
        raise UnsupportedManifest(f"Service {name}: only headless Services are supported")
    return Service(name, manifest["metadata"]["namespace"], manifest["spec"]["selector"])


def _permanent_codes(spec: Manifest) -> frozenset[int]:
    rules = spec.get("podFailurePolicy", {}).get("rules", ())
    found = [rule["onExitCodes"]["values"] for rule in rules if rule["action"] == "FailJob"]
    return frozenset(code for codes in found for code in codes)


def _container(manifest: Manifest) -> Container:
    ports = {port["name"]: port["containerPort"] for port in manifest.get("ports", ())}
    requests, limits = manifest["resources"]["requests"], manifest["resources"]["limits"]
    return Container(
        name=manifest["name"],
        image=manifest["image"],
        command=tuple(manifest.get("command", ())),
        working_folder=manifest.get("workingDir", ""),
        environment={each["name"]: each["value"] for each in manifest.get("env", ())},
        mounts={each["mountPath"]: each["name"] for each in manifest.get("volumeMounts", ())},
        ports=ports,
        cpu_cores=quantity_value(requests["cpu"]),
        memory_bytes=quantity_value(requests["memory"]),
        memory_limit_bytes=quantity_value(limits["memory"]),
        probe=_probe(manifest.get("startupProbe"), ports),
    )


def _probe(manifest: Manifest | None, ports: Mapping[str, int]) -> Probe | None:
    if manifest is None:
        return None
    get = manifest["httpGet"]
    return Probe(get["path"], ports[get["port"]], manifest["failureThreshold"] * manifest["periodSeconds"])


def _volume(job: str, manifest: Manifest) -> ConfigMapVolume | None:
    if "emptyDir" in manifest:
        return None
    if "configMap" in manifest:
        source = manifest["configMap"]
        return ConfigMapVolume(source["name"], {each["key"]: each["path"] for each in source["items"]})
    raise UnsupportedManifest(f"Job {job}: volume {manifest['name']} is neither an emptyDir nor a ConfigMap")
