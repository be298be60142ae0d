"""Unpacked images, prepared once for a set of images and then shared by every machine of every bed."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.testbed.binaries import cache, tool
from tests.testbed.configuration import containerd_toml
from tests.testbed.errors import BedError
from tests.testbed.processes import run

FORMAT = "1"  # to be raised when what is below changes what a store is
SNAPSHOTS = "io.containerd.snapshotter.v1.overlayfs/snapshots"
BLOBS = "io.containerd.content.v1.content/blobs"
KEPT = 3  # stores: of the tests, of a user's cluster, and one from before the last change
SMALL_BYTES = 100_000_000  # up to this, unpacking anew is faster than linking the files of an older store
# Where a machine sees the store.
SEEN = Path("/run/images")
IMPORT = Path(__file__).with_name("import-images")


class ImageStore:
    """A folder of containerd's with images unpacked; nothing in it changes any more."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def furnish(self, disk: Path) -> None:
        """Give a new machine these images: `disk` becomes its containerd's folder.

        Databases are copied. Blobs and the files of unpacked layers are links to the store, which a machine sees
        read-only: containerd writes blobs once, under another name, and layers are lower folders of overlays.
        """
        for source, folders, files in os.walk(self.folder):
            path = Path(source).relative_to(self.folder)
            (disk / path).mkdir(parents=True, exist_ok=True)
            if str(path) == SNAPSHOTS:
                for layer in folders:
                    _link_layer(disk / path / layer, SEEN / path / layer)
                folders.clear()
            for file in files:
                if str(path).startswith(BLOBS):
                    (disk / path / file).symlink_to(SEEN / path / file)
                else:
                    shutil.copy2(Path(source) / file, disk / path / file)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep the store from being removed."""
        with _lock_file(self.folder).open("w") as file:
            fcntl.flock(file, fcntl.LOCK_SH)
            yield


def image_store(images: Sequence[Path]) -> ImageStore:
    """The store of a set of image archives, made if missing; older stores that nobody uses are removed."""
    root = cache() / "images"
    root.mkdir(parents=True, exist_ok=True)
    store = ImageStore(root / _key(images))
    with (root / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for draft in root.glob("*.part"):  # of one that was killed
            shutil.rmtree(draft)
        if not store.folder.is_dir():
            size = sum(image.stat().st_size for image in images)
            before = _by_age(root) if size > SMALL_BYTES else []
            _make(store.folder, images, before[0] if before else None)
        os.utime(store.folder)
        for old in _by_age(root)[KEPT:]:
            _forget(old)
    return store


def _by_age(root: Path) -> list[Path]:
    """The stores, that which was used last first."""
    stores = [path for path in root.iterdir() if path.is_dir()]
    return sorted(stores, key=lambda path: path.stat().st_mtime, reverse=True)


def _key(images: Sequence[Path]) -> str:
    """Name of the store: what is in the archives, not where they are."""
    contents = sorted(_index(image) for image in images)
    return hashlib.sha256(b"\0".join([FORMAT.encode(), *contents])).hexdigest()[:16]


def _index(image: Path) -> bytes:
    """The index of an OCI archive: digests of everything that is in it."""
    with tarfile.open(image) as archive:
        file = archive.extractfile("index.json")
        if file is None:
            raise BedError(f"{image} is no OCI image archive: it has no index.json")
        return file.read()


def images_of(archive: Path) -> dict[str, str]:
    """The digests of the images of an archive by the names that containerd gives them."""
    entries = json.loads(_index(archive))["manifests"]
    return {entry.get("annotations", {}).get("io.containerd.image.name", ""): entry["digest"] for entry in entries}


def _make(folder: Path, images: Sequence[Path], before: Path | None) -> None:
    """Unpack images into a new store; layers that the one `before` has are linked and not unpacked again."""
    draft = folder.with_suffix(".part")
    if before is None:
        draft.mkdir()
    else:
        run(["cp", "--archive", "--link", before, draft])
        for database in draft.rglob("*.db"):  # the only files that containerd changes
            database.unlink()
            shutil.copy2(before / database.relative_to(draft), database)
    settings = folder.with_suffix(".toml")
    settings.write_text(containerd_toml("/run/store"))
    names = [name for image in images for name in images_of(image)]
    isolate = ["unshare", "--mount", "--pid", "--fork", "--kill-child=SIGKILL", "--mount-proc"]
    path = f"{tool('containerd').parent}:{os.environ['PATH']}:/usr/sbin:/sbin"
    run(
        ["setpriv", "--pdeathsig", "KILL", *isolate, IMPORT, draft, settings, *images],
        timeout_s=900.0,
        env={"KEEP": "\n".join(names), "PATH": path},
    )
    settings.unlink()
    draft.rename(folder)


def _forget(folder: Path) -> None:
    """Remove a store that no bed has its images from."""
    mark = _lock_file(folder)
    with mark.open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        shutil.rmtree(folder)
    mark.unlink()


def _lock_file(folder: Path) -> Path:
    return folder.with_suffix(".lock")


def _link_layer(layer: Path, seen: Path) -> None:
    """A committed layer of overlayfs: its files are elsewhere, and it needs no work folder any more."""
    layer.mkdir(mode=0o700)
    (layer / "fs").symlink_to(seen / "fs")
    (layer / "work").mkdir(mode=0o711)
