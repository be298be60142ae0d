"""Result files: JSON with the command that gives the figures again."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path


def write(path: Path, command: str, content: Mapping[str, object]) -> None:
    """Write figures and their command; folders are made, and what is not a number becomes null."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(_plain({"command": command, **content}), allow_nan=False) + "\n", encoding="utf-8")


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
