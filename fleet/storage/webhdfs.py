"""The door to HDFS: one call of WebHDFS each, with refusals as `Refused`; nothing is tried twice here.

Source: the WebHDFS REST API of Hadoop 3.5.0. A NameNode answers CREATE, APPEND and OPEN with the address of a DataNode,
which takes or gives the data.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import re
import socket
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar
from urllib.parse import urlsplit

import requests
from hdfs.client import Client, _Request
from hdfs.util import HdfsError
from urllib3.exceptions import NewConnectionError

from fleet.storage.limits import Limits, left_s, within
from fleet.storage.webhdfs_address import WebHdfsAddress
from fleet.storage.webhdfs_answers import Fate, Refused, fate_of
from fleet.storage.webhdfs_identity import identity
from fleet.storage.webhdfs_transport import DOCUMENT_BYTES, TAKEN_S, Session, TooLarge, checked

CONNECTIONS = 8
"""How many calls one process has under way; further ones wait."""
CONNECT_S, ANSWER_S = 3.0, 15.0
MOST_WAIT_S = 60.0
_POOL = re.compile(r"\w+\(host=.*?\): ")
T = TypeVar("T")
logging.getLogger("hdfs.client").setLevel(logging.CRITICAL)  # what it meets is told by our errors, once


@dataclass(frozen=True)
class FileStatus:
    """A file or folder of HDFS.

    Args:
        number: Of the file, in HDFS: another file of the same path has another one. 0 when the server does not tell.
    """

    name: str
    is_folder: bool
    size_bytes: int
    children: int
    modified_s: float
    number: int = 0


@dataclass(frozen=True)
class Block:
    """A part of a file, and the DataNodes that have it."""

    size_bytes: int
    hosts: tuple[str, ...]


# The package has no types, and no public way to add an operation.
class _Client(Client):  # type: ignore[misc]
    """The package's client with the operations that it lacks, and with our own identity."""

    _truncate = _Request("POST")
    _get_file_block_locations = _Request("GET")

    def __init__(self, address: WebHdfsAddress) -> None:
        urls = ";".join(f"http://{host}" for host in address.hosts)
        timeouts = (CONNECT_S, ANSWER_S)
        super().__init__(urls, proxy=address.on_behalf_of or None, timeout=timeouts, session=Session())
        self._address = address

    def send(self, method: str, url: str, data: bytes) -> requests.Response:
        """Send data to a DataNode."""
        headers = {"Content-Type": "application/octet-stream"} | ({"Expect": "100-continue"} if data else {})
        session: requests.Session = self._session
        return session.request(method, url, data=data, headers=headers, timeout=(CONNECT_S, TAKEN_S))

    def reads(self, most_bytes: int) -> None:
        """Let the answers of the calls from now on be so large."""
        session: Session = self._session
        session.most_bytes = most_bytes

    def jmx(self, bean: str) -> requests.Response:
        """What the active NameNode says of itself."""
        session: requests.Session = self._session
        return session.get(f"{self._urls[0]}/jmx", params={"qry": bean}, timeout=(CONNECT_S, ANSWER_S))

    def _request(self, method: str, url: str, **kwargs: Any) -> requests.Response:
        if "params" in kwargs:  # a NameNode; the address of a DataNode has everything in it
            kwargs["params"] |= identity(self._address)
        response: requests.Response = super()._request(method, url, **kwargs)
        return response


class WebHdfs:
    """Calls of WebHDFS; many threads may use it, and connections are kept.

    Every call may raise Refused.
    """

    def __init__(self, address: WebHdfsAddress, limits: Limits | None = None) -> None:
        self._address, self._limits = address, limits or Limits()
        self._owner, self._idle = 0, _slots()

    def create(self, path: str, data: bytes, avoid: Collection[str] = ()) -> None:
        """Make or replace a file with a DataNode that is none of `avoid`."""
        copies = {"overwrite": "true", "replication": str(self._address.replication)}
        redirect = self._call(lambda client: client._create(path, strict=False, **copies, **_excluded(avoid)))
        self._send("PUT", _location(redirect), data)

    def append(self, path: str, data: bytes, url: str, avoid: Collection[str] = ()) -> str:
        """Add to the end of a file; gives the address of the DataNode, for the next time.

        Args:
            url: The address of a DataNode from the last time, or "".
        """
        if not url:
            try:
                redirect = self._call(lambda client: client._append(path, strict=False, **_excluded(avoid)))
            except Refused as refused:
                refused.sent = False
                raise
            url = _location(redirect)
        self._send("POST", url, data)
        return url

    def read(self, path: str, avoid: Collection[str] = ()) -> bytes:
        """A whole file."""

        def whole(client: _Client) -> requests.Response:
            client.reads(self._limits.object_bytes)
            response: requests.Response = client._open(path, strict=False, **_excluded(avoid))
            return response

        return self._call(whole).content

    def rename(self, source: str, target: str) -> None:
        """Give a file another path, in place of the file that has it."""
        self._call(lambda client: client._rename(source, strict=False, destination=target, renameoptions="OVERWRITE"))

    def delete(self, path: str) -> None:
        """Remove a file or a folder; nothing happens when there is none."""
        self._call(lambda client: client._delete(path, strict=False, recursive="true"))

    def truncate(self, path: str, size_bytes: int) -> None:
        """Cut a file off at its first bytes. Refused as LEASED while HDFS still works on that, some seconds long."""
        answer = self._call(lambda client: client._truncate(path, strict=False, newlength=str(size_bytes)))
        if not _parsed(answer, lambda document: bool(document["boolean"])):
            raise Refused(Fate.LEASED, "the file is being cut off")

    def status(self, path: str) -> FileStatus:
        """What a path is."""
        answer = self._call(lambda client: client._get_file_status(path, strict=False))
        return _parsed(answer, lambda document: _status(document["FileStatus"]))

    def contents(self, path: str) -> list[FileStatus]:
        """What is in a folder; a file lists itself without a name."""
        answer = self._call(lambda client: client._list_status(path, strict=False))
        return _parsed(answer, lambda document: [_status(one) for one in document["FileStatuses"]["FileStatus"]])

    def blocks(self, path: str) -> list[Block]:
        """Where a file is; the server still names a DataNode that it has not noticed to be gone."""
        answer = self._call(lambda client: client._get_file_block_locations(path, strict=False))

        def parse(document: dict[str, Any]) -> list[Block]:
            found = document["BlockLocations"].get("BlockLocation", [])
            return [Block(int(one["length"]), tuple(one["hosts"])) for one in found]

        return _parsed(answer, parse)

    def room(self) -> list[int]:
        """Bytes free on each DataNode that the NameNode takes for alive; empty when it does not tell."""
        bean = "Hadoop:service=NameNode,name=NameNodeInfo"

        def parse(document: dict[str, Any]) -> list[int]:
            return [int(node["remaining"]) for node in json.loads(document["beans"][0]["LiveNodes"]).values()]

        try:
            return _parsed(self._call(lambda client: client.jmx(bean)), parse)
        except (Refused, IndexError):
            return []

    def _send(self, method: str, url: str, data: bytes) -> None:
        self._call(lambda client: client.send(method, url, data))

    def _call(self, ask: Callable[[_Client], requests.Response]) -> requests.Response:
        """One call over an idle connection. Raises Refused for everything but success."""
        if left_s() <= 0:
            raise Refused(Fate.PASSING, "no time is left for it", sent=False)
        with self._client() as client, within(self._limits.call_s):
            client.reads(DOCUMENT_BYTES)
            try:
                response = ask(client)
            except HdfsError as error:  # the package has asked each NameNode, or has met a status 401
                fate = Fate.PASSING if error.exception else Fate.STRANGER
                raise Refused(fate, error.message) from error
            except TooLarge as error:
                raise Refused(Fate.TOO_LARGE, str(error)) from error
            except requests.RequestException as error:
                raise self._unanswered(error) from error
            except (KeyError, TypeError) as error:  # an error in JSON that is not WebHDFS's
                raise Refused(Fate.PASSING, "the server answers in another way than WebHDFS") from error
        if response.ok:
            return response
        raise self._refused(response)

    def _unanswered(self, error: requests.RequestException) -> Refused:
        """No answer: the data may have arrived, unless there was no connection."""
        reason = getattr(error.args[0] if error.args else None, "reason", None)
        connected = not isinstance(error, requests.ConnectTimeout) and not isinstance(reason, NewConnectionError)
        url = error.request.url if error.request is not None else ""
        return Refused(Fate.PASSING, _plain(error), self._node(str(url or "")), sent=connected)

    def _refused(self, response: requests.Response) -> Refused:
        exception, message = "", f"it answered with status {response.status_code} {response.reason}"
        try:
            said = response.json()["RemoteException"]
            exception, message = str(said["exception"]), str(said["message"])
        except (ValueError, KeyError, TypeError):
            pass
        wait = response.headers.get("Retry-After", "")
        return Refused(
            fate_of(response.status_code, exception, message),
            message,
            self._node(response.url),
            wait_s=min(float(wait), MOST_WAIT_S) if wait.isdigit() else 0.0,
        )

    def _node(self, url: str) -> str:
        """The DataNode that an address is of; "" for a NameNode."""
        place = urlsplit(url).netloc
        return "" if place in self._address.hosts else place

    @contextmanager
    def _client(self) -> Iterator[_Client]:
        """A client that nobody else uses meanwhile."""
        if self._owner != os.getpid():  # a forked process must not share its parent's connections
            self._owner, self._idle = os.getpid(), _slots()
        idle = self._idle
        client = idle.get()
        try:
            client = client or _Client(self._address)
            yield client
        finally:
            idle.put(client)


def _slots() -> queue.LifoQueue[_Client | None]:
    """Places for clients; those used last are used again first, so that few connections are open."""
    slots: queue.LifoQueue[_Client | None] = queue.LifoQueue()
    for _ in range(CONNECTIONS):
        slots.put(None)
    return slots


def _excluded(nodes: Collection[str]) -> dict[str, str]:
    """The parameter that keeps a NameNode from sending us to these DataNodes: it knows them by their IP addresses."""
    found = set()
    for node in nodes:
        try:
            found.add(socket.gethostbyname(urlsplit(f"//{node}").hostname or ""))
        except OSError:  # the name leads nowhere: that may be why it is to be avoided
            continue
    return {"excludedatanodes": ",".join(sorted(found))} if found else {}


def _location(redirect: requests.Response) -> str:
    url = redirect.headers.get("Location", "")
    if not url:
        raise Refused(Fate.PASSING, "the server names no DataNode: is this a NameNode's HTTP port?", sent=False)
    try:
        return checked(url, redirect.url)
    except requests.RequestException as error:
        raise Refused(Fate.PASSING, str(error), sent=False) from error


def _parsed(answer: requests.Response, parse: Callable[[dict[str, Any]], T]) -> T:
    try:
        return parse(answer.json())
    except (ValueError, KeyError, TypeError) as error:
        raise Refused(Fate.PASSING, "the server answers in another way than WebHDFS") from error


def _status(document: dict[str, Any]) -> FileStatus:
    return FileStatus(
        str(document["pathSuffix"]),
        document["type"] == "DIRECTORY",
        int(document["length"]),
        int(document.get("childrenNum", -1)),
        int(document["modificationTime"]) / 1000,
        int(document.get("fileId", 0)),
    )


def _plain(error: requests.RequestException) -> str:
    """What happened, without the names of Python's objects."""
    cause: object = error
    while isinstance(cause, Exception) and cause.args and isinstance(cause.args[-1], Exception):
        cause = cause.args[-1]
    return _POOL.sub("", str(getattr(cause, "reason", None) or cause))
