"""The fast extrapolations against plain ones."""

from __future__ import annotations

import functools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.functions import kriging
from fleet.functions.extrapolation import neighbour_mean
from fleet.functions.kriging import Variogram, fit, krige, matern32

Values = NDArray[np.float64]


@st.composite
def fields(draw: st.DrawFn) -> tuple[Values, Grid]:
    """Values with gaps on a grid with holes, at least one cell with data."""
    shape = draw(hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=8))
    valid = draw(hnp.arrays(bool, shape))
    valid[draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))] = True
    values = draw(hnp.arrays(np.float64, shape, elements=st.integers(-50, 50).map(float)))
    known = draw(hnp.arrays(bool, shape)) & valid
    return np.where(known, values, np.nan), Grid(valid, draw(st.sampled_from([1.0, 9.0])), 5.0)


def plain_neighbour_mean(values: Values, grid: Grid) -> Values:
    """Wave by wave, cell by cell."""
    known = {(int(r), int(c)): float(values[r, c]) for r, c in np.argwhere(np.isfinite(values) & grid.valid)}
    while known and len(known) < grid.cells:
        fresh = {}
        for row in range(grid.rows):
            for column in range(grid.columns):
                if (row, column) in known:
                    continue
                around = [
                    known[row + down, column + right]
                    for down in (-1, 0, 1)
                    for right in (-1, 0, 1)
                    if (row + down, column + right) in known
                ]
                if around:
                    fresh[row, column] = sum(around) / len(around)
        known.update(fresh)
    result = np.full(grid.valid.shape, np.nan)
    for (row, column), value in known.items():
        if grid.valid[row, column]:
            result[row, column] = value
    return result


@settings(max_examples=80)
@given(fields())
def test_neighbour_mean_is_the_plain_one(field: tuple[Values, Grid]) -> None:
    values, grid = field
    np.testing.assert_allclose(neighbour_mean(values, grid), plain_neighbour_mean(values, grid), rtol=1e-9, atol=1e-9)


@settings(max_examples=60)
@given(fields(), st.sampled_from([neighbour_mean, lambda values, grid: krige(values, grid).values]))
def test_captured_cells_keep_their_value_and_all_cells_with_data_get_one(field, extrapolate) -> None:  # type: ignore[no-untyped-def]  # drawn
    values, grid = field
    predicted = extrapolate(values, grid)
    known = np.isfinite(values)
    np.testing.assert_array_equal(predicted[known], values[known])
    np.testing.assert_array_equal(np.isfinite(predicted), grid.valid if known.any() else np.zeros_like(known))


@settings(max_examples=40)
@given(fields(), st.floats(-1e3, 1e3), st.sampled_from([0.5, 2.0, 10.0]))
def test_kriging_follows_a_shift_and_a_scale(field: tuple[Values, Grid], shift: float, scale: float) -> None:
    values, grid = field
    plain, moved = krige(values, grid), krige(values * scale + shift, grid)
    np.testing.assert_allclose(moved.values, plain.values * scale + shift, atol=1e-4 * scale)
    np.testing.assert_allclose(moved.deviation, plain.deviation * scale, rtol=1e-4, atol=1e-6 * scale)


@settings(max_examples=40)
@given(fields())
def test_kriging_from_all_captured_cells_is_the_plain_one(field: tuple[Values, Grid]) -> None:
    values, grid = field
    known = np.isfinite(values)
    neighbours, kriging.NEIGHBOURS = kriging.NEIGHBOURS, 64
    try:
        found = krige(values, grid)
    finally:
        kriging.NEIGHBOURS = neighbours
    if not known.any():
        return
    variogram = fit(np.where(known, values - np.median(values[known]), np.nan), known, grid)
    expected, deviation = plain_kriging(values, grid, variogram)
    np.testing.assert_allclose(found.values, expected, atol=1e-4)
    np.testing.assert_allclose(found.deviation, deviation, atol=1e-3)


def plain_kriging(values: Values, grid: Grid, variogram: Variogram) -> tuple[Values, Values]:
    """Generalised least squares mean plus simple kriging of the residuals, and the variance of both."""
    known, wanted = np.isfinite(values), grid.valid & ~np.isfinite(values)
    expected, deviation = np.where(known, values, np.nan), np.where(grid.valid, 0.0, np.nan)
    size = np.array([grid.cell_height_m, grid.cell_width_m])
    places, found = np.argwhere(known) * size, values[known]

    def covariance(first: Values, second: Values) -> Values:
        lag = np.linalg.norm(first[:, None] - second[None], axis=2)
        return (1 - variogram.nugget) * matern32(lag / variogram.length)

    between = covariance(places, places)
    np.fill_diagonal(between, 1.0 + 1e-9)
    inverse, ones = np.linalg.inv(between), np.ones(len(found))
    mean = (ones @ inverse @ found) / (ones @ inverse @ ones)
    to = covariance(np.argwhere(wanted) * size, places)
    expected[wanted] = mean + to @ inverse @ (found - mean)
    lacking = 1 - to @ inverse @ ones
    share = 1 - np.einsum("ij,jk,ik->i", to, inverse, to) + lacking**2 / (ones @ inverse @ ones)
    deviation[wanted] = np.sqrt(np.maximum(share, 0) * variogram.variance)
    return expected, deviation


@settings(max_examples=60)
@given(fields())
def test_the_variogram_by_fourier_transform_is_that_of_all_pairs(field: tuple[Values, Grid]) -> None:
    values, grid = field
    known = np.isfinite(values)
    places = np.argwhere(known)
    pairs: dict[int, list[tuple[float, float]]] = {}
    reach = max(grid.rows * grid.cell_height_m, grid.columns * grid.cell_width_m) / 2
    size = (grid.cell_height_m * grid.cell_width_m) ** 0.5
    for first in range(len(places)):
        for second in range(len(places)):
            lag = (places[first] - places[second]) * (grid.cell_height_m, grid.cell_width_m)
            distance = float(np.hypot(*lag))
            if 0 < distance <= reach:
                halves = (values[tuple(places[first])] - values[tuple(places[second])]) ** 2 / 2
                pairs.setdefault(int(np.rint(distance / size)), []).append((distance, halves))
    found = kriging._variogram(np.where(known, values, 0.0), known, grid, size)
    wanted = np.array([[*np.mean(pairs[key], axis=0), len(pairs[key])] for key in sorted(pairs)]).reshape(-1, 3)
    np.testing.assert_allclose(np.stack(found, axis=1), wanted, rtol=1e-6, atol=1e-6)


@functools.cache
def square_root(side: int, length: float) -> Values:
    """Of the covariance of a field of side x side cells."""
    places = np.argwhere(np.ones((side, side)))
    lag = np.linalg.norm(places[:, None] - places[None], axis=2)
    return np.linalg.cholesky(matern32(lag / length) + 1e-9 * np.eye(len(places)))


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1.5, 3.0, 5.0]))
def test_a_field_with_structure_is_found_to_have_it(seed: int, length: float) -> None:
    truth = (square_root(16, length) @ np.random.default_rng(seed).normal(size=256)).reshape(16, 16)
    variogram = fit(truth, np.ones((16, 16), dtype=bool), Grid(np.ones((16, 16), dtype=bool)))
    assert variogram.nugget < 0.6
    assert 0.7 <= variogram.length <= 24.0
