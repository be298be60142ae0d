"""On what a figure was measured: version and commit of the code, and the machine."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import fleet

ROOT = Path(__file__).resolve().parents[1]
_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "scikit-optimize")


def facts() -> dict[str, str]:
    """Everything that a figure may depend on, by name."""
    return {
        "fleet": fleet.__version__,
        "commit": commit(),
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "processor": processor(),
        "cores": str(os.cpu_count()),
    }


def commit() -> str:
    """The commit that is checked out, with a mark where files differ from it; "unknown" outside of a repository."""
    named = _git("rev-parse", "--short=12", "HEAD")
    if not named:
        return "unknown"
    return f"{named}, changed" if _git("status", "--porcelain", "--untracked-files=no") else named


def processor() -> str:
    """What the system calls it."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _git(*arguments: str) -> str:
    """What git says; "" when it refuses or is not there."""
    try:
        asked = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return ""
    return asked.stdout.strip()
