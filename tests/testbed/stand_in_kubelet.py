"""Stand-in kubelets for a control plane without machines: pods become processes of this computer.

    with stand_in_kubelet(cluster.kubeconfig, folder / "kubelet") as nodes:
        ...

It registers fake Nodes, binds pending pods (highest priority first, where they fit), runs them (native sidecars,
startup and readiness probes, ConfigMaps, names of headless Services as loopback addresses 127.x.y.z) and reports their
status, so that the real Job controller completes or fails their Jobs. With roles "stand-in" the platform's programs are
those of `tests/stand_in_roles.py`, started by fork in milliseconds; with "real" they are `python -m fleet.runtime`.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tests.testbed.processes import Program
from tests.testbed.stand_in.node import Shape
from tests.testbed.stand_in.orders import give

ROOT = Path(__file__).resolve().parent.parent.parent
HUB_AND_EDGES = (Shape("hub", "hub"), Shape("edge1"), Shape("edge2"))


@dataclass
class StandInKubelet:
    """A running stand-in, in a process of its own.

    Args:
        folder: `logs/NAMESPACE/JOB/CONTAINER.log`, and `journal.jsonl`.
    """

    folder: Path
    program: Program
    missing_images: set[str] = field(default_factory=set)
    dark_nodes: set[str] = field(default_factory=set)
    _lines: dict[str, list[dict[str, Any]]] = field(default_factory=lambda: defaultdict(list))
    _read: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def journal(self, namespace: str = "", event: str = "") -> list[dict[str, Any]]:
        """Starts and ends of pods, in their order: event (started, restarted, ended), job, pod, labels, code."""
        with self._lock:
            self._read_journal()
            wanted = self._lines[namespace] if namespace else [each for all_ in self._lines.values() for each in all_]
            found = list(wanted)
        return [each for each in found if not event or each["event"] == event]

    def _read_journal(self) -> None:
        """Take in what is new since the last time."""
        with (self.folder / "journal.jsonl").open() as file:
            file.seek(self._read)
            for line in file:
                if not line.endswith("\n"):
                    break
                self._read += len(line.encode())
                content = json.loads(line)
                self._lines[content["namespace"]].append(content)

    def lose_image(self, image: str) -> None:
        """Pods with this image wait as if no node had it, and no registry."""
        self._tell(self.missing_images.add, image)

    def load_image(self, image: str) -> None:
        """The image is there again."""
        self._tell(self.missing_images.discard, image)

    def power_off(self, node: str) -> None:
        """The processes of a node end, and it says nothing more."""
        self._tell(self.dark_nodes.add, node)

    def power_on(self, node: str) -> None:
        """The node is there again."""
        self._tell(self.dark_nodes.discard, node)

    def _tell(self, change: Callable[[str], None], name: str) -> None:
        with self._lock:
            change(name)
            give(self.folder / "orders.json", self.missing_images, self.dark_nodes)


@contextmanager
def stand_in_kubelet(
    kubeconfig: Path,
    folder: Path,
    *,
    roles: str = "stand-in",
    nodes: Sequence[Shape] = HUB_AND_EDGES,
    replace: Mapping[str, str] | None = None,
) -> Iterator[StandInKubelet]:
    """Run fake nodes until the end of the `with`.

    Args:
        roles: "stand-in" or "real"; pods whose image is `real/...` have the real ones in any case.
        replace: Texts that are replaced in the values of the containers' variables: the address of a storage that
            the operator is to reach by a proxy, for instance.
    """
    folder.mkdir(parents=True, exist_ok=True)
    settings = folder / "settings.json"
    settings.write_text(
        json.dumps({"roles": roles, "nodes": [asdict(each) for each in nodes], "replace": dict(replace or {})})
    )
    path = os.pathsep.join([str(ROOT), str(ROOT / "operator")])
    command = [sys.executable, "-m", "tests.testbed.stand_in_kubelet", str(kubeconfig), str(folder)]
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    program = Program(command, folder / "kubelet.log", {"PYTHONPATH": path, **one_thread})
    ready = folder / "ready"
    ready.unlink(missing_ok=True)
    program.start()
    try:
        program.wait_ready(ready.exists)
        yield StandInKubelet(folder, program)
    finally:
        program.stop()


async def _run(kubeconfig: Path, folder: Path, settings: Mapping[str, Any]) -> None:
    from tests.testbed.stand_in.api import Api  # noqa: PLC0415 - only the stand-in's own process needs these
    from tests.testbed.stand_in.forks import Nurseries  # noqa: PLC0415
    from tests.testbed.stand_in.kubelet import Kubelet  # noqa: PLC0415

    task = asyncio.current_task()
    if task is not None:
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    async with Api(kubeconfig) as api:
        shapes = [Shape(**each) for each in settings["nodes"]]
        kubelet = Kubelet(api, Nurseries(settings["roles"]), folder, shapes, settings["replace"])
        try:
            await kubelet.run()
        finally:
            kubelet.close()


def main() -> None:
    """Be the stand-in: `python -m tests.testbed.stand_in_kubelet KUBECONFIG FOLDER`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("kubeconfig", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    settings = json.loads((given.folder / "settings.json").read_text())
    with contextlib.suppress(asyncio.CancelledError, KeyboardInterrupt):
        asyncio.run(_run(given.kubeconfig, given.folder, settings))


if __name__ == "__main__":
    main()
