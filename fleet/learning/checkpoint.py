"""The state of shaping or training in storage, so that one that was killed goes on where it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fleet.errors import ObjectNotFound
from fleet.storage.port import Storage


@dataclass(frozen=True)
class Checkpoint:
    """One JSON document that is replaced as a whole.

    Args:
        storage, path: Where it is.
        fingerprint: Of everything that the result depends on; a document with another one counts as none.
    """

    storage: Storage
    path: str
    fingerprint: str

    def load(self) -> dict[str, Any] | None:
        """The state that was saved last; None when there is none, or it belongs to another problem."""
        try:
            document = json.loads(self.storage.read(self.path))
        except (ObjectNotFound, ValueError):
            return None
        if not isinstance(document, dict) or document.get("fingerprint") != self.fingerprint:
            return None
        state = document.get("state")
        return state if isinstance(state, dict) else None

    def save(self, state: Mapping[str, Any]) -> None:
        """Replace the state; JSON keeps every bit of a float."""
        document = {"fingerprint": self.fingerprint, "state": state}
        self.storage.write(self.path, json.dumps(document, indent=1, sort_keys=True).encode())


def fingerprint(*parts: object) -> str:
    """A hash of parts by their bytes or their text."""
    digest = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(hashlib.sha256(data).digest())
    return digest.hexdigest()
