"""What every storage backend must do. A backend's test class inherits StorageContract and gives the fixtures."""

from __future__ import annotations

import pickle
import random
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from fleet.errors import FleetError, ObjectNotFound, StorageError, StorageFull, StorageReadOnly
from fleet.storage.open import open_storage
from fleet.storage.port import Entry, Storage
from tests.conftest import ROOT
from tests.contract.storage_writer import line, number_of, whole

WRONG_PATHS = ["", "/", "/a", "a/", "a//b", ".", "..", "a/../b", "../a", "a/./b", "a b", "a\\b", "a\0b", "ä", "~a~"]


class StorageContract:
    """Fixtures to give: `storage` (empty), `full_storage` (with `kept`, and less than 2 MiB left), `read_only_storage`
    (with `kept`); `kept` is a path whose object is b"kept"."""

    kills = 20
    """How many writers of each kind are killed."""
    replacements = 60
    """How often an object is replaced under its readers."""

    def pytest_generate_tests(self, metafunc: pytest.Metafunc) -> None:
        if "seed" in metafunc.fixturenames:
            metafunc.parametrize("seed", range(metafunc.cls.kills))

    @pytest.fixture
    def storage(self) -> Storage:
        raise NotImplementedError

    @pytest.fixture
    def full_storage(self) -> Iterator[Storage]:
        raise NotImplementedError

    @pytest.fixture
    def read_only_storage(self) -> Iterator[Storage]:
        raise NotImplementedError

    # whole objects

    def test_a_written_object_is_read_back(self, storage: Storage) -> None:
        data = random.Random(0).randbytes(1_000_000)
        storage.write("default/crop/models/initial.npz", data)
        assert storage.read("default/crop/models/initial.npz") == data

    def test_an_empty_object_is_an_object(self, storage: Storage) -> None:
        storage.write("a/empty", b"")
        assert (storage.read("a/empty"), storage.exists("a/empty")) == (b"", True)
        assert storage.list("") == [Entry("a/empty", 0)]

    def test_a_second_write_replaces(self, storage: Storage) -> None:
        storage.write("a", b"a longer one")
        storage.write("a", b"short")
        assert storage.read("a") == b"short"

    def test_what_was_never_written_is_not_found(self, storage: Storage) -> None:
        storage.write("folder/a", b"1")
        for path in ("b", "folder/b", "folder/a/b", "other/a", "folder"):
            assert not storage.exists(path)
            with pytest.raises(ObjectNotFound, match=path):
                storage.read(path)

    def test_an_object_is_not_used_as_a_folder(self, storage: Storage) -> None:
        storage.write("a", b"1")
        with pytest.raises(StorageError):
            storage.write("a/b", b"2")
        with pytest.raises(StorageError):
            storage.append("a/b", b"2")
        assert (storage.read("a"), storage.list("")) == (b"1", [Entry("a", 1)])

    def test_a_folder_is_not_used_as_an_object(self, storage: Storage) -> None:
        storage.write("a/b", b"1")
        with pytest.raises(StorageError):
            storage.write("a", b"2")
        with pytest.raises(StorageError):
            storage.append("a", b"2")
        assert storage.list("") == [Entry("a/b", 1)]

    # appended objects

    def test_append_makes_an_object_and_adds_to_its_end(self, storage: Storage) -> None:
        storage.append("logs/a.jsonl", b"one\n")
        storage.append("logs/a.jsonl", b"")
        storage.append("logs/a.jsonl", b"two\n")
        assert storage.read("logs/a.jsonl") == b"one\ntwo\n"
        assert storage.list("logs") == [Entry("logs/a.jsonl", 8)]

    def test_append_goes_on_after_a_whole_write(self, storage: Storage) -> None:
        storage.write("a", b"one\n")
        storage.append("a", b"two\n")
        storage.write("a", b"three\n")
        storage.append("a", b"four\n")
        assert storage.read("a") == b"three\nfour\n"

    # listings

    def test_a_listing_has_every_object_under_a_folder_sorted_by_path(self, storage: Storage) -> None:
        for path in ("m/10", "m/2", "m/1/deep/er", "m/1-a", "mm/1", "n"):
            storage.write(path, path.encode())
        assert storage.list("m") == [Entry("m/1-a", 5), Entry("m/1/deep/er", 11), Entry("m/10", 4), Entry("m/2", 3)]
        assert [entry.path for entry in storage.list("")] == ["m/1-a", "m/1/deep/er", "m/10", "m/2", "mm/1", "n"]

    def test_a_listing_of_what_is_no_folder_is_empty(self, storage: Storage) -> None:
        storage.write("a/b", b"1")
        assert [storage.list(prefix) for prefix in ("b", "a/c", "a/b", "a/b/c")] == [[], [], [], []]

    def test_an_empty_storage_lists_nothing(self, storage: Storage) -> None:
        assert storage.list("") == []

    # deleting

    def test_delete_removes_an_object_or_a_folder_and_nothing_else(self, storage: Storage) -> None:
        for path in ("a/b/c", "a/b/d", "a/bb", "a/e"):
            storage.write(path, b"1")
        storage.delete("a/b")
        storage.delete("a/e")
        assert storage.list("") == [Entry("a/bb", 1)]
        storage.write("a/b", b"now an object")
        assert storage.read("a/b") == b"now an object"

    def test_delete_of_nothing_does_nothing(self, storage: Storage) -> None:
        storage.write("a", b"1")
        storage.delete("b")
        storage.delete("b/c")
        storage.delete("a/c")
        assert storage.list("") == [Entry("a", 1)]

    def test_delete_never_takes_the_whole_storage(self, storage: Storage) -> None:
        storage.write("a", b"1")
        with pytest.raises(StorageError):
            storage.delete("")
        assert storage.read("a") == b"1"

    # paths and addresses

    @pytest.mark.parametrize("path", WRONG_PATHS)
    def test_wrong_paths_are_refused_with_advice(self, storage: Storage, path: str) -> None:
        storage.write("a", b"1")
        for act in (
            lambda: storage.read(path),
            lambda: storage.exists(path),
            lambda: storage.write(path, b"2"),
            lambda: storage.append(path, b"2"),
            lambda: storage.delete(path),
        ):
            with pytest.raises(StorageError, match="not a path in storage") as caught:
                act()
            assert type(caught.value) is StorageError  # trying again is of no use
        if path:
            with pytest.raises(StorageError, match="not a path in storage"):
                storage.list(path)
        assert storage.list("") == [Entry("a", 1)]

    def test_its_address_opens_the_same_storage(self, storage: Storage) -> None:
        storage.write("a/b", b"1")
        again = open_storage(storage.uri)
        assert (again.uri, again.read("a/b")) == (storage.uri, b"1")

    def test_it_can_be_sent_to_another_process(self, storage: Storage) -> None:
        storage.write("a/b", b"1")
        assert pickle.loads(pickle.dumps(storage)).read("a/b") == b"1"

    # many at a time

    def test_readers_during_a_replace_see_the_old_or_the_new_object(self, storage: Storage) -> None:
        storage.write("a", whole(0, 200_000))
        problems: list[Exception] = []
        ended = threading.Event()

        def watch() -> None:
            last = 0
            while not ended.is_set():
                try:
                    number = number_of(storage.read("a"))
                    assert number >= last
                    assert [entry.path for entry in storage.list("")] == ["a"]
                    last = number
                except (FleetError, ValueError, AssertionError) as error:
                    problems.append(error)

        readers = [threading.Thread(target=watch) for _ in range(2)]
        for reader in readers:
            reader.start()
        for number in range(1, self.replacements):
            storage.write("a", whole(number, 3_000 * (self.replacements - number)))
        ended.set()
        for reader in readers:
            reader.join()
        assert problems == []

    def test_writers_of_the_same_object_leave_one_of_their_objects(self, storage: Storage) -> None:
        problems: list[Exception] = []

        def write(first: int) -> None:
            try:
                for number in range(first, first + 15):
                    storage.write("folder/a", whole(number, 50_000))
            except FleetError as error:
                problems.append(error)

        writers = [threading.Thread(target=write, args=(first,)) for first in (0, 100, 200)]
        for writer in writers:
            writer.start()
        for writer in writers:
            writer.join()
        assert problems == []
        assert number_of(storage.read("folder/a")) in {14, 114, 214}
        assert [entry.path for entry in storage.list("")] == ["folder/a"]

    # crashes

    def test_a_killed_writer_leaves_a_whole_object_and_nothing_else(self, storage: Storage, seed: int) -> None:
        acknowledged = _write_and_kill(storage, "whole", "folder/a", seed)
        assert number_of(storage.read("folder/a")) in {acknowledged, acknowledged + 1}
        assert [entry.path for entry in storage.list("")] == ["folder/a"]
        storage.write("folder/a", whole(10**6, 1_000))
        assert number_of(storage.read("folder/a")) == 10**6

    def test_a_killed_appender_loses_no_acknowledged_line(self, storage: Storage, seed: int) -> None:
        acknowledged = _write_and_kill(storage, "append", "folder/a", seed)
        data = _go_on(storage, "folder/a", line(acknowledged + 2))
        sure = b"".join(line(number) for number in range(1, acknowledged + 1))
        assert data.startswith(sure)
        assert line(acknowledged + 1).startswith(data[len(sure) :])
        assert storage.read("folder/a") == data + line(acknowledged + 2)

    # no space, no permission

    def test_a_full_storage_says_so_and_keeps_what_it_has(self, full_storage: Storage) -> None:
        full_storage.write("log", b"one\n")
        big = random.Random(0).randbytes(4 << 20)
        for act in (
            lambda: full_storage.write("kept", big),
            lambda: full_storage.write("new/object", big),
            lambda: full_storage.append("log", big),
            lambda: full_storage.append("new/log", big),
        ):
            with pytest.raises(StorageFull, match="free space or raise the quota"):
                act()
        assert [(entry.path, full_storage.read(entry.path)) for entry in full_storage.list("")] == [
            ("kept", b"kept"), ("log", b"one\n"),
        ]  # fmt: skip
        full_storage.append("log", b"two\n")
        assert full_storage.read("log") == b"one\ntwo\n"

    def test_a_read_only_storage_says_so_and_can_be_read(self, read_only_storage: Storage) -> None:
        for act in (
            lambda: read_only_storage.write("kept", b"1"),
            lambda: read_only_storage.write("new/object", b"1"),
            lambda: read_only_storage.append("kept", b"1"),
            lambda: read_only_storage.append("new/log", b"1"),
            lambda: read_only_storage.delete("kept"),
        ):
            with pytest.raises(StorageReadOnly, match=r"make the directory writable|choose another"):
                act()
        assert read_only_storage.list("") == [Entry("kept", 4)]
        assert read_only_storage.read("kept") == b"kept"


def _go_on(storage: Storage, path: str, data: bytes) -> bytes:
    """Append after another writer's death; what was there before.

    What he sent last may still arrive over a network. The storage then refuses to append to what was not read.
    """
    while True:
        before = storage.read(path)
        try:
            storage.append(path, data)
        except StorageError as error:
            assert "read it again" in str(error)  # noqa: PT017 - any other error fails the test; this one is allowed
        else:
            return before


def _write_and_kill(storage: Storage, kind: str, path: str, seed: int) -> int:
    """Let a process write, kill it in the middle of something; the number of its last acknowledged write."""
    chance = random.Random(seed)
    with _writer(storage, kind, path, seed) as writer:
        assert writer.stdout is not None
        acknowledged = [int(writer.stdout.readline()) for _ in range(1 + chance.randrange(12))]
        if kind == "whole":
            assert number_of(storage.read(path)) >= acknowledged[-1]
        threading.Event().wait(chance.random() * 0.02)
        writer.kill()
        acknowledged += map(int, writer.stdout.read().split())
    return acknowledged[-1]


@contextmanager
def _writer(storage: Storage, kind: str, path: str, seed: int) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "tests.contract.storage_writer", storage.uri, kind, path, str(seed)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()
