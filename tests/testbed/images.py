"""The container images of the Fleet Computer, built from containers/ without a registry and kept by their content.

python -m tests.testbed.images [NAME ...]
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fleet import __version__
from tests.testbed.errors import BedError, Missing
from tests.testbed.imaging import debian
from tests.testbed.imaging.buildah import Buildah
from tests.testbed.imaging.inputs import PARENTS, ROOT, digest, stage
from tests.testbed.imaging.secrets import build_secrets

NAMES = ("base", "runtime", "function", "operator", "hdfs")

PODS = ("operator", "runtime", "hdfs")
"""Those that run in a cluster; the others are what images are built on."""

REGISTRY = "docker.io"
"""The registry that a kubelet takes for meant when a name has none; nothing is ever fetched from it."""

_DEBIAN = "localhost/debian:bookworm"
_PACKAGES = {"buildah": "buildah", "debootstrap": "debootstrap"}
"""Programs that building needs, and the Debian packages that they are in."""


def cache_folder() -> Path:
    """Where images are kept between runs."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "fleet-computer" / "images"


def reference(name: str) -> str:
    """What an image is called in a cluster: `fleet-computer/runtime` in a manifest means this."""
    return f"{REGISTRY}/fleet-computer/{name}:{__version__}"


def image(name: str) -> Path:
    """An image as an OCI archive for `ctr -n k8s.io images import`; built if its inputs have changed.

    Args:
        name: One of `NAMES`.
    Raises:
        Missing: this computer cannot build images; the text says what to do.
        BedError: the build failed.
    """
    return ensure_images(name)[name]


def ensure_images(*names: str, root: Path = ROOT) -> dict[str, Path]:
    """Build what has changed of these images, or of all; one process at a time.

    Args:
        names: Some of `NAMES`; none means all.
        root: The repository.
    Returns:
        An OCI archive for each name.
    Raises:
        Missing: this computer cannot build images; the text says what to do.
        BedError: a build failed.
    """
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    with _alone(folder / "lock"):
        builder = _Builder(folder, root)
        return {name: builder.archive(name) for name in names or NAMES}


class _Builder:
    """Builds an image after the one that it stands on."""

    def __init__(self, folder: Path, root: Path) -> None:
        self._folder, self._root = folder, root

    def archive(self, name: str) -> Path:
        if not (self._folder / "debian.sha256").exists():
            _prepare_computer()
        path = self._folder / f"{name}-{self._digest(name)}.tar"
        if not path.exists():
            _prepare_computer()
            store = Buildah(self._folder / "store")
            store.write(self._built(store, name), reference(name), path)
            for old in sorted(self._folder.glob(f"{name}-*.tar"), key=lambda file: file.stat().st_mtime)[:-2]:
                old.unlink()  # one older version stays: of the branch that someone has just come from
        return path

    def _digest(self, name: str) -> str:
        parents = [self._digest(parent) for parent in PARENTS.get(name, {}).values()]
        below = "".join(parents) or debian.root_file_system(self._folder / "debian.tar")
        return digest(name, below, self._root)

    def _built(self, store: Buildah, name: str) -> str:
        """Name in the store; it has the digest, so that a name never means two things."""
        repository, version = f"localhost/fleet-computer/{name}", self._digest(name)
        tag = f"{repository}:{version}"
        if store.has(tag):
            return tag
        arguments = {key: self._built(store, parent) for key, parent in PARENTS.get(name, {}).items()}
        context = self._folder / "store" / f"context-{name}"
        stage(name, context, self._root)
        with build_secrets() as secrets:
            store.build(
                tag, context, f"containers/{name}/Containerfile", arguments or {"BASE": self._debian(store)}, secrets
            )
        shutil.rmtree(context)
        store.keep_only(repository, version)
        return tag

    def _debian(self, store: Buildah) -> str:
        tag = f"{_DEBIAN}-{debian.root_file_system(self._folder / 'debian.tar')[:20]}"
        if not store.has(tag):
            store.take_in(self._folder / "debian.tar", tag)
        return tag


def _prepare_computer() -> None:
    """Install what building needs, if that is possible."""
    if os.geteuid() != 0:
        raise Missing("building images needs root: run as root, or copy the images' cache from where they were built")
    missing = [package for program, package in _PACKAGES.items() if shutil.which(program) is None]
    if not missing:
        return
    if shutil.which("apt-get") is None:
        raise Missing(f"building images needs {' and '.join(missing)}: install them")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for command in (["update", "-qq"], ["install", "-y", "-qq", "--no-install-recommends", *missing]):
        done = subprocess.run(["apt-get", *command], check=False, capture_output=True, text=True, env=environment)
        if done.returncode:
            raise Missing(f"{' and '.join(missing)} cannot be installed: {done.stderr.strip()[-500:]}")


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Hold a file's lock: the workers of a parallel test run share the cache."""
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def main(names: list[str]) -> int:
    """Build images and say where they are, how large, and how long it took."""
    unknown = sorted(set(names) - set(NAMES))
    if unknown:
        sys.stderr.write(f"no such image: {', '.join(unknown)}; there are {', '.join(NAMES)}\n")
        return 64
    for name in names or NAMES:
        start = time.monotonic()
        try:
            path = image(name)
        except BedError as error:
            sys.stderr.write(f"{error}\n")
            return 1
        size, seconds = path.stat().st_size / 1e6, time.monotonic() - start
        sys.stdout.write(f"{reference(name)}\t{size:.0f} MB\t{seconds:.1f} s\t{path}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
