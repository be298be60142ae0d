"""A run whose storage is full or read-only stops with a clear word, loses nothing, and goes on later."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from fleet.missions.records import read_log
from fleet.storage.local import LocalStorage
from tests.scouting import PATHS, finish, running, words


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A small file system of its own."""
    if os.geteuid() != 0:
        pytest.skip("needs root to mount a small file system; run the tests as root to have this one")
    folder = tmp_path / "disk"
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)], check=False)
    if done.returncode != 0:
        pytest.skip("this system does not let root mount a tmpfs (a container without CAP_SYS_ADMIN)")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def _prepare(undisturbed: Path, disk: Path) -> tuple[Path, LocalStorage]:
    """The undisturbed run on the small disk, before its mission, with few retries."""
    out = disk / "out"
    shutil.copytree(undisturbed / "out", out, ignore=shutil.ignore_patterns("logs", "*.png", "*.html", "missions"))
    return out, LocalStorage(out / "storage")


def test_a_full_disk_ends_the_run_and_the_run_goes_on_when_there_is_room(undisturbed: Path, disk: Path) -> None:
    out, storage = _prepare(undisturbed, disk)
    ballast = disk / "ballast"
    said = disk.parent / "said"
    room = shutil.disk_usage(disk).free - 3 * 4096
    ballast.write_bytes(b"\0" * room)
    with running(undisturbed / "swarm/fleetspec.yaml", said, "--out", str(out)) as run:
        assert finish(run, said) not in {0, 1}, words(said)
    assert "no space" in words(said).lower() or "full" in words(said).lower(), words(said)
    logs = {entry.path: storage.read(entry.path) for entry in storage.list(PATHS.root) if entry.path.endswith(".jsonl")}

    ballast.unlink()
    with running(undisturbed / "swarm/fleetspec.yaml", said, "--out", str(out)) as run:
        assert finish(run, said) in {0, 1}, words(said)
    for path, before in logs.items():
        kept = read_log(before)
        assert read_log(storage.read(path))[: len(kept)] == kept
    expected = LocalStorage(undisturbed / "out/storage")
    assert storage.read(PATHS.evaluation(1)) == expected.read(PATHS.evaluation(1))


def test_a_read_only_storage_is_said_and_nothing_changes(undisturbed: Path, disk: Path) -> None:
    out, storage = _prepare(undisturbed, disk)
    shutil.move(str(out), str(disk.parent / "out"))
    out = disk.parent / "out"
    shutil.move(str(out / "storage"), str(disk / "storage"))
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    storage = LocalStorage(disk / "storage")
    before = storage.list("")
    said = disk.parent / "said"
    uri = (disk / "storage").as_uri()
    with running(undisturbed / "swarm/fleetspec.yaml", said, "--out", str(out), "--storage", uri) as run:
        assert finish(run, said) not in {0, 1}, words(said)
    assert "read-only" in words(said).lower(), words(said)
    assert storage.list("") == before
