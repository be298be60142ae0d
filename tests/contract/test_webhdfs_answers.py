"""What storage in HDFS makes of answers that are none: busy, standby, stranger, silent servers."""

from __future__ import annotations

import json
import re
import socket
from pathlib import Path

import pytest

from fleet.errors import StorageError, StorageFull, StorageUnavailable
from fleet.storage.hdfs import HdfsStorage
from fleet.storage.limits import Limits, within
from fleet.storage.webhdfs_address import WebHdfsAddress
from tests.contract.stand_in_namenode import ENDLESS, FILE, Answer, namenode, refusal, sender

WRITTEN_TO = "File /fleet/a could only be written to"
PASSING = [
    Answer(503, "busy", {"Retry-After": "0"}),
    Answer(429, "too many requests"),
    Answer(500, "<html>proxy error</html>"),
    Answer(0),
    Answer(200, "<html>a page</html>"),
    Answer(403, {"error": "not WebHDFS"}),
    refusal("RetriableException", "Namenode is in startup mode"),
    refusal("StandbyException", "Operation category READ is not supported in state standby"),
    refusal("SafeModeException", "Cannot create file. Name node is in safe mode."),
    refusal("IOException", "Failed to find datanode, suggest to check cluster health."),
]


def storage_at(*hosts: str, patience_s: float = 30.0) -> HdfsStorage:
    return HdfsStorage(WebHdfsAddress(hosts, "/fleet", "fleet"), patience_s)


@pytest.mark.parametrize("answer", PASSING)
def test_what_may_pass_is_tried_again(answer: Answer) -> None:
    with namenode(answer, answer, FILE) as stand_in:
        assert storage_at(stand_in.address).exists("a")
    assert len(stand_in.queries) == 3


@pytest.mark.parametrize("answer", PASSING)
def test_what_does_not_pass_ends_in_time_and_names_the_server(answer: Answer) -> None:
    with (
        namenode(answer) as stand_in,
        pytest.raises(StorageUnavailable, match=f"cannot look for a in .*check the NameNode {stand_in.address}"),
    ):
        storage_at(stand_in.address, patience_s=0.1).exists("a")


def test_of_two_namenodes_the_active_one_is_found_and_kept() -> None:
    with namenode(PASSING[7]) as standby, namenode(FILE) as active:
        storage = storage_at(standby.address, active.address)
        assert [storage.exists("a") for _ in range(3)] == [True] * 3
        assert (len(standby.queries), len(active.queries)) == (1, 3)


def test_a_server_that_is_not_there_is_said() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        with pytest.raises(
            StorageUnavailable, match=f"Connection refused; tried for 0.1 s: check the NameNode {address}"
        ):
            storage_at(address, patience_s=0.1).read("a")


def test_a_datanode_whose_name_leads_nowhere_is_named() -> None:
    redirect = Answer(307, "", {"Location": "http://no-such-node.invalid:9864/webhdfs/v1/fleet/a?op=OPEN"})
    with (
        namenode(redirect) as stand_in,
        pytest.raises(StorageUnavailable, match=re.escape("check the DataNode no-such-node.invalid:9864")),
    ):
        storage_at(stand_in.address, patience_s=0.1).read("a")


@pytest.mark.parametrize(
    ("answer", "error", "advice"),
    [
        (Answer(401, "who are you"), StorageUnavailable, "set FLEET_STORAGE_TOKEN or FLEET_STORAGE_TOKEN_FILE"),
        (refusal("InvalidToken", "token is expired"), StorageUnavailable, "token is expired; set FLEET_STORAGE_TOKEN"),
        (refusal("AccessControlException", "Permission denied"), StorageUnavailable, "let user fleet read it"),
        (refusal("UnsupportedOperationException", "no such op", 400), StorageError, "Hadoop 3.3 or later"),
        (refusal("NSQuotaExceededException", "The NameSpace quota"), StorageFull, "free space or raise the quota"),
        (
            refusal("IOException", f"{WRITTEN_TO} 0 of the 2 minReplication nodes. There are 3 datanode(s) running"),
            StorageFull,
            "of those that run, too few have space",
        ),
        (
            refusal("IOException", f"{WRITTEN_TO} 1 of the 2 minReplication nodes. There are 1 datanode(s) running"),
            StorageUnavailable,
            "start DataNodes until 2 run",
        ),
    ],
)  # fmt: skip
def test_a_refusal_says_what_to_change(answer: Answer, error: type[StorageError], advice: str) -> None:
    with namenode(answer) as stand_in:
        with pytest.raises(error, match=advice) as caught:
            storage_at(stand_in.address, patience_s=0.1).exists("a")
        assert type(caught.value) is error


@pytest.mark.parametrize(
    ("free", "error", "advice"),
    [
        ([10**9, 1000, 1000], StorageFull, "of those that run, too few have space"),
        ([10**9, 10**9, 1000], StorageUnavailable, "takes for alive is gone or cannot be reached"),
        ([10**9], StorageUnavailable, "start DataNodes until 2 run"),
    ],
)
def test_whether_datanodes_are_full_or_gone_is_asked(free: list[int], error: type[StorageError], advice: str) -> None:
    nodes = json.dumps({f"node-{number}:9866": {"remaining": size} for number, size in enumerate(free)})
    refused = refusal("IOException", f"{WRITTEN_TO} 1 of the 2 minReplication nodes. There are 3 datanode(s) running")
    with namenode(refused, Answer(200, {"beans": [{"LiveNodes": nodes}]})) as stand_in:
        with pytest.raises(error, match=advice) as caught:
            storage_at(stand_in.address, patience_s=0.0).exists("a")
        assert type(caught.value) is error


def test_a_delegation_token_takes_the_place_of_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "token"
    with namenode(FILE) as stand_in:
        storage = storage_at(stand_in.address)
        storage.exists("a")
        monkeypatch.setenv("FLEET_STORAGE_TOKEN_FILE", str(file))
        with pytest.raises(StorageUnavailable, match=f"FLEET_STORAGE_TOKEN_FILE is {file}, which cannot be read"):
            storage.exists("a")
        for token in ("first", "renewed"):
            file.write_text(f"{token}\n")
            storage.exists("a")
        monkeypatch.setenv("FLEET_STORAGE_TOKEN", "given")
        storage.exists("a")
    op = {"op": "GETFILESTATUS"}
    tokens = [{"delegation": token, **op} for token in ("first", "renewed", "given")]
    assert stand_in.queries == [{"user.name": "fleet", **op}, *tokens]


def test_a_proxy_for_the_internet_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    monkeypatch.delenv("no_proxy", raising=False)
    with namenode(FILE) as stand_in:
        assert storage_at(stand_in.address, patience_s=0.1).exists("a")


# servers of somebody who means no good

HEAD = b"HTTP/1.1 200 OK\r\nContent-Length: 1000000000\r\n"
DRIPS = {
    "no answer": (b"", [b""] * 1000),
    "a head": (b"HTTP/1.1 200 OK\r\n", [b"X"] * 1000),
    "many heads": (b"HTTP/1.1 200 OK\r\n", [b"X: 1\r\n"] * 1000),
    "a body": (b"HTTP/1.1 200 OK\r\nContent-Length: 900\r\n\r\n", [b"x"] * 900),
    "the size of a chunk": (b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", [b"0"] * 1000),
}
SMALL = Limits(object_bytes=1000, call_s=0.3)


def bounded(host: str, patience_s: float = 0.0, limits: Limits = SMALL) -> HdfsStorage:
    return HdfsStorage(WebHdfsAddress((host,), "/fleet", "fleet"), patience_s, limits)


@pytest.mark.parametrize("answer", [(HEAD + b"\r\n", [b""]), ENDLESS], ids=["said", "not said"])
def test_an_object_that_is_too_large_is_not_read(answer: tuple[bytes, list[bytes]]) -> None:
    with (
        sender(*answer) as address,
        pytest.raises(StorageError, match="this process reads objects of at most 0 MiB; make it smaller"),
    ):
        bounded(address, patience_s=30.0, limits=Limits(1000, 30.0)).read("a")


def test_an_answer_that_is_no_object_is_not_read_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fleet.storage.webhdfs.DOCUMENT_BYTES", 1 << 20)
    with sender(*ENDLESS) as address, pytest.raises(StorageError, match="objects of at most 1 MiB"):
        bounded(address, limits=Limits(call_s=30.0)).exists("a")


@pytest.mark.parametrize("drip", DRIPS.values(), ids=DRIPS)
@pytest.mark.parametrize("act", ["read", "exists"])
def test_data_that_drips_prolongs_no_call(act: str, drip: tuple[bytes, list[bytes]]) -> None:
    with sender(*drip, pause_s=0.1) as address, pytest.raises(StorageUnavailable, match=r"(?i)timed out|too long"):
        getattr(bounded(address), act)("a")


def test_the_time_of_a_pass_counts_over_all_of_its_calls() -> None:
    with sender(*DRIPS["a body"], pause_s=0.1) as address:
        storage = bounded(address, patience_s=60.0, limits=Limits(call_s=60.0))
        with within(0.3):
            with pytest.raises(StorageUnavailable):
                storage.read("a")
            with pytest.raises(StorageUnavailable, match="no time is left for it"):
                storage.exists("a")
    with namenode(FILE) as stand_in:
        assert bounded(stand_in.address).exists("a")


@pytest.mark.parametrize(
    "location",
    [
        "http://169.254.169.254/latest/meta-data/",
        "http://127.0.0.1:6443/api/v1/secrets",
        "https://127.0.0.1:6443/webhdfs/v1/fleet/a",
        "//127.0.0.1:1/elsewhere",
        "ftp://127.0.0.1/webhdfs/v1/fleet/a",
    ],
)
def test_an_answer_leads_to_servers_of_webhdfs_only(location: str) -> None:
    with (
        namenode(Answer(307, "", {"Location": location})) as stand_in,
        pytest.raises(StorageUnavailable, match="which is no address of WebHDFS"),
    ):
        bounded(stand_in.address).read("a")


def test_an_answer_that_leads_in_a_circle_is_not_followed_for_long() -> None:
    circle = Answer(307, "", {"Location": "/webhdfs/v1/fleet/a?op=OPEN"})
    with (
        namenode(circle) as stand_in,
        pytest.raises(StorageUnavailable, match="Exceeded 3 redirects"),
    ):
        bounded(stand_in.address, limits=Limits(call_s=30.0)).read("a")
    assert len(stand_in.queries) == 4


def test_connections_are_kept() -> None:
    with namenode(FILE) as stand_in:
        storage = bounded(stand_in.address, limits=Limits())
        assert [(storage.exists("a"), len(storage.read("a"))) for _ in range(3)] == [(True, 86)] * 3
    assert stand_in.connections == 1
