"""Writes the requirements.txt of each image: what its requirements.in needs, with the versions of constraints.txt.

Run it with Python 3.11, the version in the images, after a change of constraints.txt or of a requirements.in:

    python containers/lock.py
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
CONSTRAINTS = HERE.parent / "constraints.txt"
PYTHON = "3.11"
MACHINES = ("x86_64", "aarch64")
GLIBC = range(17, 37)
"""Minor versions of the C library that wheels may ask for: manylinux2014 up to Debian 12's own."""
HEADER = "# Written by `python containers/lock.py` from requirements.in and constraints.txt. Do not edit.\n"


def _report(*arguments: str) -> list[dict[str, Any]]:
    """What pip would install; it downloads little more than metadata."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-"]
    done = subprocess.run([*command, *arguments], check=True, capture_output=True, text=True)
    return list(json.loads(done.stdout)["install"])


def _pin(item: dict[str, Any]) -> str:
    return f"{item['metadata']['name'].lower().replace('_', '-')}=={item['metadata']['version']}"


def _sha256(item: dict[str, Any]) -> str:
    return str(item["download_info"]["archive_info"]["hashes"]["sha256"])


def _platform(machine: str) -> list[str]:
    names = [f"manylinux_2_{minor}_{machine}" for minor in reversed(GLIBC)] + [f"manylinux2014_{machine}"]
    return [word for name in names for word in ("--platform", name)]


def locked(wanted: Path) -> str:
    """Text of a requirements file with every version and every hash.

    Args:
        wanted: A requirements.in.
    Returns:
        One line a package, with the hashes of its files for each machine in `MACHINES`.
    """
    pins = sorted(_pin(item) for item in _report("-r", str(wanted), "-c", str(CONSTRAINTS)))
    hashes: dict[str, set[str]] = {pin: set() for pin in pins}
    with tempfile.TemporaryDirectory() as nowhere:  # pip wants a target for the files of another machine
        for machine in MACHINES:
            options = ["--no-deps", "--target", nowhere, "--implementation", "cp", "--python-version", PYTHON]
            for item in _report(*options, *_platform(machine), *pins):
                hashes[_pin(item)].add(_sha256(item))
    lines = (" \\\n".join((pin, *(f"    --hash=sha256:{value}" for value in sorted(hashes[pin])))) for pin in pins)
    return HEADER + "\n".join(lines) + "\n"


def main() -> None:
    """Write all of them."""
    for wanted in sorted(HERE.glob("*/requirements.in")):
        wanted.with_suffix(".txt").write_text(locked(wanted), encoding="utf-8")


if __name__ == "__main__":
    main()
