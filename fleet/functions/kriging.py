"""Ordinary kriging with a Matern 3/2 covariance that is fitted to the captured cells.

Source: Chiles and Delfiner 2012, Geostatistics, sections 2.2 (variogram of data on a grid), 3.4 (ordinary kriging);
Rasmussen and Williams 2006, Gaussian Processes for Machine Learning, equation 4.17 (Matern 3/2).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from fleet.contexts.grid import Grid
from fleet.functions import local_kriging
from fleet.functions.local_kriging import NEIGHBOURS, Flags, Places, Values

Indices = NDArray[np.int64]

_FEW = 12
"""With fewer captured cells a variogram means nothing, and DEFAULT is used."""
_LENGTHS = np.geomspace(0.7, 24.0, 16)
"""Length scales that are tried, in cells."""
_PATIENCE = 300_000
"""Cells that a process predicts with numpy before it loads the compiled form, which costs as much time as they took."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A value for every cell with data, and how sure it is.

    Args:
        values: Expected value, float64 [rows, columns]; NaN without data, and everywhere when nothing is known.
        deviation: Standard deviation of the true value, same shape; 0 in captured cells, and where it is not known.
    """

    values: Values
    deviation: Values


@dataclass(frozen=True)
class Variogram:
    """Matern 3/2 covariance of the field.

    Args:
        length: Length scale in m.
        nugget: Share of the variance that neighbouring cells do not share, 0..1.
        variance: Variance of the field, nugget included.
    """

    length: float
    nugget: float
    variance: float


def krige(values: Values, grid: Grid) -> Prediction:
    """Predict every cell with data from the captured cells near it; captured cells keep their value.

    Args:
        values: float64 [rows, columns], NaN where nothing was captured.
    """
    known = np.isfinite(values) & grid.valid
    filled = np.where(known, values, np.nan)
    deviation = np.where(grid.valid, 0.0, np.nan)
    wanted = grid.valid & ~known
    if not known.any() or not wanted.any():
        return Prediction(filled, deviation)
    filled[wanted], deviation[wanted] = predict(filled, known, wanted, grid, fit(filled, known, grid))
    return Prediction(filled, deviation)


def fit(values: Values, known: Flags, grid: Grid) -> Variogram:
    """Length scale, nugget and variance by weighted least squares on the variogram of all pairs of captured cells.

    Outliers are drawn in to three robust standard deviations first. With fewer than 12 captured cells the length is 4
    cells and the nugget a tenth.
    """
    size = (grid.cell_height_m * grid.cell_width_m) ** 0.5
    found = values[known]
    few = Variogram(4.0 * size, 0.1, float(np.var(found)))
    if np.ptp(found) == 0.0 or len(found) < _FEW:
        return few
    middle = np.median(found)
    spread = 1.4826 * np.median(np.abs(found - middle)) or float(np.std(found))
    drawn = np.where(known, np.clip(values - middle, -3 * spread, 3 * spread), 0.0)
    distance, semivariance, pairs = _variogram(drawn, known, grid, size)
    if len(distance) < 3:
        return few
    return _least_squares(distance, semivariance, pairs, size) or few


def _variogram(values: Values, known: Flags, grid: Grid, size: float) -> tuple[Values, Values, Values]:
    """Mean distance in m, semivariance and number of pairs, for bins of one cell's width up to half of the field.

    The sums over all pairs of each lag are correlations, found by fast Fourier transform.
    """
    shape, lag, near, bins = _lags(grid.rows, grid.columns, grid.cell_height_m, grid.cell_width_m)
    mask, first, second = (rfft2(part, shape) for part in (known.astype(np.float64), values, values**2))
    pairs = _folded(irfft2(mask * mask.conj(), shape), lag.shape)[near]
    halves = _folded(irfft2((second * mask.conj()).real - (first * first.conj()).real, shape), lag.shape)[near]
    some = pairs > 0.5
    bins, pairs = bins[some], pairs[some]
    counts = np.bincount(bins, pairs).astype(np.float64)
    full = counts > 0
    distance = np.bincount(bins, lag[near][some] * pairs)[full] / counts[full]
    return np.asarray(distance), np.maximum(np.bincount(bins, halves[some])[full] / counts[full], 0.0), counts[full]


@functools.lru_cache(maxsize=16)
def _lags(rows: int, columns: int, height: float, width: float) -> tuple[tuple[int, int], Values, Flags, Indices]:
    """Shape of the transforms, in which no lag up to half of the field is another one's alias; and these lags.

    Returns:
        The shape; distance in m, by rows and columns; which of them count; the bins of those.
    """
    reach = max(rows * height, columns * width) / 2
    down, right = min(rows - 1, int(reach / height + 1e-9)), min(columns - 1, int(reach / width + 1e-9))
    lag = np.hypot(np.arange(down + 1)[:, None] * height, np.arange(right + 1)[None, :] * width)
    near = (lag > 0) & (lag <= reach)
    shape = (next_fast_len(rows + down, True), next_fast_len(columns + right, True))
    return shape, lag, near, np.rint(lag[near] / (height * width) ** 0.5).astype(np.int64)


def _folded(correlation: Values, shape: tuple[int, ...]) -> Values:
    """Sum over both directions of rows and of columns; changes its argument."""
    down, across = shape
    half = correlation[:down]
    half[1:] += correlation[:-down:-1]
    quarter = half[:, :across]
    quarter[:, 1:] += half[:, :-across:-1]
    return quarter


def _least_squares(distance: Values, semivariance: Values, pairs: Values, size: float) -> Variogram | None:
    """Best nugget and sill for every length scale, weighted by pairs / distance^2, and the best of these.

    None when there is no variance to explain.
    """
    weight = pairs / distance**2
    lengths = _LENGTHS * size
    rise = 1.0 - matern32(distance[None, :] / lengths[:, None])
    sw, sy = weight.sum(), (weight * semivariance).sum()
    sr, srr, sry = rise @ weight, rise**2 @ weight, rise @ (weight * semivariance)
    determinant = np.maximum(sw * srr - sr**2, 1e-12 * sw * srr)
    sill = np.maximum((sw * sry - sr * sy) / determinant, 0.0)
    nugget = (sy - sill * sr) / sw
    sill = np.where(nugget < 0, np.maximum(sry / srr, 0.0), sill)
    nugget = np.maximum(nugget, 0.0)
    misfit = ((semivariance - nugget[:, None] - sill[:, None] * rise) ** 2) @ weight
    best = int(np.argmin(misfit))
    total = float(nugget[best] + sill[best])
    return Variogram(float(lengths[best]), float(nugget[best]) / total, total) if total > 0 else None


def matern32(scaled: Values) -> Values:
    """Correlation at a distance over length scale."""
    steps = np.sqrt(3.0) * scaled
    return np.asarray((1.0 + steps) * np.exp(-steps))


def predict(values: Values, known: Flags, wanted: Flags, grid: Grid, variogram: Variogram) -> tuple[Values, Values]:
    """Ordinary kriging from the 8 nearest captured cells; of equally near ones from those with the lower number.

    Args:
        values: [rows, columns].
        known: Captured cells, at least one.
        wanted: Cells that are predicted.

    Returns:
        Expected value and standard deviation of each wanted cell, [wanted].
    """
    form = _form(int(np.count_nonzero(wanted)))
    targets = np.flatnonzero(wanted).astype(np.int32)
    near = form.nearest(known, targets, grid, min(NEIGHBOURS, int(np.count_nonzero(known))))
    expected, share = form.solve(near, targets, values.reshape(-1), places_of(grid, variogram))
    return expected, np.sqrt(share * variogram.variance)


def prepare_for_many() -> bool:
    """Load the compiled form now, for a process that will make many maps.

    Returns:
        Whether there is one: numba may be missing, and then maps take longer and are the same.
    """
    if _compiled() is None:
        return False
    krige(np.array([[1.0, np.nan]]), Grid(np.ones((1, 2), dtype=np.bool_)))  # numba loads what is called first
    return True


class _Predicted:
    """How many cells this process has predicted."""

    cells = 0


def _form(cells: int) -> ModuleType:
    """What predicts so many cells: numpy at first; both forms give the same bits."""
    _Predicted.cells += cells
    late = _Predicted.cells > _PATIENCE or _compiled.cache_info().currsize
    return (_compiled() if late else None) or local_kriging


@functools.cache
def _compiled() -> ModuleType | None:
    try:
        from fleet.functions import compiled_kriging  # noqa: PLC0415 - numba loads where many maps are made
    except ImportError:  # images of users' functions are without numba
        return None
    return compiled_kriging


def places_of(grid: Grid, variogram: Variogram) -> Places:
    """Where the cells of a grid are, and how alike they are."""
    rows, columns = np.divmod(np.arange(grid.cells, dtype=np.int32), np.int32(grid.columns))
    ratio = grid.cell_height_m / grid.cell_width_m
    aspect = ratio * ratio  # as where neighbours are looked for: ** 2 may have another last bit, and ties would differ
    return Places(rows, columns, aspect, _covariances(grid, variogram))


def _covariances(grid: Grid, variogram: Variogram) -> Values:
    """Covariance of two different cells by rows and columns between them, as a share of the variance."""
    rows = np.arange(grid.rows)[:, None] * grid.cell_height_m
    columns = np.arange(grid.columns)[None, :] * grid.cell_width_m
    return (1.0 - variogram.nugget) * matern32(np.hypot(rows, columns) / variogram.length)
