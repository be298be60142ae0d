"""Builders of containers: environment, command, resources, probes, and the same hardening for all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from fleet.spec.base import Resources, duration_s
from fleet_operator.compiler import defaults
from fleet_operator.compiler.quantities import settled, to_manifest, whole_cores
from fleet_operator.compiler.target import Target, UserFunction
from fleet_operator.compiler.volumes import mounts
from fleet_operator.resources import names

Manifest = dict[str, Any]
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Program:
    """One container of the platform's image.

    Args:
        name: Name of the container.
        command: What it runs.
        resources: Requests and limits, settled.
        environment: Variables beside those that every container gets.
        port: Where it listens, when it does.
        workers: Worker processes among which the CPU limit is divided.
        storage: Whether it reaches the storage; a user's function has no need to.
    """

    name: str
    command: tuple[str, ...]
    resources: Resources
    environment: dict[str, str] = field(default_factory=dict)
    port: int | None = None
    workers: int = 1
    storage: bool = True


def container(target: Target, program: Program) -> Manifest:
    """A container of the platform's image with the user's functions in it."""
    variables = {
        **({"FLEET_STORAGE_URI": target.storage} if program.storage else {}),
        "FLEET_NAMESPACE": target.spec.metadata.namespace,
        "FLEET_NAME": target.spec.name,
        **program.environment,
        **_server_variables(program.port),
        **_process_variables(program.resources, program.workers),
        "PYTHONSAFEPATH": "1",
    }
    if target.bundle:
        variables["PYTHONPATH"] = names.FUNCTIONS_FOLDER
    result: Manifest = {
        "name": program.name,
        "image": target.settings.runtime_image,
        "imagePullPolicy": target.settings.pull_policy,
        "command": list(program.command),
    }
    # Python looks for modules in the folder where it starts: nothing that runs in a pod may write there.
    result["workingDir"] = names.FUNCTIONS_FOLDER if target.bundle else "/"
    result["env"] = _env(variables)
    _finish(result, program.resources, program.port)
    result["volumeMounts"] = mounts(target, program.name, functions=True, storage=program.storage)
    return result


def sidecar(target: Target, function: UserFunction) -> Manifest:
    """Map() or Eval() as a native sidecar: started before the main container, restarted when it dies.

    Source: Kubernetes, "Sidecar Containers": an init container with restartPolicy Always.
    """
    resources = settled(function.spec.resources, defaults.FUNCTION, f"spec.{function.name}.resources")
    if function.spec.image is None:
        served = (*target.settings.serve_command, function.name, str(function.spec.function))
        command = (*served, "--host", "$(FLEET_BIND)", "--port", "$(FLEET_PORT)")
        result = container(target, Program(function.name, command, resources, port=function.port, storage=False))
    else:
        result = _image_container(target, function, resources)
    result["restartPolicy"] = "Always"
    result["startupProbe"] = _probe(function.name, defaults.PROBE_FAILURES)
    result["livenessProbe"] = liveness(function.name, duration_s(function.spec.timeout))
    return result


def readiness(port: str) -> Manifest:
    """A probe that lets a Service send requests to the container."""
    return _probe(port, failures=3)


def liveness(port: str, longest_call_s: float = 0.0) -> Manifest:
    """A probe that ends a server which hangs, so that it is started again.

    Args:
        longest_call_s: A server of one thread answers no probe during a call: it is given the time of one more.
    """
    failures = math.ceil((defaults.HANGS_S + longest_call_s) / defaults.LIVENESS_PERIOD_S)
    return {
        **_probe(port, failures),
        "initialDelaySeconds": defaults.PROBE_FAILURES * defaults.PROBE_PERIOD_S,
        "periodSeconds": defaults.LIVENESS_PERIOD_S,
        "timeoutSeconds": defaults.LIVENESS_TIMEOUT_S,
    }


def resizable(container: Manifest) -> Manifest:
    """The container, whose CPU and memory may change while it runs.

    Source: Kubernetes, "Resize CPU and Memory Resources assigned to Containers".
    """
    policy = [{"resourceName": name, "restartPolicy": "NotRequired"} for name in ("cpu", "memory")]
    return {**container, "resizePolicy": policy}


def _image_container(target: Target, function: UserFunction, resources: Resources) -> Manifest:
    """The user's own image: it is told where to listen, and gets neither storage nor cluster."""
    result: Manifest = {
        "name": function.name,
        "image": function.spec.image,
        "imagePullPolicy": target.settings.pull_policy,
    }
    if function.spec.command:
        result["command"] = list(function.spec.command)
    result["env"] = _env({**_server_variables(function.port), **_process_variables(resources, 1)})
    _finish(result, resources, function.port)
    result["volumeMounts"] = mounts(target, function.name, functions=False, storage=False)
    return result


def _server_variables(port: int | None) -> dict[str, str]:
    return {} if port is None else {"FLEET_BIND": "0.0.0.0", "FLEET_PORT": str(port)}


def _process_variables(resources: Resources, workers: int) -> dict[str, str]:
    """Numeric libraries start as many threads as the machine has cores unless they are told the limit."""
    threads = max(1, whole_cores(resources) // workers)
    return {
        "HOME": names.SCRATCH_FOLDER,
        "PYTHONUNBUFFERED": "1",
        **dict.fromkeys(_THREADS, str(threads)),
    }


def _env(variables: dict[str, str]) -> list[Manifest]:
    return [{"name": name, "value": value} for name, value in sorted(variables.items())]


def _finish(result: Manifest, resources: Resources, port: int | None) -> None:
    if port is not None:
        result["ports"] = [{"name": result["name"], "containerPort": port}]
    result["resources"] = to_manifest(resources)
    result["securityContext"] = {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }


def _probe(port: str, failures: int) -> Manifest:
    return {
        "httpGet": {"path": names.HEALTH_PATH, "port": port},
        "periodSeconds": defaults.PROBE_PERIOD_S,
        "timeoutSeconds": defaults.PROBE_TIMEOUT_S,
        "failureThreshold": failures,
    }
