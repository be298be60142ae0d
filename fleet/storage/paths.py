"""What a path in storage may look like; every backend checks with this."""

from __future__ import annotations

import re

from fleet.errors import StorageError

_PART = re.compile(r"[A-Za-z0-9._-]+")


def is_part(name: str) -> bool:
    """Whether a name may stand between two `/` of a path."""
    return _PART.fullmatch(name) is not None and name not in {".", ".."}


def object_parts(path: str) -> tuple[str, ...]:
    """The parts of an object's path.

    Raises:
        StorageError: the path is empty, absolute, leaves its folder, or has other characters than the port allows.
    """
    parts = tuple(path.split("/"))
    if not all(is_part(part) for part in parts):
        raise StorageError(
            f"{path!r} is not a path in storage; write names of letters, digits, '.', '_' and '-', joined by '/', "
            "without a '/' at either end"
        )
    return parts


def folder_parts(prefix: str) -> tuple[str, ...]:
    """The parts of a folder's path; "" is the folder of everything. Raises StorageError as `object_parts` does."""
    return object_parts(prefix) if prefix else ()
