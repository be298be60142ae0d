"""Two processes that append to one file of HDFS: the one that was given up finds out, and writes no more."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import cast

import pytest

from fleet.storage.appends import Appends, Changed
from fleet.storage.hdfs_files import HdfsFiles
from fleet.storage.webhdfs import FileStatus, WebHdfs
from fleet.storage.webhdfs_answers import Fate, Refused

LOG = "/fleet/log"


@dataclass
class MemoryHdfs:
    """Files as HDFS has them, as far as appends go: each has a number, and everything goes by path."""

    files: dict[str, tuple[int, bytes]] = field(default_factory=dict)
    calls: list[str] = field(default_factory=list)
    made: int = 0

    def create(self, path: str, data: bytes, avoid: Collection[str] = ()) -> None:
        self.made += 1
        self.calls.append("create")
        self.files[path] = self.made, data

    def append(self, path: str, data: bytes, url: str, avoid: Collection[str] = ()) -> str:
        self.calls.append("append")
        number, content = self._file(path)
        self.files[path] = number, content + data
        return "node"

    def read(self, path: str, avoid: Collection[str] = ()) -> bytes:
        return self._file(path)[1]

    def rename(self, source: str, target: str) -> None:
        self.files[target] = self.files.pop(source)

    def delete(self, path: str) -> None:
        self.files.pop(path, None)

    def status(self, path: str) -> FileStatus:
        number, content = self._file(path)
        return FileStatus("", False, len(content), 0, 0.0, number)

    def _file(self, path: str) -> tuple[int, bytes]:
        if path not in self.files:
            raise Refused(Fate.ABSENT, "File does not exist")
        return self.files[path]


@pytest.fixture
def hdfs() -> MemoryHdfs:
    return MemoryHdfs()


def process(hdfs: MemoryHdfs) -> Appends:
    """One process: what it knows of the files is its own."""
    return Appends(HdfsFiles(cast(WebHdfs, hdfs), 0.0), 0.0)


def content(hdfs: MemoryHdfs) -> bytes:
    return hdfs.read(LOG)


def test_a_process_that_was_given_up_writes_no_more(hdfs: MemoryHdfs) -> None:
    old, new = process(hdfs), process(hdfs)
    old.append(LOG, b"1\n")
    old.append(LOG, b"2\n")
    new.append(LOG, b"3\n")
    for _ in range(3):
        with pytest.raises(Changed):
            old.append(LOG, b"late\n")
    new.append(LOG, b"4\n")
    assert content(hdfs) == b"1\n2\n3\n4\n"


def test_a_file_of_the_same_size_is_not_taken_for_the_own_one(hdfs: MemoryHdfs) -> None:
    old = process(hdfs)
    old.append(LOG, b"1\n")
    hdfs.create(LOG, b"x\n")  # another process has replaced it before this one looked again
    with pytest.raises(Changed):
        old.append(LOG, b"late\n")
    assert content(hdfs) == b"x\n"


def test_a_file_that_was_written_as_a_whole_is_appended_to_when_it_still_has_its_size(hdfs: MemoryHdfs) -> None:
    one = process(hdfs)
    hdfs.create(LOG, b"1\n")
    one.was_made(LOG, 2)
    one.append(LOG, b"2\n")
    assert (content(hdfs), hdfs.calls.count("create")) == (b"1\n2\n", 1)
    hdfs.append(LOG, b"of another\n", "")
    with pytest.raises(Changed):
        one.append(LOG, b"3\n")


def test_who_reads_again_may_go_on_and_the_other_one_is_given_up_then(hdfs: MemoryHdfs) -> None:
    one, other = process(hdfs), process(hdfs)
    one.append(LOG, b"1\n")
    other.append(LOG, b"2\n")
    with pytest.raises(Changed):
        one.append(LOG, b"3\n")
    one.was_read(LOG, len(content(hdfs)))
    one.append(LOG, b"3\n")
    with pytest.raises(Changed):
        other.append(LOG, b"4\n")
    assert content(hdfs) == b"1\n2\n3\n"


def test_a_file_that_was_deleted_is_begun_anew(hdfs: MemoryHdfs) -> None:
    one = process(hdfs)
    one.append(LOG, b"1\n")
    hdfs.delete(LOG)
    one.append(LOG, b"2\n")
    assert content(hdfs) == b"2\n"


def test_an_append_after_the_first_is_one_request_to_a_datanode(hdfs: MemoryHdfs) -> None:
    one = process(hdfs)
    for number in range(4):
        one.append(LOG, b"%d\n" % number)
    assert hdfs.calls == ["create", "append", "append", "append"]
