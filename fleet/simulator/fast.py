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
    passes = _Passes(layout, batch)
    if finished is not None:
        passes.ask(finished)
    return passes.traced() if traced else passes.fly()


class _Passes:
    """Passes of the kernel over the same missions."""

    def __init__(self, layout: Layout, batch: Batch) -> None:
        self._layout = layout
        self._arrays = arrays_of(layout)
        self._batch = _batch_arrays(self._arrays, batch)
        self._land_at = np.full((len(batch), layout.agents), -1, dtype=np.int64)

    def fly(self, trace: Trace | None = None, left: NDArray[np.int64] | None = None) -> Flown:
        """One pass; fills a trace, and the steps in which groups were left, int64 [M, N, groups]."""
        missions, agents = self._land_at.shape
        flown = Flown.blank(missions, agents, self._layout.grid.cells)
        flown_arrays = FlownArrays(*(getattr(flown, name) for name in FlownArrays._fields))
        trace_arrays = TraceArrays(trace.cell, trace.captured, trace.legal, trace.move) if trace else None
        kernel.fly(self._arrays, self._batch, flown_arrays, _scratch(self._arrays), self._land_at, trace_arrays, left)
        return flown

    def traced(self, left: NDArray[np.int64] | None = None) -> Flown:
        """A pass with a trace."""
        steps = self.fly().steps
        trace = Trace.blank(*steps.shape, int(steps.max(initial=0)))
        trace.steps[:] = steps
        return replace(self.fly(trace, left), trace=trace)

    def ask(self, finished: Finished) -> None:
        """Find out where Eval() ends the flights; later passes end them there."""
        missions, agents = self._land_at.shape
        groups = int((self._arrays.last - self._arrays.first).max())
        left = np.full((missions, agents, groups), -1, dtype=np.int64)
        trace = self.traced(left).trace
        assert trace is not None  # a traced pass has one
        for mission, agent in np.ndindex(missions, agents):
            cells, captured = trace.cell[mission, agent], trace.captured[mission, agent]
            for step in left[mission, agent, left[mission, agent] >= 0].tolist():
                seen = np.zeros(self._layout.grid.cells, dtype=np.bool_)
                seen[cells[: step + 1][captured[: step + 1]]] = True
                if finished(mission, agent, seen):
                    self._land_at[mission, agent] = step
                    break


def _batch_arrays(layout: LayoutArrays, batch: Batch) -> BatchArrays:
    orders = np.zeros(batch.scores.shape[:2], dtype=np.uint32)
    broken = kernel.rank(np.ascontiguousarray(batch.scores), layout.members, layout.width, orders)
    if broken >= 0:
        raise MissionError(f"batch: score table {broken} has NaN in a cell with data")
    names = BatchArrays._fields[1:-1]
    arrays = {name: np.ascontiguousarray(getattr(batch, name)) for name in names}
    return BatchArrays(orders=orders, seed=np.uint64(batch.seed & _SEED_MASK), **arrays)


def _scratch(layout: LayoutArrays) -> kernel.Scratch:
    cells, groups = len(layout.group_of), len(layout.offsets) - 1
    return kernel.Scratch(
        todo=(layout.group_of >= 0).astype(np.uint8),
        visited=np.zeros(groups, dtype=np.int64),
        utility=np.zeros(groups),
        path=np.empty(cells, dtype=np.int32),
    )
