"""Servers of functions as processes of their own, for tests."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "crop-scouting"


@dataclass(frozen=True)
class Server:
    """A running server."""

    process: subprocess.Popen[str]
    url: str

    @property
    def port(self) -> int:
        return int(self.url.rsplit(":", 1)[1])


@contextlib.contextmanager
def serve_python(kind: str, reference: str, folder: Path, timeout_s: float = 10.0, port: int = 0) -> Iterator[Server]:
    """`serve_function` in a process that finds the user's module in a folder."""
    program = (
        "import sys; from fleet.functions.http_server import serve_function; "
        "serve_function(sys.argv[1], sys.argv[2], '127.0.0.1', int(sys.argv[3]), float(sys.argv[4]))"
    )
    command = [sys.executable, "-c", program, kind, reference, str(port), str(timeout_s)]
    with started(command, {"PYTHONPATH": os.pathsep.join((str(ROOT), str(folder)))}) as server:
        yield server


@contextlib.contextmanager
def started(command: list[str], environment: dict[str, str] | None = None) -> Iterator[Server]:
    """A process that prints `listening on http://...` on stderr once it serves; it is ended with the context."""
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ, **(environment or {})})
    assert process.stderr is not None
    lines: list[str] = []
    url = ""
    for line in process.stderr:
        lines.append(line)
        if found := re.match(r"listening on (http://\S+)", line):
            url = found[1]
            break
    drain = threading.Thread(target=process.stderr.read, daemon=True)
    drain.start()
    try:
        assert url, f"the server did not start: {''.join(lines)}"
        yield Server(process, url)
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        drain.join()
        process.stderr.close()


NODE = shutil.which("node")
