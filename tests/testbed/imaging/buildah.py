"""buildah with a store of its own: builds images from Containerfiles and writes them as OCI archives."""

from __future__ import annotations

import fcntl
import hashlib
import io
import json
import os
import shutil
import subprocess
import tarfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.testbed.errors import BedError


@dataclass(frozen=True)
class Recipe:
    """What an image is made from.

    Args:
        context: Folder with all of it.
        containerfile: Path in the context.
        arguments: Build arguments; `BASE` is the name of the image that it stands on.
    """

    context: Path
    containerfile: str
    arguments: Mapping[str, str]


class Buildah:
    """A folder with images and their layers; not the one of the system.

    Args:
        folder: Where everything is kept; made when it is missing.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    @property
    def environment(self) -> dict[str, str]:
        """What buildah is run with."""
        scratch = self._folder / "tmp"
        scratch.mkdir(exist_ok=True)
        return {**os.environ, "TMPDIR": str(scratch), "BUILDAH_ISOLATION": "chroot"}

    def command(self, *arguments: str) -> list[str]:
        """buildah with this store."""
        where = ["--root", str(self._folder / "root"), "--runroot", str(self._folder / "run")]
        return ["buildah", *where, "--storage-driver", "overlay", *arguments]

    def run(self, *arguments: str) -> str:
        """Run buildah; returns its standard output.

        Raises:
            BedError: it failed; the text has the end of what it said.
        """
        command = self.command(*arguments)
        done = subprocess.run(command, check=False, capture_output=True, text=True, env=self.environment)
        if done.returncode:
            said = "\n".join((done.stdout + done.stderr).splitlines()[-30:])
            raise BedError(f"buildah {arguments[0]} failed:\n{said}")
        return done.stdout

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Keep other processes from removing images."""
        with (self._folder / "in-use").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_SH)
            yield

    def has(self, name: str) -> bool:
        """Whether there is an image of this name."""
        return bool(self.run("images", "--quiet", "--filter", f"reference={name}").strip())

    def keep_only(self, name: str, tag: str) -> None:
        """Remove all images of this name with other tags, and the layers that no image has any more."""
        with (self._folder / "in-use").open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return  # the next build will do it
            listed = self.run("images", "--format", "{{.Name}}:{{.Tag}}", "--filter", f"reference={name}")
            for other in set(listed.split()) - {f"{name}:{tag}"}:
                self.run("rmi", "--force", other)  # with the containers that a build which was broken off has left
            self.run("rmi", "--prune")

    def take_in(self, tarball: Path, name: str) -> None:
        """Make an image of one layer from a tarball of a root file system."""
        container = self.run("from", "scratch").strip()
        try:
            self.run("add", "--quiet", container, str(tarball), "/")
            self.run("commit", "--quiet", "--timestamp", "0", container, name)
        finally:
            self.run("rm", container)

    def build(self, name: str, recipe: Recipe, secrets: Mapping[str, Path], fresh: bool = False) -> None:
        """Build an image; layers that were built before are taken from the store.

        Args:
            name: What it is called in the store.
            recipe: What it is made from.
            secrets: Files that its build may read, by id; they are in no layer.
            fresh: Build every layer anew.
        """
        given = [word for key, path in secrets.items() for word in ("--secret", f"id={key},src={path}")]
        options = ["--layers", *(["--no-cache"] if fresh else []), "--pull=never", "--quiet", "--timestamp", "0"]
        given += [word for key, value in recipe.arguments.items() for word in ("--build-arg", f"{key}={value}")]
        where = ["--file", str(recipe.context / recipe.containerfile), "--tag", name, str(recipe.context)]
        try:
            self.run("build", *options, "--identity-label=false", *given, *where)
        finally:
            self._tidy()

    def _tidy(self) -> None:
        """Remove the containers of a build: buildah forgets those of stages that others only mount."""
        for name in self.run("containers", "--format", "{{.ContainerName}}").split():
            if "working-container" in name:
                self.run("rm", name)

    def write(self, name: str, reference: str, archive: Path) -> None:
        """Write an image as an OCI archive for `ctr images import`, with uncompressed layers.

        Args:
            name: What it is called in the store.
            reference: The full name that it shall have in a cluster, with its registry.
            archive: Tar file to write.
        """
        folder = self._folder / "pushed"
        shutil.rmtree(folder, ignore_errors=True)
        # To a plain folder, as buildah compresses what it writes in the layout of OCI, whatever it is asked.
        self.run("push", "--quiet", "--disable-compression", "--format", "oci", name, f"dir:{folder}")
        partial = archive.with_suffix(".partial")
        _pack(folder, reference, partial)
        partial.rename(archive)
        shutil.rmtree(folder)


def _pack(folder: Path, reference: str, archive: Path) -> None:
    """Turn what buildah pushed (a manifest, and blobs named by their digests) into an archive in OCI's layout.

    Source: OCI Image Format Specification, "Image Layout"; the annotation is containerd's.
    """
    manifest = json.loads((folder / "manifest.json").read_bytes())
    config = json.loads((folder / _hexadecimal(manifest["config"])).read_bytes())
    # Names and digests of what it was built on in this store: they may differ where everything else is the same.
    manifest.pop("annotations", None)
    config.pop("history", None)
    written: dict[str, bytes] = {}
    manifest["config"] |= _describe(config, written)
    entry = {
        "mediaType": "application/vnd.oci.image.manifest.v1+json",
        **_describe(manifest, written),
        "annotations": {"io.containerd.image.name": reference, "org.opencontainers.image.ref.name": reference},
    }
    index = {"schemaVersion": 2, "mediaType": "application/vnd.oci.image.index.v1+json", "manifests": [entry]}
    with tarfile.open(archive, "w") as tar:
        _add(tar, "oci-layout", b'{"imageLayoutVersion": "1.0.0"}')
        _add(tar, "index.json", json.dumps(index, sort_keys=True).encode())
        for name, content in written.items():
            _add(tar, f"blobs/sha256/{name}", content)
        for name in dict.fromkeys(_hexadecimal(layer) for layer in manifest["layers"]):
            with (folder / name).open("rb") as file:
                tar.addfile(_entry(f"blobs/sha256/{name}", (folder / name).stat().st_size), file)


def _hexadecimal(described: Mapping[str, Any]) -> str:
    return str(described["digest"]).removeprefix("sha256:")


def _describe(document: Mapping[str, Any], written: dict[str, bytes]) -> dict[str, Any]:
    """Digest and size of a document, whose bytes are added to `written` by its digest."""
    content = json.dumps(document, sort_keys=True).encode()
    digest = hashlib.sha256(content).hexdigest()
    written[digest] = content
    return {"digest": f"sha256:{digest}", "size": len(content)}


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    tar.addfile(_entry(name, len(content)), io.BytesIO(content))


def _entry(name: str, size: int) -> tarfile.TarInfo:
    """The same bytes each time: neither the day nor the user of the build."""
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = size, 0o644
    return entry
