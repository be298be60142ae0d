"""The saved form of SA models: an npz file whose bytes depend on its content alone.

`numpy.load` reads it. numpy.savez would do for reading, but what it writes depends on the system and on zlib.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fleet.errors import ModelError

_META = "meta"
_LONG_AGO = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, eq=False)
class Archive:
    """A model as it is saved.

    Args:
        format: Tag that says how to read the rest: `fleet-q-learning/1`.
        meta: Anything that JSON holds.
        arrays: Arrays by name.
    """

    format: str
    meta: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    def to_bytes(self) -> bytes:
        """The file; equal archives give equal bytes."""
        text = json.dumps({"format": self.format, **self.meta}, sort_keys=True)
        members = {_META: np.frombuffer(text.encode(), dtype=np.uint8), **self.arrays}
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
            for name in sorted(members):
                entry = zipfile.ZipInfo(f"{name}.npy", _LONG_AGO)
                entry.create_system = 3
                entry.external_attr = 0o600 << 16
                content = io.BytesIO()
                np.lib.format.write_array(content, np.ascontiguousarray(members[name]), allow_pickle=False)
                archive.writestr(entry, content.getvalue())
        return file.getvalue()

    def array(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """A float64 array of a shape.

        Raises:
            ModelError: it is missing, or has another shape or type.
        """
        found = self.arrays.get(name)
        if found is None or found.dtype != np.float64 or found.shape != shape:
            has = "is missing" if found is None else f"is {found.dtype} {found.shape}"
            raise ModelError(f"the saved model is damaged: {name} {has}, not float64 {shape}")
        return found


def read_archive(data: bytes) -> Archive:
    """A saved model.

    Raises:
        ModelError: the bytes are no saved model, or are not whole.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        meta = json.loads(arrays.pop(_META).tobytes().decode())
        return Archive(str(meta.pop("format")), meta, arrays)
    except (ValueError, KeyError, OSError, EOFError, AttributeError, TypeError, zipfile.BadZipFile) as error:
        raise ModelError(
            f"the saved model cannot be read ({len(data)} bytes): it is cut off or no model; train or fetch it again"
        ) from error
