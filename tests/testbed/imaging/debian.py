"""A Debian to build images on, made on the spot by debootstrap: what `debian:bookworm-slim` is, without a registry."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path

from tests.testbed.errors import BedError

SUITE = "bookworm"
MIRROR = os.environ.get("FLEET_TESTBED_DEBIAN", "http://deb.debian.org/debian")

_OF_THIS_COMPUTER = ("etc/hostname", "etc/resolv.conf", "etc/machine-id", "var/cache/ldconfig/aux-cache")
_FOR_NOBODY = (
    "var/cache/apt", "var/cache/debconf", "var/lib/apt/lists", "var/log", "tmp", "run",
    "usr/share/doc", "usr/share/man", "usr/share/info", "usr/share/locale", "usr/share/lintian",
)  # fmt: skip
"""Folders that are emptied: caches, logs, and what people read."""


def root_file_system(tarball: Path) -> str:
    """Make a tarball of a small Debian unless it is there.

    Returns:
        Digest of the tarball: Debian's packages change with the day on which it was made.
    Raises:
        BedError: debootstrap failed.
    """
    noted = tarball.with_suffix(".sha256")
    if not noted.exists():
        with tempfile.TemporaryDirectory(dir=tarball.parent) as folder:
            root = Path(folder) / "root"
            _bootstrap(root)
            _slim(root)
            _pack(root, tarball)
        with tarball.open("rb") as file:
            noted.write_text(hashlib.file_digest(file, "sha256").hexdigest(), encoding="utf-8")
    return noted.read_text("utf-8")


def _bootstrap(root: Path) -> None:
    command = ["debootstrap", "--variant=minbase", SUITE, str(root), MIRROR]
    done = subprocess.run(command, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise BedError(f"{' '.join(command)} failed:\n" + "\n".join(done.stdout.splitlines()[-20:]))


def _slim(root: Path) -> None:
    for name in _OF_THIS_COMPUTER:
        (root / name).unlink(missing_ok=True)
    for name in _FOR_NOBODY:
        for path in (root / name).iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    (root / "etc/machine-id").touch()
    (root / "var/cache/apt/archives/partial").mkdir(parents=True)  # apt-get expects it


def _pack(root: Path, tarball: Path) -> None:
    """In a fixed order and without times, so that the same packages make the same bytes; without device files."""
    partial = tarball.with_suffix(".partial")
    with tarfile.open(partial, "w") as tar:
        for path in sorted(root.rglob("*")):
            entry = tar.gettarinfo(path, str(path.relative_to(root)))
            if entry is None or entry.ischr() or entry.isblk():
                continue
            entry.mtime, entry.uname, entry.gname = 0, "", ""
            if entry.isreg():
                with path.open("rb") as file:
                    tar.addfile(entry, file)
            else:
                tar.addfile(entry)
    partial.rename(tarball)
