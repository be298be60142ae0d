"""Two images that need no image builder: what every pod's sandbox runs, and a shell with the usual commands."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import subprocess
import tarfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.testbed.configuration import PAUSE_IMAGE
from tests.testbed.errors import Missing

BUSYBOX_IMAGE = "fleet.test/busybox:1"
FOLDERS = ("bin", "tmp", "usr", "lib", "lib64", "etc", "opt", "var")
MANIFEST = "application/vnd.oci.image.manifest.v1+json"
CONFIG = "application/vnd.oci.image.config.v1+json"
LAYER = "application/vnd.oci.image.layer.v1.tar"


def small_images(folder: Path) -> list[Path]:
    """The archives of both images in a folder, made if missing.

    Raises:
        Missing: there is no static busybox.
    """
    shell = shutil.which("busybox")
    if shell is None:
        raise Missing("busybox is not on the PATH: install busybox-static (as root: python -m tests.testbed build)")
    program = Path(shell).read_bytes()
    if b"/ld-" in program[:4096]:  # the name of a loader, which the image has not
        raise Missing(f"{shell} is not static: install busybox-static in its place")
    listed = subprocess.run([shell, "--list"], text=True, capture_output=True, check=True)
    links = {f"bin/{name}": "busybox" for name in listed.stdout.split() if name != "busybox"}
    layer = _layer(FOLDERS, {"bin/busybox": program}, links)
    folder.mkdir(parents=True, exist_ok=True)
    # busybox sleeps as well as a program of its own would, and is ended by SIGKILL anyway.
    commands = {PAUSE_IMAGE: ["/bin/busybox", "sleep", "2147483647"], BUSYBOX_IMAGE: ["/bin/sh"]}
    paths = []
    for name, command in commands.items():
        path = folder / f"{name.split('/')[1].split(':')[0]}.tar"
        if not path.exists():
            _write(path, name, command, layer)
        paths.append(path)
    return paths


def _layer(folders: Sequence[str], files: Mapping[str, bytes], links: Mapping[str, str]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for name in folders:
            entry = tarfile.TarInfo(name)
            entry.type, entry.mode = tarfile.DIRTYPE, 0o1777 if name == "tmp" else 0o755
            archive.addfile(entry)
        for name, content in files.items():
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode = len(content), 0o755
            archive.addfile(entry, io.BytesIO(content))
        for name, target in links.items():
            entry = tarfile.TarInfo(name)
            entry.type, entry.linkname = tarfile.SYMTYPE, target
            archive.addfile(entry)
    return buffer.getvalue()


def _write(path: Path, name: str, command: list[str], layer: bytes) -> None:
    """An OCI image layout in an archive, with the name that containerd gives the image."""
    platform = {"os": "linux", "architecture": _architecture()}
    run = {"Cmd": command, "Env": ["PATH=/bin"]}
    root = {"type": "layers", "diff_ids": [_digest(layer)]}
    config = json.dumps(platform | {"config": run, "rootfs": root}).encode()
    version = {"schemaVersion": 2}
    parts = {"config": _descriptor(CONFIG, config), "layers": [_descriptor(LAYER, layer)]}
    manifest = json.dumps(version | {"mediaType": MANIFEST} | parts).encode()
    annotations = {"io.containerd.image.name": name}
    entry = _descriptor(MANIFEST, manifest) | {"platform": platform, "annotations": annotations}
    index = json.dumps(version | {"manifests": [entry]}).encode()
    files = {"oci-layout": b'{"imageLayoutVersion":"1.0.0"}', "index.json": index}
    files |= {f"blobs/sha256/{_digest(blob).removeprefix('sha256:')}": blob for blob in (layer, config, manifest)}
    draft = path.with_suffix(".part")
    with tarfile.open(draft, "w") as archive:
        for file, data in files.items():
            member = tarfile.TarInfo(file)
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))
    draft.rename(path)


def _digest(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def _descriptor(kind: str, content: bytes) -> dict[str, Any]:
    return {"mediaType": kind, "digest": _digest(content), "size": len(content)}


def _architecture() -> str:
    machine = subprocess.run(["uname", "-m"], text=True, capture_output=True, check=True).stdout.strip()
    return {"x86_64": "amd64", "aarch64": "arm64"}.get(machine, machine)
