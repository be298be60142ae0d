"""The fast form of the simulator: prepares arrays for the compiled kernel, and asks Eval() in flight."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fleet.missions.layout import Layout
from fleet.simulator import kernel
from fleet.simulator.arrays import BatchArrays, FlownArrays, LayoutArrays, TraceArrays, arrays_of
from fleet.simulator.batch import Batch, Finished, Flown, Trace, broken_table

_SEED_MASK = (1 << 64) - 1


def fly(layout: Layout, batch: Batch, traced: bool, finished: Finished | None) -> Flown:
    """Fly a checked batch; see `fleet.simulator.batch.fly`.

    A trace takes two passes: the first tells how long the flights are. Eval() in flight takes two more: flights go
    on as if nobody asked, Eval() is asked about each leaving of a group in turn, and what lies behind a yes is cut.
    """
    passes = _Passes(layout, batch)
    if finished is not None:
        passes.ask(finished)
    return passes.traced() if traced else passes.fly(passes.blank(0))


class _Passes:
    """Passes of the kernel over the same missions."""

    def __init__(self, layout: Layout, batch: Batch) -> None:
        self._shape = (len(batch), layout.agents)
        self._layout = arrays_of(layout)
        self._land_at = np.full(self._shape, -1, dtype=np.int64)
        self._batch = _batch_arrays(self._layout, batch, self._land_at)

    def blank(self, steps: int) -> Trace:
        """A trace with room for flights of so many steps."""
        return Trace.blank(*self._shape, steps)

    def fly(self, trace: Trace, left: NDArray[np.int64] | None = None) -> Flown:
        """One pass; fills a trace, and the steps in which groups were left, [M, N, groups], where they have room."""
        if left is None:
            left = np.empty((*self._shape, 0), dtype=np.int64)
        flown = Flown.blank(*self._shape, len(self._layout.group_of))
        kernel.fly(
            self._layout,
            self._batch,
            FlownArrays(*(getattr(flown, name) for name in FlownArrays._fields)),
            TraceArrays(trace.cell, trace.captured, trace.legal, trace.move, left),
            _scratch(self._layout),
        )
        return flown

    def traced(self, left: NDArray[np.int64] | None = None) -> Flown:
        """A pass with a trace."""
        steps = self.fly(self.blank(0)).steps
        trace = self.blank(int(steps.max(initial=0)))
        trace.steps[:] = steps
        return replace(self.fly(trace, left), trace=trace)

    def ask(self, finished: Finished) -> None:
        """Find out where Eval() ends the flights; later passes end them there."""
        groups = int((self._layout.last - self._layout.first).max())
        left = np.full((*self._shape, groups), -1, dtype=np.int64)
        trace = self.traced(left).trace
        assert trace is not None  # a traced pass has one
        for mission, agent in np.ndindex(self._shape):
            cells, captured = trace.cell[mission, agent], trace.captured[mission, agent]
            for step in left[mission, agent, left[mission, agent] >= 0].tolist():
                seen = np.zeros(len(self._layout.group_of), dtype=np.bool_)
                seen[cells[: step + 1][captured[: step + 1]]] = True
                if finished(mission, agent, seen):
                    self._land_at[mission, agent] = step
                    break


def _batch_arrays(layout: LayoutArrays, batch: Batch, land_at: NDArray[np.int64]) -> BatchArrays:
    orders = np.zeros(batch.scores.shape[:2], dtype=np.uint32)
    broken = kernel.rank(np.ascontiguousarray(batch.scores), layout.members, layout.moves, orders)
    if broken >= 0:
        raise broken_table(broken)
    arrays = {name: np.ascontiguousarray(getattr(batch, name)) for name in BatchArrays._fields[1:-2]}
    return BatchArrays(orders=orders, seed=np.uint64(batch.seed & _SEED_MASK), land_at=land_at, **arrays)


def _scratch(layout: LayoutArrays) -> kernel.Scratch:
    cells, groups = len(layout.group_of), len(layout.sizes)
    return kernel.Scratch(
        free=layout.full.copy(),
        visited=np.zeros(groups, dtype=np.int64),
        utility=np.zeros(groups),
        path=np.empty(cells + 1, dtype=np.int32),  # one more: travel writes before it knows whether a cell counts
    )
