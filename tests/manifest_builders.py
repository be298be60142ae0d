"""Small manifests with stand-in programs, in the shape that the compiler gives them."""

from __future__ import annotations

from typing import Any

from fleet_operator.compiler.fleet import priority_classes

Manifest = dict[str, Any]
SERVER = """
import http.server, os
class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        body = os.environ.get("ANSWER", "ok").encode()
        self.send_response(200); self.send_header("Content-Length", str(len(body))); self.end_headers()
        self.wfile.write(body)
    def log_message(self, *arguments): pass
http.server.HTTPServer.address_family = 2
http.server.ThreadingHTTPServer((os.environ["FLEET_BIND"], int(os.environ["FLEET_PORT"])), Handler).serve_forever()
"""


def container(name: str, script: str, port: int | None = None, **environment: str) -> Manifest:
    """A container that runs a Python script."""
    variables = dict(environment)
    result: Manifest = {
        "name": name,
        "image": "stand-in",
        "command": ["python", "-c", script],
        "resources": {"requests": {"cpu": "100m", "memory": "16Mi"}, "limits": {"cpu": "1", "memory": "256Mi"}},
        "volumeMounts": [{"name": "tmp", "mountPath": "/tmp"}],
    }
    if port is not None:
        variables |= {"FLEET_BIND": "0.0.0.0", "FLEET_PORT": str(port)}
        result["ports"] = [{"name": name, "containerPort": port}]
    result["env"] = [{"name": key, "value": value} for key, value in variables.items()]
    return result


def sidecar(name: str, script: str = SERVER, port: int = 8081, **environment: str) -> Manifest:
    """A native sidecar that answers /healthz."""
    result = container(name, script, port, **environment)
    result["restartPolicy"] = "Always"
    result["startupProbe"] = {"httpGet": {"path": "/healthz", "port": name}, "periodSeconds": 1, "failureThreshold": 20}
    return result


def job(
    name: str, main: Manifest, *sidecars: Manifest, level: int = 9, backoff_limit: int = 2, **labels: str
) -> Manifest:
    """A Job of one pod."""
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": name, "namespace": "default", "labels": {}},
        "spec": {
            "suspend": level == 0,
            "backoffLimit": backoff_limit,
            "podFailurePolicy": {
                "rules": [{"action": "FailJob", "onExitCodes": {"operator": "In", "values": [65]}}],
            },
            "template": {
                "metadata": {"labels": {"name": name, **labels}},
                "spec": {
                    "restartPolicy": "Never",
                    "priorityClassName": f"fleet-level-{level}",
                    "terminationGracePeriodSeconds": 5,
                    "initContainers": list(sidecars),
                    "containers": [main],
                    "volumes": [{"name": "tmp", "emptyDir": {}}],
                },
            },
        },
    }


def service(name: str, **selector: str) -> Manifest:
    """A headless Service."""
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": name, "namespace": "default"},
        "spec": {"clusterIP": "None", "selector": selector},
    }


def classes() -> list[Manifest]:
    """The PriorityClasses of all levels."""
    return priority_classes()
