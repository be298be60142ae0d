"""The local directory keeps the storage contract; and what only a directory has."""

from __future__ import annotations

import os
import resource
import stat
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from fleet.errors import ObjectNotFound, SpecError, StorageError, StorageUnavailable
from fleet.storage.limits import Limits
from fleet.storage.local import LocalStorage
from fleet.storage.open import open_storage
from fleet.storage.port import Entry, Storage
from tests.contract.storage_contract import StorageContract


@contextmanager
def _mounted(folder: Path) -> Iterator[bool]:
    """A file system of 2 MiB in memory; False where this process may not mount one."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)]
    mounted = os.geteuid() == 0 and subprocess.run(command, capture_output=True, check=False).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextmanager
def _small_files() -> Iterator[None]:
    """No file of this process may grow beyond 2 MiB: the full disk of those who may not mount one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2 << 20, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def _remounted(folder: Path) -> Iterator[None]:
    subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)
    yield


@contextmanager
def _without_permission(folder: Path) -> Iterator[None]:
    (folder / "kept").chmod(0o444)
    folder.chmod(0o555)
    yield
    folder.chmod(0o755)


class TestLocalStorage(StorageContract):
    @pytest.fixture
    def storage(self, tmp_path: Path) -> Storage:
        return LocalStorage(tmp_path / "storage")

    @pytest.fixture
    def full_storage(self, tmp_path: Path) -> Iterator[Storage]:
        storage = LocalStorage(tmp_path / "small")
        with _mounted(storage.root) as mounted, nullcontext() if mounted else _small_files():
            storage.write("kept", b"kept")
            yield storage

    @pytest.fixture
    def read_only_storage(self, tmp_path: Path) -> Iterator[Storage]:
        storage = LocalStorage(tmp_path / "fixed")
        with _mounted(storage.root) as mounted:
            storage.write("kept", b"kept")
            if not mounted and os.geteuid() == 0:
                pytest.skip("root may write everywhere and may not mount here: run as a user or with CAP_SYS_ADMIN")
            with _remounted(storage.root) if mounted else _without_permission(storage.root):
                yield storage


def test_nothing_is_made_before_the_first_write(tmp_path: Path) -> None:
    storage = LocalStorage(tmp_path / "a" / "b")
    assert (storage.list(""), storage.exists("x")) == ([], False)
    storage.delete("x")
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_writer_left_is_not_listed_and_is_taken_over(tmp_path: Path) -> None:
    storage = LocalStorage(tmp_path)
    (tmp_path / "~a~").write_bytes(b"half of an obj")
    assert (storage.list(""), storage.exists("a")) == ([], False)
    storage.write("a", b"new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a"]
    assert storage.read("a") == b"new"


def test_files_that_are_no_objects_are_not_listed(tmp_path: Path) -> None:
    (tmp_path / "notes of mine.txt").write_text("x")
    (tmp_path / "good.csv").write_text("xy")
    assert LocalStorage(tmp_path).list("") == [Entry("good.csv", 2)]


def test_what_may_never_end_is_no_object(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        with pytest.raises(ObjectNotFound, match=name):
            LocalStorage(tmp_path).read(name)


def test_an_object_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    storage = LocalStorage(tmp_path, Limits(object_bytes=1 << 20))
    storage.write("fits", bytes(1 << 20))
    assert storage.read("fits") == bytes(1 << 20)
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(10 << 30)
    with pytest.raises(StorageError, match="it has 10240 MiB, and this process reads objects of at most 1 MiB"):
        storage.read("sparse")


def test_objects_are_made_with_the_permissions_of_the_user(tmp_path: Path) -> None:
    storage = LocalStorage(tmp_path)
    before = os.umask(0o027)
    try:
        storage.write("a", b"")
        storage.append("b", b"1")
    finally:
        os.umask(before)
    assert [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("a", "b")] == [0o640, 0o640]


def test_a_broken_disk_is_a_passing_failure(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    storage = LocalStorage(tmp_path)
    with pytest.raises(StorageUnavailable, match="check the disk or mount"):
        storage.read("loop")


def test_an_address_with_odd_letters_opens_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "a field, 100% ü"
    LocalStorage(folder).write("a", b"1")
    assert open_storage(LocalStorage(folder).uri).read("a") == b"1"
    assert open_storage(f"file://localhost{tmp_path}").list("") == []


@pytest.mark.parametrize(
    ("uri", "advice"),
    [
        ("/var/lib/fleet", "is a path, not an address; write file:///var/lib/fleet"),
        ("runs/one", f"is a path, not an address; write {(Path.cwd() / 'runs/one').as_uri()}"),
        ("", "is a path, not an address"),
        ("file:relative", "names no absolute folder"),
        ("file://relative/folder", "names no absolute folder; write file:/// and the absolute path"),
        ("file://", "names no absolute folder"),
        ("file:///a?b", r"has a \? or #"),
        ("s3://bucket", "'s3://bucket' begins with s3://, which is no known storage; write file:///absolute/folder"),
    ],
)
def test_wrong_addresses_say_what_to_write(uri: str, advice: str) -> None:
    with pytest.raises(SpecError, match=advice):
        open_storage(uri)
