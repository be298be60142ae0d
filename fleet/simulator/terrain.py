"""A context made ready for simulation: the SSV of every state, and who flies where.

Map() runs once for each state of a context. Its answers are kept in storage and found again by content: the context's
digest, the version of Map() and the names of its features must all be the same.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Context, Environment
from fleet.errors import FunctionError, ObjectNotFound
from fleet.functions.contract import MapClient
from fleet.missions.layout import Layout
from fleet.storage.port import Storage

Progress = Callable[[int, int], None]
"""Told how many states are done, and of how many."""


@dataclass(frozen=True, eq=False)
class Terrain:
    """Everything that missions over one context need.

    Args:
        environment: The place.
        features: Names of the SSV's features, in the order of the columns of `ssv`.
        ssv: SSV of each cell, float64 [cells, features]; rows of NaN without data.
        layout: Who flies where.
    """

    environment: Environment
    features: tuple[str, ...]
    ssv: NDArray[np.float64]
    layout: Layout


def survey(
    context: Context,
    map_client: MapClient,
    cache: Storage | None = None,
    cache_path: str = "",
    progress: Progress | None = None,
) -> NDArray[np.float64]:
    """The SSV of each state of a context.

    Args:
        context: What is observed.
        map_client: Map(), called once in each state with data when the cache has no answer.
        cache, cache_path: Where answers are kept; an object that is torn or of other content is made anew.
        progress: Told after each state.

    Returns:
        float64 [cells, features]; rows of NaN without data.

    Raises:
        FunctionError: Map() failed.
        StorageError: the cache cannot be read or written.
    """
    environment = context.environment
    cells = np.flatnonzero(environment.grid.valid)
    try:
        features = map_client.features
    except FunctionError:  # a Map() that declares no features is known by its first answer
        map_client.map(context.observe(int(cells[0])))
        features = map_client.features
    label = _label(environment, map_client)
    if cache is not None:
        found = _read(cache, cache_path, label)
        if found is not None and found.shape == (environment.grid.cells, len(features)):
            return found
    ssv = np.full((environment.grid.cells, len(features)), np.nan)
    for done, cell in enumerate(cells.tolist(), start=1):
        ssv[cell] = map_client.map(context.observe(cell))
        if progress is not None:
            progress(done, len(cells))
    if cache is not None:
        cache.write(cache_path, _packed(ssv, label))
    return ssv


def _label(environment: Environment, map_client: MapClient) -> str:
    return "\n".join([environment.digest, map_client.version, *map_client.features])


def _packed(ssv: NDArray[np.float64], label: str) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, ssv=ssv, label=np.array(label))
    return buffer.getvalue()


def _read(cache: Storage, path: str, label: str) -> NDArray[np.float64] | None:
    try:
        with np.load(io.BytesIO(cache.read(path)), allow_pickle=False) as arrays:
            if str(arrays["label"]) != label:
                return None
            return np.asarray(arrays["ssv"], dtype=np.float64)
    except ObjectNotFound:
        return None
    except (
        ValueError,
        KeyError,
        TypeError,
        OSError,
        EOFError,
        NotImplementedError,
        zipfile.BadZipFile,
        zlib.error,
    ):  # torn, or of another program
        return None
