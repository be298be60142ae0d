"""What is in a fleet's folder: listed as a whole once, then only where something may still come.

A folder of HDFS is a call of its own, so a whole listing costs more with every mission that was flown.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage

_MISSION = re.compile(r"/missions/(\d+)/")
_LASTING = {"plan.json", "evaluation.json", "weights.json"}
"""What counts of a mission that is over."""


def whole(storage: Storage, paths: FleetPaths) -> dict[str, int]:
    """Size of everything in a fleet's folder, by path. Raises StorageError."""
    return _compact({entry.path: entry.size_bytes for entry in storage.list(paths.root)}, paths)


def renewed(storage: Storage, paths: FleetPaths, known: Mapping[str, int]) -> dict[str, int]:
    """The same, when what is known is from a while ago: the last mission, the next, and what a trainer makes.

    Raises:
        StorageError: it cannot be listed.
    """
    number = last_ordered(known, paths)
    folders = [paths.mission(number + 1)]
    if number:
        folders.append(paths.mission(number))
    if paths.initial_model not in known or paths.reward not in known:
        folders.append(paths.initial_model.rpartition("/")[0])
    kept = {path: size for path, size in known.items() if not path.startswith(tuple(f"{each}/" for each in folders))}
    for folder in folders:
        kept |= {entry.path: entry.size_bytes for entry in storage.list(folder)}
    return _compact(kept, paths)


def last_ordered(known: Mapping[str, int], paths: FleetPaths) -> int:
    """The last mission that was ordered; 0 before the first."""
    found = (_MISSION.match(path, len(paths.root)) for path in known if path.endswith("/plan.json"))
    return max((int(match[1]) for match in found if match), default=0)


def _compact(known: Mapping[str, int], paths: FleetPaths) -> dict[str, int]:
    """Without what no longer counts: all but the outcome of missions before the last two."""
    first = last_ordered(known, paths) - 1

    def counts(path: str) -> bool:
        match = _MISSION.match(path, len(paths.root))
        return match is None or int(match[1]) >= first or path.rpartition("/")[2] in _LASTING

    return {path: size for path, size in known.items() if counts(path)}
