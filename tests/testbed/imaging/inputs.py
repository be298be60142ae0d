"""What each image is made from, the digest of it, and a clean copy of it to build in."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

_SOURCE = ("pyproject.toml", "README.md", "LICENSE", "fleet")
INPUTS = {
    "base": ("containers/base", "containers/tools/compile"),
    "tools": ("containers/tools",),
    "runtime": ("containers/runtime", *_SOURCE),
    "function": ("containers/function", *_SOURCE),
    "operator": ("containers/operator", *_SOURCE, "operator", "examples/crop-scouting"),
    "hdfs": ("containers/hdfs",),
}
"""Files and folders of the repository that the Containerfile of an image copies, and the Containerfile."""

_ENVIRONMENT = {"BASE": "base", "TOOLS": "tools"}
PARENTS: dict[str, dict[str, str]] = {
    "tools": {"BASE": "base"},
    "runtime": _ENVIRONMENT,
    "function": _ENVIRONMENT,
    "operator": _ENVIRONMENT,
}
"""Images of ours that another one needs, by build argument; all others stand on Debian."""

FORMAT = "3"
"""To be raised when images are built or packed in another way."""

_LEFTOVERS = ("__pycache__", "fleet_computer.egg-info")


def _files(inputs: tuple[str, ...], root: Path) -> Iterator[Path]:
    """The files, relative to the repository, in an order that does not depend on the file system."""
    for name in sorted(inputs):
        path = root / name
        found = [path] if path.is_file() else sorted(inner for inner in path.rglob("*") if inner.is_file())
        yield from (file.relative_to(root) for file in found if not set(file.parts) & set(_LEFTOVERS))


def _mode(path: Path) -> int:
    return 0o755 if path.stat().st_mode & 0o100 else 0o644


def digest(name: str, parents: str, root: Path = ROOT) -> str:
    """Digest of all that decides what is in an image.

    Args:
        name: An image.
        parents: Digests of what it is built on and with.
        root: The repository.
    Returns:
        20 hexadecimal digits. Times and owners of files do not count; of their modes only "may be run" does.
    """
    total = hashlib.sha256(f"{FORMAT} {parents}".encode())
    for file in _files(INPUTS[name], root):
        content = hashlib.sha256((root / file).read_bytes()).hexdigest()
        total.update(f"{file} {_mode(root / file):o} {content}\n".encode())
    return total.hexdigest()[:20]


def stage(name: str, folder: Path, root: Path = ROOT) -> None:
    """Copy the inputs of an image into an empty folder, with the same modes whatever the umask was at checkout."""
    shutil.rmtree(folder, ignore_errors=True)
    for file in _files(INPUTS[name], root):
        target = folder / file
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(root / file, target)
        target.chmod(_mode(root / file))
    for directory in [folder, *(path for path in folder.rglob("*") if path.is_dir())]:
        directory.chmod(0o755)
