"""What a test tells a running stand-in: images that are missing, nodes without power."""

from __future__ import annotations

import json
from pathlib import Path


class Orders:
    """Reads a JSON file again whenever it has changed; it is replaced as a whole by `give`."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._stamp = 0
        self.missing_images: set[str] = set()
        self.dark_nodes: set[str] = set()

    def read(self) -> bool:
        """Whether there was something new."""
        try:
            stamp = self._file.stat().st_mtime_ns
        except FileNotFoundError:
            return False
        if stamp == self._stamp:
            return False
        self._stamp = stamp
        content = json.loads(self._file.read_text())
        self.missing_images = set(content.get("missing_images", ()))
        self.dark_nodes = set(content.get("dark_nodes", ()))
        return True


def give(file: Path, missing_images: set[str], dark_nodes: set[str]) -> None:
    """Write the file."""
    draft = file.with_suffix(".draft")
    draft.write_text(json.dumps({"missing_images": sorted(missing_images), "dark_nodes": sorted(dark_nodes)}))
    draft.rename(file)
