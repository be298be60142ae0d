"""The container images of the Fleet Computer, built from containers/ without a registry and kept by their content.

python -m tests.testbed.images [NAME ...]
"""

from __future__ import annotations

import fcntl
import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from fleet import __version__
from tests.testbed import packages
from tests.testbed.errors import BedError, Missing
from tests.testbed.imaging import debian
from tests.testbed.imaging.buildah import Buildah, Recipe
from tests.testbed.imaging.container import Container, container
from tests.testbed.imaging.inputs import PARENTS, ROOT, digest, stage
from tests.testbed.imaging.secrets import build_secrets
from tests.testbed.progress import say

NAMES = ("base", "runtime", "function", "operator", "hdfs")

PODS = ("operator", "runtime", "hdfs")
"""Those that run in a cluster; the others are what images are built on."""

REGISTRY = "docker.io"
"""The registry that a kubelet takes for meant when a name has none; nothing is ever fetched from it."""

_DEBIAN = "localhost/debian:bookworm"
_PACKAGES = {
    "buildah": "buildah",
    "debootstrap": "debootstrap",
    "debian-archive-keyring": "/usr/share/keyrings/debian-archive-keyring.gpg",
}
"""Debian packages that building needs, and how to know that they are there."""


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
    with _builder(root) as builder:
        return {name: builder.archive(name) for name in names or NAMES}


@contextmanager
def image_container(name: str, mounts: Mapping[str, Path] | None = None) -> Iterator[Container]:
    """A container of an image on this computer, without a cluster; for tests of what is in an image.

    Args:
        name: One of `NAMES`.
        mounts: Folders of this computer, by the path where the container's programs see them.
    Raises:
        Missing: this computer cannot build images; the text says what to do.
        BedError: the build failed.
    """
    with _builder(ROOT) as builder:
        _prepare_computer()
        tag = builder.built(name)
    with container(builder.store, tag, mounts) as running:
        yield running


def build_twice(name: str, second: Path) -> Path:
    """Build an image, and then once more without any layer of the first time.

    Args:
        name: One of `NAMES`.
        second: Where the second one goes, as an OCI archive.
    Returns:
        The first one.
    """
    tag = f"localhost/fleet-computer/again:{name}"
    with _builder(ROOT) as builder:  # one, so that both have the same inputs while somebody is editing them
        first = builder.archive(name)
        builder.build(name, tag, fresh=True)
        builder.store.write(tag, reference(name), second)
        builder.store.run("rmi", tag)
    return first


@contextmanager
def _builder(root: Path) -> Iterator[_Builder]:
    """The only builder that works on the cache: workers of a parallel test run share it."""
    folder = cache_folder()
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield _Builder(folder, root)


class _Builder:
    """Builds an image after those that it needs."""

    def __init__(self, folder: Path, root: Path) -> None:
        self._folder, self._root = folder, root
        self._digests: dict[str, str] = {}
        self.store = Buildah(folder / "store")

    def archive(self, name: str) -> Path:
        if not (self._folder / "debian.sha256").exists():
            _prepare_computer()
        path = self._folder / f"{name}-{self._digest(name)}.tar"
        if not path.exists():
            _prepare_computer()
            self.store.write(self.built(name), reference(name), path)
            for old in sorted(self._folder.glob(f"{name}-*.tar"), key=lambda file: file.stat().st_mtime)[:-2]:
                old.unlink()  # one older version stays: of the branch that someone has just come from
        return path

    def _digest(self, name: str) -> str:
        """Digest of an image's inputs, of which a copy is kept: somebody may be editing them."""
        if name not in self._digests:
            parents = [self._digest(parent) for parent in PARENTS.get(name, {}).values()]
            below = "".join(parents) or debian.root_file_system(self._folder / "debian.tar")
            stage(name, self._context(name), self._root)
            self._digests[name] = digest(name, below, self._context(name))
        return self._digests[name]

    def _context(self, name: str) -> Path:
        return self._folder / "store" / "contexts" / name

    def built(self, name: str) -> str:
        """Name of an image in the store, built if need be; it has the digest, so that it never means two things."""
        repository, version = f"localhost/fleet-computer/{name}", self._digest(name)
        tag = f"{repository}:{version}"
        if not self.store.has(tag):
            say(f"building the image {name}")
            self.build(name, tag)
            self.store.keep_only(repository, version)
        return tag

    def build(self, name: str, tag: str, fresh: bool = False) -> None:
        """Build an image, from nothing if it is to be fresh, after those that it needs."""
        parents = {key: self.built(parent) for key, parent in PARENTS.get(name, {}).items()}
        self._digest(name)
        arguments = parents or {"BASE": self._debian()}
        recipe = Recipe(self._context(name), f"containers/{name}/Containerfile", arguments)
        with build_secrets() as secrets:
            self.store.build(tag, recipe, secrets, fresh)

    def _debian(self) -> str:
        tag = f"{_DEBIAN}-{debian.root_file_system(self._folder / 'debian.tar')[:20]}"
        if not self.store.has(tag):
            self.store.take_in(self._folder / "debian.tar", tag)
        return tag


def _prepare_computer() -> None:
    """Install what building needs, if that is possible."""
    if os.geteuid() != 0:
        raise Missing("building images needs root: run as root, or copy the images' cache from where they were built")
    packages.ensure(_PACKAGES)


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
