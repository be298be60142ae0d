"""Addresses of storage in HDFS: what they may say, and what to write instead of a wrong one."""

from __future__ import annotations

import pytest

from fleet.errors import SpecError
from fleet.storage.open import open_storage
from fleet.storage.webhdfs_address import WebHdfsAddress, with_copies


@pytest.mark.parametrize(
    ("uri", "address", "canonical"),
    [
        (
            "webhdfs://fleet@namenode/fleet",
            WebHdfsAddress(("namenode:9870",), "/fleet", "fleet"),
            "webhdfs://fleet@namenode:9870/fleet",
        ),
        (
            "webhdfs://alice@nn1.farm:50070,nn2.farm/data/fleet/?replication=3&doas=bob@farm",
            WebHdfsAddress(("nn1.farm:50070", "nn2.farm:9870"), "/data/fleet", "alice", 3, "bob@farm"),
            "webhdfs://alice@nn1.farm:50070,nn2.farm:9870/data/fleet?replication=3&doas=bob@farm",
        ),
        (
            "webhdfs://fleet@[fd00::1]:9870/fleet?replication=2",
            WebHdfsAddress(("[fd00::1]:9870",), "/fleet", "fleet"),
            "webhdfs://fleet@[fd00::1]:9870/fleet",
        ),
    ],
)
def test_an_address_is_read_and_written(uri: str, address: WebHdfsAddress, canonical: str) -> None:
    assert WebHdfsAddress.parse(uri) == address
    assert open_storage(uri).uri == canonical
    assert WebHdfsAddress.parse(canonical) == address


def test_without_a_user_it_is_who_runs_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HADOOP_USER_NAME", "carol")
    assert open_storage("webhdfs://namenode/fleet").uri == "webhdfs://carol@namenode:9870/fleet"


@pytest.mark.parametrize(
    ("uri", "advice"),
    [
        ("hdfs://nn:8020/fleet", "is Hadoop's own protocol; write webhdfs://user@nn:9870/folder"),
        ("swebhdfs://nn:9871/fleet", "needs TLS, which is not spoken here; write webhdfs://user@nn:9870/folder"),
        ("webhdfs://nn:8020/fleet", "port 8020, which is the NameNode's RPC port; write its HTTP port: nn:9870"),
        ("webhdfs://fleet@nn:9870", "names no folder of HDFS; write webhdfs://fleet@nn:9870/fleet"),
        ("webhdfs://fleet@nn/", "names no folder of HDFS"),
        ("webhdfs:///fleet", "has '' where a NameNode's host and HTTP port belong; write webhdfs://user@namenode:9870"),
        ("webhdfs://nn:99999/fleet", "has 'nn:99999' where"),
        ("webhdfs://nn,/fleet", "has '' where"),
        ("webhdfs://fleet:secret@nn/fleet", "no user's name before the @; .* without a password"),
        ("webhdfs://@nn/fleet", "no user's name before the @"),
        ("webhdfs://nn/my fleet", "a folder with other characters"),
        ("webhdfs://nn/a/../b", "a folder with other characters"),
        ("webhdfs://nn/fleet?copies=3", r"has 'copies' after the folder; only \?replication=N and doas=USER"),
        ("webhdfs://nn/fleet#a", "has 'a #' after the folder"),
        ("webhdfs://nn/fleet?replication=two", r"asks for 'two' copies; write a number: \?replication=2"),
        ("webhdfs://nn/fleet?replication=0", "asks for '0' copies"),
        ("webhdfs://nn/fleet?doas=", "has '' after doas="),
    ],
)
def test_wrong_addresses_say_what_to_write(uri: str, advice: str) -> None:
    with pytest.raises(SpecError, match=advice) as caught:
        open_storage(uri)
    assert caught.value.problems[0].path == "storage.uri"


def test_a_patience_that_is_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEET_STORAGE_PATIENCE_S", "long")
    with pytest.raises(SpecError, match="FLEET_STORAGE_PATIENCE_S: 'long' is not a number of seconds"):
        open_storage("webhdfs://nn/fleet")


@pytest.mark.parametrize(
    ("uri", "copies", "expected"),
    [
        ("webhdfs://fleet@nn:9870/fleet", 3, "webhdfs://fleet@nn:9870/fleet?replication=3"),
        ("webhdfs://fleet@nn:9870/fleet", 2, "webhdfs://fleet@nn:9870/fleet"),
        ("webhdfs://fleet@nn:9870/fleet", 1, "webhdfs://fleet@nn:9870/fleet"),
        ("webhdfs://fleet@nn:9870/fleet?replication=4", 3, "webhdfs://fleet@nn:9870/fleet?replication=4"),
        ("webhdfs://fleet@nn:9870/fleet?replication=3", 4, "webhdfs://fleet@nn:9870/fleet?replication=4"),
        ("webhdfs://fleet@nn:9870/fleet?replication=1", 1, "webhdfs://fleet@nn:9870/fleet?replication=1"),
        ("file:///var/fleet", 3, "file:///var/fleet"),
    ],
)
def test_an_address_is_given_the_larger_number_of_copies(uri: str, copies: int, expected: str) -> None:
    assert with_copies(uri, copies) == expected
