"""The fast form of the simulator: prepares arrays for the compiled kernel, and asks Eval() in flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fleet.errors import MissionError
from fleet.missions.layout import Layout
from fleet.simulator import kernel
from fleet.simulator.arrays import BatchArrays, FlownArrays, LayoutArrays, TraceArrays, arrays_of
from fleet.simulator.batch import Batch, Finished, Flown, Trace

_SEED_MASK = (1 << 64) - 1


def fly(layout: Layout, batch: Batch, traced: bool, finished: Finished | None) -> Flown:
    """Fly a checked batch; see `fleet.simulator.batch.fly`.

    A trace takes two passes: the first tells how long the flights are. Eval() in flight takes two more: flights go
    on as if nobody asked, Eval() is asked about each leaving of a group in turn, and what lies behind a yes is cut.
    """
    arrays = arrays_of(layout)
    batch_arrays = _batch_arrays(arrays, batch)
    land_at = np.full((len(batch), layout.agents), -1, dtype=np.int64)
    if finished is not None:
        land_at = _ask(layout, arrays, batch_arrays, finished)
    flown = _pass(layout, batch_arrays, land_at)
    if not traced:
        return flown
    trace = Trace.blank(len(batch), layout.agents, int(flown.steps.max(initial=0)))
    flown = _pass(layout, batch_arrays, land_at, trace)
    trace.steps[:] = flown.steps
    return replace(flown, trace=trace)


def _batch_arrays(layout: LayoutArrays, batch: Batch) -> BatchArrays:
    orders = np.zeros(batch.scores.shape[:2], dtype=np.uint32)
    broken = kernel.rank(np.ascontiguousarray(batch.scores), layout.members, layout.width, orders)
    if broken >= 0:
        raise MissionError(f"batch: score table {broken} has NaN in a cell with data")
    names = BatchArrays._fields[1:-1]
    arrays = {name: np.ascontiguousarray(getattr(batch, name)) for name in names}
    return BatchArrays(orders=orders, seed=np.uint64(batch.seed & _SEED_MASK), **arrays)


def _pass(layout: Layout, batch: BatchArrays, land_at: NDArray[np.int64], trace: Trace | None = None) -> Flown:
    flown = Flown.blank(len(batch.missions), layout.agents, layout.grid.cells)
    flown_arrays = FlownArrays(*(getattr(flown, name) for name in FlownArrays._fields))
    trace_arrays = TraceArrays(trace.cell, trace.captured, trace.legal, trace.move) if trace else None
    arrays = arrays_of(layout)
    scratch = kernel.Scratch(
        np.zeros(layout.grid.cells, dtype=np.uint8),
        np.zeros(len(layout.groups), dtype=np.int64),
        np.zeros(len(layout.groups)),
        np.empty(layout.grid.cells, dtype=np.int32),
    )
    scratch.todo[arrays.members] = 1
    kernel.fly(arrays, batch, flown_arrays, scratch, land_at, trace_arrays, None)
    return flown
