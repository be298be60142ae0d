"""Addresses of storage in HDFS: `webhdfs://user@namenode:9870/folder`."""

from __future__ import annotations

import getpass
import os
import re
from dataclasses import dataclass, replace
from urllib.parse import SplitResult, parse_qs, urlencode, urlsplit

from fleet.errors import Problem, SpecError
from fleet.spec.platform import StorageSpec
from fleet.storage.paths import is_part

SCHEME = "webhdfs"
PORT = 9870
"""The NameNode's HTTP port in Hadoop 3."""
_EXAMPLE = f"write {SCHEME}://user@namenode:{PORT}/folder"
_HOST = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::(?P<port>[0-9]{1,5}))?")
_USER = re.compile(r"[A-Za-z0-9._@-]+")
_COPIES = StorageSpec.model_fields["replication"].default


@dataclass(frozen=True)
class WebHdfsAddress:
    """Where HDFS is, and as whom it is spoken to.

    Args:
        hosts: `host:port` of each NameNode's HTTP server; one of them is active.
        root: Folder of everything, from `/`.
        user: Who owns what is written, where HDFS believes what its clients say (no Kerberos).
        replication: Copies of each object.
        on_behalf_of: Who acts, when `user` may act for others (`hadoop.proxyuser` in HDFS); "" for `user` himself.
    """

    hosts: tuple[str, ...]
    root: str
    user: str
    replication: int = _COPIES
    on_behalf_of: str = ""

    def __str__(self) -> str:
        query = {"replication": str(self.replication)} if self.replication != _COPIES else {}
        query |= {"doas": self.on_behalf_of} if self.on_behalf_of else {}
        asked = f"?{urlencode(query, safe='@')}" if query else ""
        return f"{SCHEME}://{self.user}@{','.join(self.hosts)}{self.root}{asked}"

    @staticmethod
    def parse(uri: str) -> WebHdfsAddress:
        """Read `webhdfs://[user@]host[:9870][,host2[:9870]]/root/folder[?replication=N][&doas=user]`.

        Raises:
            SpecError: it is not such an address; says what to write instead.
        """
        parts = urlsplit(uri)
        user, at, hosts = parts.netloc.rpartition("@")
        if at and not _USER.fullmatch(user):
            raise wrong(uri, "has no user's name before the @", f"{_EXAMPLE}, without a password")
        names = tuple(_host(uri, host) for host in hosts.split(","))
        copies, other = _options(uri, parts)
        return WebHdfsAddress(names, _root(uri, parts), user or _own_name(), copies, other)


def with_copies(uri: str, copies: int) -> str:
    """The address of the same storage that keeps this many copies, or what the address asks for when that is more.

    HDFS may refuse fewer copies than the installation keeps (`dfs.namenode.replication.min`).

    Args:
        uri: Any address of a storage; those of other kinds stay as they are.
    """
    if urlsplit(uri).scheme != SCHEME:
        return uri
    address = WebHdfsAddress.parse(uri)
    return str(replace(address, replication=max(copies, address.replication)))


def wrong(uri: str, message: str, hint: str) -> SpecError:
    """The error for an address that is not one."""
    return SpecError([Problem("storage.uri", f"{uri!r} {message}", hint)])


def _host(uri: str, text: str) -> str:
    found = _HOST.fullmatch(text)
    if not found or not 0 < int(found["port"] or PORT) < 1 << 16:
        raise wrong(uri, f"has {text!r} where a NameNode's host and HTTP port belong", _EXAMPLE)
    if found["port"] in {"8020", "9000"}:
        rpc = f"names port {found['port']}, which is the NameNode's RPC port"
        raise wrong(uri, rpc, f"write its HTTP port: {found['host']}:{PORT}")
    return f"{found['host']}:{found['port'] or PORT}"


def _root(uri: str, parts: SplitResult) -> str:
    names = parts.path.strip("/").split("/")
    if names == [""]:
        hint = f"write {SCHEME}://{parts.netloc}/fleet, or another folder that the user may write"
        raise wrong(uri, "names no folder of HDFS", hint)
    if not all(is_part(name) for name in names):
        raise wrong(uri, "has a folder with other characters than letters, digits, '.', '_' and '-'", _EXAMPLE)
    return "/" + "/".join(names)


def _options(uri: str, parts: SplitResult) -> tuple[int, str]:
    given = parse_qs(parts.query, keep_blank_values=True)
    unknown = sorted(set(given) - {"replication", "doas"})
    if unknown or parts.fragment:
        what = (unknown or ["a #"])[0]
        raise wrong(uri, f"has {what!r} after the folder", "only ?replication=N and doas=USER may be there")
    copies, user = given.get("replication", [str(_COPIES)])[-1], given.get("doas", [""])[-1]
    if not copies.isdigit() or not 1 <= int(copies) <= 512:
        raise wrong(uri, f"asks for {copies!r} copies", f"write a number: ?replication={_COPIES}")
    if "doas" in given and not _USER.fullmatch(user):
        raise wrong(uri, f"has {user!r} after doas=", "write the user's name: ?doas=alice")
    return int(copies), user


def _own_name() -> str:
    """As Hadoop's own clients do it: HADOOP_USER_NAME, or the user of this process."""
    try:
        return os.environ.get("HADOOP_USER_NAME") or getpass.getuser()
    except (KeyError, OSError):  # a container's user id often has no name
        return "fleet"
