"""The operator as a process of its own."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import httpx

from tests.crash.world import Slot, World
from tests.testbed.ports import Ports
from tests.testbed.processes import Program

ROOT = Path(__file__).resolve().parent.parent.parent


class Operator:
    """`python -m fleet_operator` for the fleets of one namespace.

    Args:
        image: Of the pods.
        pod: What a lease knows it by; a container that is started again in its pod is the same.
        environment: More variables.
    """

    def __init__(
        self,
        world: World,
        slot: Slot,
        namespace: str,
        image: str,
        pod: str = "operator-0",
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._ports = Ports()
        self._ready_since_s = 0.0
        self.health_port = self._ports.take()
        self.log = world.folder / f"{pod}-{namespace}.log"
        self._program = Program([sys.executable, "-m", "fleet_operator"], self.log, {
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "operator")]),
            "KUBECONFIG": str(slot.kubeconfig),
            "FLEET_OPERATOR_IDENTITY": pod,
            "FLEET_OPERATOR_RUNTIME_IMAGE": image,
            "FLEET_OPERATOR_STORAGE_URI": world.storage_uri(f"127.0.0.1:{slot.storage.port}", namespace),
            "FLEET_OPERATOR_NAMESPACE": namespace,
            "FLEET_OPERATOR_WATCH_NAMESPACES": namespace,
            "FLEET_OPERATOR_LIBRARY": str(world.library),
            "FLEET_OPERATOR_HEALTH_PORT": str(self.health_port),
            **(environment or {}),
        })  # fmt: skip

    @property
    def running(self) -> bool:
        return self._program.running

    @property
    def pid(self) -> int:
        return self._program.pid

    def start(self) -> None:
        self._ready_since_s = 0.0
        self._program.start()

    def is_ready_for(self, seconds: float) -> bool:
        """Whether it has said for so long that it is ready."""
        if not self.running or not self._says_ready():
            self._ready_since_s = 0.0
            return False
        self._ready_since_s = self._ready_since_s or time.monotonic()
        return time.monotonic() - self._ready_since_s >= seconds

    def _says_ready(self) -> bool:
        try:
            answer = httpx.get(f"http://127.0.0.1:{self.health_port}/readyz", trust_env=False, timeout=2)
        except httpx.TransportError:
            return False
        return answer.status_code == 200

    def stop(self) -> None:
        """As Kubernetes stops a pod."""
        self._program.stop(timeout_s=15)

    def kill(self) -> None:
        """SIGKILL; may be called from any thread, and does not wait."""
        if self._program.pid:
            os.kill(self._program.pid, signal.SIGKILL)

    def freeze(self) -> None:
        """Let it do nothing, as on a machine that hangs."""
        self._program.signal(signal.SIGSTOP)

    def thaw(self) -> None:
        """Let it go on."""
        self._program.signal(signal.SIGCONT)

    def close(self) -> None:
        self._program.kill()
        self._ports.close()

    def last_words(self) -> str:
        """The end of its log."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-60:]) if self.log.exists() else ""
