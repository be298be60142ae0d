"""What is known of a field in flight: kriging that follows every captured cell.

After some new cells only those are predicted anew to whose 8 nearest captured cells they belong now; the result is that
of kriging from scratch. The covariance is fitted anew, and the whole field predicted anew, when there are a quarter
more captured cells than at the last fit: the cost of that is spread over the cells in between. As long as all captured
values are equal, the first other one is a reason too.

The state is a tuple of plain arrays, and what changes it is compiled without allocations, so that compiled simulators
can have beliefs too (`take_in`, `settle` and `below` of `fleet.functions.kriging_kernel`). One that asks about a few
cells a step is faster without: `look` and `expect` predict one cell from what is captured, in a fifth of a microsecond.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fleet.contexts.base import Environment, Expectation
from fleet.contexts.grid import Grid
from fleet.functions import compiled_kriging, kriging_kernel
from fleet.functions.classes import CLASS_THRESHOLDS
from fleet.functions.external_drift import slope
from fleet.functions.kriging import Prediction, Variogram, fit, places_of
from fleet.functions.local_kriging import NEIGHBOURS, Cells, Flags, Places, Values, squared_distance

_GROWTH = 1.25
"""A variogram is good for so many times the captured cells that it was fitted to."""
_MANY = 64
"""So many new cells, if they are more than those before, are not taken in one by one: that may take their square."""


_SAMPLED = 4096


class BeliefArrays(NamedTuple):
    """State of a belief.

    Args:
        places: Where cells are, and how alike they are.
        variance: Variance of the field.
        near: Neighbours of each cell, nearest first, as far as there are captured cells, int32 [cells, 8].
        reach: Squared distance to the last of 8 neighbours, infinite with fewer; -1 in captured cells and without
            data, float64 [cells].
        free: Cells with data that are not captured, bool [cells].
        widest: Largest reach in each tile, float64 [rows / 16, columns / 16].
        left: Free cells of each tile, int64 [rows / 16, columns / 16].
        trend: Part of the field that follows what was expected of it, float64 [cells]; 0 where nothing was.
        spread: Variance of the trend, float64 [cells].
        values: Values of captured cells less the trend, float64 [cells].
        mean: Expected value, float64 [cells]; NaN without data.
        deviation: Standard deviation, float64 [cells]; NaN without data.
        total: Sum of `mean` over the cells with data, float64 [1].
        captured: Number of captured cells, int64 [1].
        changed: Cells to predict anew, int32 [cells], as many as the kernel says.
        marked: Whether a cell is among these, bool [cells].
        scratch: For intermediate results.
    """

    places: Places
    variance: float
    near: Cells
    reach: Values
    free: Flags
    widest: Values
    left: NDArray[np.int64]
    trend: Values
    spread: Values
    values: Values
    mean: Values
    deviation: Values
    total: Values
    captured: NDArray[np.int64]
    changed: Cells
    marked: Flags
    scratch: compiled_kriging.Scratch


def blank(grid: Grid, variogram: Variogram) -> BeliefArrays:
    """The state before anything is captured."""
    tiles = (-(-grid.rows // kriging_kernel.TILE), -(-grid.columns // kriging_kernel.TILE))
    valid = grid.valid.reshape(-1)
    return BeliefArrays(
        places=places_of(grid, variogram),
        variance=variogram.variance,
        near=np.full((grid.cells, NEIGHBOURS), -1, dtype=np.int32),
        reach=np.where(valid, np.inf, -1.0),
        free=valid.copy(),
        widest=np.full(tiles, np.inf),
        left=_by_tile(np.add, grid.valid.astype(np.int64)),
        trend=np.zeros(grid.cells),
        spread=np.zeros(grid.cells),
        values=np.zeros(grid.cells),
        mean=np.where(valid, 0.0, np.nan),
        deviation=np.where(valid, 0.0, np.nan),
        total=np.zeros(1),
        captured=np.zeros(1, dtype=np.int64),
        changed=np.empty(grid.cells, dtype=np.int32),
        marked=np.zeros(grid.cells, dtype=bool),
        scratch=compiled_kriging.scratch_for(NEIGHBOURS),
    )


class Belief:
    """Expected value, deviation and classes of every cell, by the cells captured so far.

    Args:
        grid: Which cells have data, and their size.
        variogram: Covariance of the field, which is then kept; by default it is fitted to what is captured.
        expected: What was expected of each cell before anything was captured; None for nothing. See
            `fleet.functions.external_drift`.
    """

    def __init__(self, grid: Grid, variogram: Variogram | None = None, expected: Expectation | None = None) -> None:
        self._grid = grid
        self._expected = expected
        self._kept = variogram is not None
        self._variogram = variogram or Variogram(1.0, 0.0, 0.0)
        self._fitted_to = 0
        self.cells = int(np.count_nonzero(grid.valid))
        self.state = blank(grid, self._variogram)

    @staticmethod
    def over(environment: Environment) -> Belief:
        """What is believed of a place before anything is captured."""
        return Belief(environment.grid, expected=environment.expected)

    @property
    def variogram(self) -> Variogram:
        """The covariance that is believed in; its variance is 0 as long as all captured values are equal."""
        return self._variogram

    @property
    def grid(self) -> Grid:
        """Which cells have data, and their size."""
        return self._grid

    @property
    def captured(self) -> int:
        """Number of captured cells."""
        return int(self.state.captured[0])

    @property
    def free(self) -> Flags:
        """Cells with data that are not captured, bool [rows, columns]: a view, which follows what is captured."""
        view = self.state.free.reshape(self._grid.valid.shape)
        view.flags.writeable = False
        return view

    @property
    def known(self) -> Flags:
        """Captured cells, bool [rows, columns]."""
        return self._grid.valid & ~self.free

    @property
    def class_mean(self) -> float:
        """Mean of the predicted map, which classes refer to; 0 when nothing is known."""
        return float(self.state.total[0]) / self.cells if self.captured else 0.0

    @cached_property
    def sample(self) -> NDArray[np.int64]:
        """Cells with data that stand for all of them, ascending: every one of a small field, else 4,096, evenly spread
        but for chance, which is the same each time."""
        cells = np.flatnonzero(self._grid.valid)
        if len(cells) <= _SAMPLED:
            return cells
        bounds = np.arange(_SAMPLED + 1) * len(cells) // _SAMPLED
        return cells[np.random.default_rng(0).integers(bounds[:-1], bounds[1:])]

    def observe(self, cells: ArrayLike, values: ArrayLike) -> int:
        """Take captured cells in.

        Args:
            cells: Cell numbers, [n]. Those that are captured already or have no data stay as they are, and so does a
                cell with a value that is not finite.
            values: What was found there, [n].

        Returns:
            Number of cells whose neighbours have changed.
        Raises:
            ValueError: a cell is not on the grid, or there is not one value for each.
        """
        where, found = np.asarray(cells, dtype=np.int64).reshape(-1), np.asarray(values, dtype=np.float64).reshape(-1)
        if len(where) != len(found):
            raise ValueError(f"there are {len(where)} cells and {len(found)} values; give one value for each cell")
        if len(where) and not (where.min() >= 0 and where.max() < self._grid.cells):
            raise ValueError(f"a cell is not on the grid, whose cells are 0 to {self._grid.cells - 1}")
        surprising = self._variogram.variance == 0.0 and bool(np.any(found != self.state.mean[where]))
        if len(where) > max(_MANY, self.captured):
            changed = self._take_in_many(where, found)
        else:
            changed = int(kriging_kernel.observe(self.state, where, found))
        if self.captured and not self._kept and (surprising or self.captured >= _GROWTH * self._fitted_to):
            changed = self._fit()
        kriging_kernel.predict_changed(self.state, changed)
        return changed

    def prediction(self) -> Prediction:
        """Expected values and deviations as of now; NaN everywhere when nothing is captured."""
        shape = self._grid.valid.shape
        if not self.captured:
            return Prediction(np.full(shape, np.nan), self.state.deviation.reshape(shape).copy())
        return Prediction(self.state.mean.reshape(shape).copy(), self.state.deviation.reshape(shape).copy())

    def class_probabilities(self, mean: float | None = None) -> Values:
        """Probability of each class in each cell, to 1e-12; see `fleet.functions.classes.class_probabilities`.

        Args:
            mean: What the classes refer to; `class_mean` by default.

        Returns:
            float64 [4, rows, columns]; NaN without data, and everywhere when nothing is captured.
        """
        if not self.captured:
            return np.full((len(CLASS_THRESHOLDS) + 1, *self._grid.valid.shape), np.nan)
        bounds = class_bounds(self.class_mean if mean is None else mean)
        found = np.empty((len(bounds) + 1, self._grid.cells))
        kriging_kernel.class_probabilities(self.state, bounds, found)
        return found.reshape(-1, *self._grid.valid.shape)

    def _take_in_many(self, cells: NDArray[np.int64], values: Values) -> int:
        """As `kriging_kernel.observe`, by looking for the neighbours of all cells instead of telling them of each."""
        state, grid = self.state, self._grid
        fresh = np.isfinite(values) & (state.reach[cells] >= 0.0)
        cells, first = np.unique(cells[fresh], return_index=True)
        values = values[fresh][first]
        state.total[0] += (values - state.mean[cells]).sum()
        state.captured[0] += len(cells)
        state.mean[cells] = values
        state.values[cells] = values - state.trend[cells]
        state.reach[cells], state.deviation[cells], state.free[cells] = -1.0, 0.0, False
        state.left[:] = _by_tile(np.add, self.free.astype(np.int64))
        others = np.flatnonzero(state.free).astype(np.int32)
        known, count = self.known, min(NEIGHBOURS, self.captured)
        state.near[others, :count] = compiled_kriging.nearest(known, others, grid, count) if count else -1
        if count == NEIGHBOURS:
            axes = (axis.astype(np.int64) for axis in state.places[:2])
            down, right = (axis[others] - axis[state.near[others, -1]] for axis in axes)
            state.reach[others] = squared_distance(down, right, state.places.aspect)
        state.widest[:] = _by_tile(np.maximum, state.reach.reshape(grid.valid.shape))
        state.changed[: len(others)] = others
        return len(others)

    def _fit(self) -> int:
        """Fit to all captured cells; all others are to be predicted anew, and their number is returned."""
        shape = self._grid.valid.shape
        known = self.known
        if self._expected is not None:
            self._follow(self._expected, known)
        self._variogram = fit(np.where(known, self.state.values.reshape(shape), np.nan), known, self._grid)
        self._fitted_to = self.captured
        self.state = self.state._replace(
            places=places_of(self._grid, self._variogram), variance=self._variogram.variance
        )
        cells = np.flatnonzero(self.state.free)
        self.state.changed[: len(cells)] = cells
        return len(cells)

    def _follow(self, expected: Expectation, known: Flags) -> None:
        """Take as trend what the captured cells say of what was expected."""
        state, cells = self.state, known.reshape(-1)
        values = state.mean[cells]
        line = slope(values, expected.values[known])
        trend, spread = (
            line * np.where(self._grid.valid, part, 0.0).reshape(-1) for part in (expected.values, expected.deviation)
        )
        state.trend[:], state.spread[:] = trend, spread * spread
        state.values[cells] = values - trend[cells]


def class_bounds(mean: float) -> Values:
    """Upper bounds of all classes but the last, ascending, float64 [3]; the mean that they refer to may be negative."""
    return np.array(sorted(threshold * mean for threshold in CLASS_THRESHOLDS))


def _by_tile(total: np.ufunc, of: NDArray[Any]) -> NDArray[Any]:
    """Sum, or maximum, over each tile, of [rows, columns]."""
    side = kriging_kernel.TILE
    down, across = (np.arange(0, size, side) for size in of.shape)
    return np.asarray(total.reduceat(total.reduceat(of, down, axis=0), across, axis=1))
