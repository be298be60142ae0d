"""The small files of an application that its pods need: function sources, profiles, a pre-trained model."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from fleet.errors import Problem, SpecError

LARGEST_BYTES = 900 * 1024
"""A ConfigMap holds 1 MiB with everything around it (Kubernetes, "ConfigMaps": motivation)."""


@dataclass(frozen=True)
class Bundle:
    """Files by their path relative to the FleetSpec.

    Raises:
        SpecError: together they are too large for a ConfigMap, or it cannot carry one of their names.
    """

    files: Mapping[str, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_keys()
        sizes = sorted(((len(self.stored(path)), path) for path in self.files), reverse=True)
        total = sum(size for size, _ in sizes)
        if total <= LARGEST_BYTES:
            return
        largest = ", ".join(f"{path} ({size / 1024:.0f} KiB)" for size, path in sizes[:3])
        message = (
            f"the functions and the files that they need are {total / 1024:.0f} KiB, "
            f"more than the {LARGEST_BYTES // 1024} KiB that a ConfigMap can carry; largest: {largest}"
        )
        hint = "build an image with the functions and name it in spec.map.image and spec.eval.image"
        raise SpecError([Problem("spec.map.function", message, hint)])

    def __bool__(self) -> bool:
        return bool(self.files)

    def _check_keys(self) -> None:
        keys: dict[str, str] = {}
        for path in sorted(self.files):
            key = key_of(path)
            # Every part is checked too: `/a` and `a/../../b` have keys like any other path.
            leads_out = not all(re.fullmatch(r"[-._A-Za-z0-9]+", part) for part in path.split("/"))
            leads_out |= not {".", ".."}.isdisjoint(path.split("/"))
            if leads_out or not re.fullmatch(r"[-._A-Za-z0-9]{1,253}", key) or key.startswith(".."):
                hint = "rename it, or build an image with the functions"
                raise SpecError(
                    [Problem("spec.map.function", f"a ConfigMap cannot carry a file called {path!r}", hint)]
                )
            if key in keys:
                message = f"{keys[key]} and {path} have the same key {key} in a ConfigMap"
                raise SpecError([Problem("spec.map.function", message, "rename one of them")])
            keys[key] = path

    @cached_property
    def digest(self) -> str:
        """Hash of all paths and contents; every pod of a fleet asks for it."""
        hasher = hashlib.sha256()
        for path in sorted(self.files):
            for part in (path.encode(), self.files[path]):
                hasher.update(len(part).to_bytes(8, "big"))
                hasher.update(part)
        return hasher.hexdigest()

    def stored(self, path: str) -> str:
        """A file as the ConfigMap stores it: text, or base64 of what is not UTF-8."""
        text = self._text(path)
        return base64.b64encode(self.files[path]).decode() if text is None else text

    def data(self) -> dict[str, dict[str, str]]:
        """`data` and `binaryData` of the ConfigMap, by key; what is empty is left out."""
        parts: dict[str, dict[str, str]] = {"data": {}, "binaryData": {}}
        for path in sorted(self.files):
            part = "binaryData" if self._text(path) is None else "data"
            parts[part][key_of(path)] = self.stored(path)
        return {part: entries for part, entries in parts.items() if entries}

    def items(self) -> list[dict[str, Any]]:
        """Where each key of the ConfigMap goes under the mount."""
        return [{"key": key_of(path), "path": path} for path in sorted(self.files)]

    def _text(self, path: str) -> str | None:
        try:
            return self.files[path].decode()
        except UnicodeDecodeError:
            return None


def key_of(path: str) -> str:
    """Key of a file in the ConfigMap: keys have no `/`, and modules have no `.` in their names."""
    return path.replace("/", ".")
