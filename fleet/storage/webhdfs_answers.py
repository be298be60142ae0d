"""What WebHDFS says when it does not do what it is asked: what that means, and the library's own error for it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum, auto

from fleet.errors import ObjectNotFound, StorageError, StorageFull, StorageReadOnly, StorageUnavailable
from fleet.storage.webhdfs_address import WebHdfsAddress

ROOM_BYTES = 256 << 20
"""A DataNode with this much space takes a block of the usual size."""


class Fate(StrEnum):
    """What a refusal means for the operation."""

    ABSENT = auto()
    """Nothing has this path."""
    NO_FOLDER = auto()
    """A part of the path is an object: nothing can be under it."""
    WRONG_PATH = auto()
    FULL = auto()
    """A quota is used up."""
    NO_NODES = auto()
    """Too few DataNodes take a block: some are gone, or have no space."""
    DENIED = auto()
    STRANGER = auto()
    """The server does not believe who we are."""
    LEASED = auto()
    """Somebody is writing the file, or the server takes it for so."""
    UNCLOSED = auto()
    """The writer of the file is gone, and so are the machines that know its length."""
    COPIES = auto()
    """The server does not keep as many copies as are asked for."""
    UNSUPPORTED = auto()
    TOO_LARGE = auto()
    """More than this process is willing to read."""
    PASSING = auto()


class Refused(Exception):
    """An answer that is not the one wished for, or none. It never leaves the storage.

    Args:
        text: What the server said, or why it could not be asked.
        node: The DataNode that was spoken to; "" for the NameNode.
        sent: Whether data may have been taken.
        wait_s: How long the server asks to wait.
    """

    def __init__(self, fate: Fate, text: str, node: str = "", *, sent: bool = True, wait_s: float = 0.0) -> None:
        super().__init__(text)
        self.fate, self.text, self.node, self.sent, self.wait_s = fate, text, node, sent, wait_s


_FATES = {
    "FileNotFoundException": Fate.ABSENT,
    "ParentNotDirectoryException": Fate.NO_FOLDER,
    "FileAlreadyExistsException": Fate.WRONG_PATH,
    "PathIsDirectoryException": Fate.WRONG_PATH,
    "PathComponentTooLongException": Fate.WRONG_PATH,
    "MaxDirectoryItemsExceededException": Fate.FULL,
    "DSQuotaExceededException": Fate.FULL,
    "NSQuotaExceededException": Fate.FULL,
    "QuotaByStorageTypeExceededException": Fate.FULL,
    "QuotaExceededException": Fate.FULL,
    "AccessControlException": Fate.DENIED,
    "AuthorizationException": Fate.STRANGER,
    "AuthenticationException": Fate.STRANGER,
    "InvalidToken": Fate.STRANGER,
    "SecurityException": Fate.STRANGER,
    "AlreadyBeingCreatedException": Fate.LEASED,
    "RecoveryInProgressException": Fate.LEASED,
    "IllegalArgumentException": Fate.UNSUPPORTED,
    "UnsupportedOperationException": Fate.UNSUPPORTED,
}
# Where the class of the exception says nothing, its words do.
_WORDS = (
    ("is not a directory", Fate.NO_FOLDER),
    ("must both be directories", Fate.WRONG_PATH),
    ("is a directory", Fate.WRONG_PATH),
    ("Path is not a file", Fate.WRONG_PATH),
    ("could only be written to", Fate.NO_NODES),
    ("Requested replication factor", Fate.COPIES),
    ("exceeds maximum of", Fate.COPIES),
    ("less than the required minimum", Fate.COPIES),
    ("not allowed to impersonate", Fate.STRANGER),
    ("Unauthorized connection for super-user", Fate.STRANGER),
    ("Cannot obtain block length", Fate.UNCLOSED),
)


def fate_of(status: int, exception: str, message: str) -> Fate:
    """What an answer means.

    Args:
        status: HTTP status.
        exception, message: Of the answer's RemoteException; "" where it has none.
    """
    for words, fate in _WORDS:
        if words in message:
            return fate
    if status == 401:
        return Fate.STRANGER
    return _FATES.get(exception, Fate.PASSING)


@dataclass(frozen=True)
class Act:
    """One operation on an object, for the words of its error.

    Args:
        verb: `write`, `append to`, `read`, ...
        changes: Whether it changes the storage.
    """

    verb: str
    path: str
    address: WebHdfsAddress
    changes: bool = False

    def error(self, refused: Refused, patience_s: float, room: Sequence[int] = ()) -> StorageError:
        """The error that tells what to do about a refusal.

        Args:
            patience_s: How long it was tried.
            room: Bytes free on each DataNode, where they took no block and the NameNode tells.
        """
        said = refused.text.strip().partition("\n")[0].rstrip(".")  # the rest are names of Java methods
        kind: type[StorageError] = StorageError
        match refused.fate:
            case Fate.ABSENT | Fate.NO_FOLDER | Fate.WRONG_PATH if not self.changes:
                return ObjectNotFound(f"there is no object {self.path} in {self.address}")
            case Fate.ABSENT | Fate.NO_FOLDER | Fate.WRONG_PATH:
                advice = "use another path"
            case Fate.FULL:
                kind, advice = StorageFull, f"free space or raise the quota (hdfs dfsadmin -setSpaceQuota) {_SAFE}"
            case Fate.NO_NODES:
                kind, advice = self._without_nodes(said, room)
            case Fate.DENIED if self.changes:
                kind = StorageReadOnly
                advice = f"make the directory writable for user {self._user}, or choose another storage address"
            case Fate.DENIED:
                kind, advice = StorageUnavailable, f"let user {self._user} read it"
            case Fate.STRANGER:
                kind, advice = StorageUnavailable, self._identity_advice()
            case Fate.COPIES:
                advice = (
                    "ask for another number of copies (storage.replication, or ?replication= in the address), or "
                    "change dfs.namenode.replication.min or dfs.replication.max of HDFS"
                )
            case Fate.TOO_LARGE:
                advice = "make it smaller, or let this process read more"
            case Fate.UNSUPPORTED:
                advice = "WebHDFS of Hadoop 3.3 or later is needed"
            case Fate.LEASED | Fate.UNCLOSED | Fate.PASSING:
                whom = f"DataNode {refused.node}" if refused.node else f"NameNode {', '.join(self.address.hosts)}"
                kind, advice = StorageUnavailable, f"tried for {patience_s:g} s: check the {whom}, then try again"
        return kind(f"cannot {self.verb} {self.path} in {self.address}: {said}; {advice}")

    def _without_nodes(self, said: str, room: Sequence[int]) -> tuple[type[StorageError], str]:
        """No block is taken where machines are gone and where they are full; HDFS says it in the same words."""
        copies = self.address.replication
        counted = re.search(r"There are (\d+) datanode\(s\) running", said)
        running = len(room) or (int(counted[1]) if counted else 0)
        if running < copies:
            return StorageUnavailable, f"start DataNodes until {copies} run"
        if sum(free >= ROOM_BYTES for free in room) >= copies:
            return (
                StorageUnavailable,
                "one that HDFS takes for alive is gone or cannot be reached: start it, then try again",
            )
        return (
            StorageFull,
            f"free space or raise the quota, or add DataNodes: of those that run, too few have space {_SAFE}",
        )

    @property
    def _user(self) -> str:
        return self.address.on_behalf_of or self.address.user

    def _identity_advice(self) -> str:
        if self.address.on_behalf_of:
            return f"set hadoop.proxyuser.{self.address.user}.hosts and .groups in HDFS, or leave out doas"
        return "set FLEET_STORAGE_TOKEN or FLEET_STORAGE_TOKEN_FILE to a delegation token that is valid"


_SAFE = "- then run again: everything that was acknowledged before is safe"
