"""The compiled form of kriging, the one in numpy, and a plain one."""

from __future__ import annotations

import os
import subprocess
import sys
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from fleet.compiled import program
from fleet.contexts.grid import Grid
from fleet.functions import compiled_kriging, kriging, local_kriging
from fleet.functions.kriging import Variogram, places_of, predict
from fleet.functions.kriging_kernel import expect, look
from tests.conftest import ROOT

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
FORMS = (local_kriging, compiled_kriging)


@st.composite
def fields(draw: st.DrawFn) -> tuple[Flags, Grid]:
    """Captured cells, at least one, on a grid of cells that need not be square."""
    shape = draw(hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=14))
    share = draw(st.sampled_from([0.02, 0.2, 0.6]))
    known = np.random.default_rng(draw(st.integers(0, 2**32 - 1))).random(shape) < share
    known[draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))] = True
    height, width = draw(st.sampled_from([(1.0, 1.0), (11.9, 8.9), (0.3, 9.0), (7.0, 1.0), (0.1, 0.1), (0.001, 9.0)]))
    return known, Grid(np.ones(shape, dtype=bool), height, width)


variograms = st.builds(Variogram, st.floats(1.0, 200.0), st.floats(0.0, 1.0), st.floats(0.1, 100.0))


def values_of(known: Flags) -> Values:
    return np.where(known, np.random.default_rng(7).normal(size=known.shape) * 5, np.nan)


def plain_nearest(known: Flags, grid: Grid, count: int) -> NDArray[np.int64]:
    sources, targets = np.flatnonzero(known), np.flatnonzero(~known)
    rows, columns = np.divmod(np.arange(grid.cells), grid.columns)
    chosen = []
    for target in targets:
        apart = local_kriging.squared_distance(
            rows[sources] - rows[target],
            columns[sources] - columns[target],
            (grid.cell_height_m / grid.cell_width_m) ** 2,
        )
        chosen.append([source for _, source in sorted(zip(apart, sources, strict=True))[:count]])
    return np.array(chosen, dtype=np.int64).reshape(len(targets), count)


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=60)
@given(fields())
def test_neighbours_are_the_nearest_and_of_equals_the_first(form: ModuleType, field: tuple[Flags, Grid]) -> None:
    known, grid = field
    count = min(8, int(known.sum()))
    found = form.nearest(known, np.flatnonzero(~known).astype(np.int32), grid, count)
    np.testing.assert_array_equal(found, plain_nearest(known, grid, count))


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=60)
@given(fields(), variograms)
def test_expected_values_are_those_of_the_whole_system(
    form: ModuleType, field: tuple[Flags, Grid], variogram: Variogram
) -> None:
    known, grid = field
    places, values = places_of(grid, variogram), values_of(known).reshape(-1)
    near = plain_nearest(known, grid, min(8, int(known.sum()))).astype(np.int32)
    targets = np.flatnonzero(~known).astype(np.int32)
    expected, share = form.solve(near, targets, values, places)
    count = near.shape[1]
    for index, target in enumerate(targets):
        apart = [np.abs(axis[[*near[index], target], None] - axis[near[index]]) for axis in (places.row, places.column)]
        system = np.ones((count + 1, count + 1))
        system[:count, :count] = places.covariance[apart[0][:count], apart[1][:count]]
        np.fill_diagonal(system, 1 + 1e-9)
        system[count, count] = 0.0
        right = np.append(places.covariance[apart[0][count], apart[1][count]], 1.0)
        weights = np.linalg.solve(system, right)
        loose = 1e-15 * np.linalg.cond(system)  # what floating point leaves of a system that is nearly singular
        assert expected[index] == pytest.approx(weights[:count] @ values[near[index]], rel=1e-9, abs=1e-9 + 100 * loose)
        assert share[index] == pytest.approx(max(1 - weights @ right, 0.0), rel=1e-9, abs=1e-9 + 100 * loose)


@settings(max_examples=60)
@given(fields(), variograms)
def test_both_forms_give_the_same_bits(field: tuple[Flags, Grid], variogram: Variogram) -> None:
    known, grid = field
    targets, places = np.flatnonzero(~known).astype(np.int32), places_of(grid, variogram)
    near = [form.nearest(known, targets, grid, min(8, int(known.sum()))) for form in FORMS]
    np.testing.assert_array_equal(near[0], near[1])
    plain, fast = (form.solve(near[0], targets, values_of(known).reshape(-1), places) for form in FORMS)
    np.testing.assert_array_equal(plain, fast)


@pytest.mark.parametrize("size", [(1.0, 1.0), (0.001, 9.0), (9.0, 0.001)])
@pytest.mark.parametrize("shape", [(1, 9), (9, 1)])
def test_strips_of_cells_are_grids_too(shape: tuple[int, int], size: tuple[float, float]) -> None:
    grid, known = Grid(np.ones(shape, dtype=bool), *size), np.zeros(shape, dtype=bool)
    known.flat[[0, 4]] = True
    for form in FORMS:
        near = form.nearest(known, np.array([1, 2, 3, 8], dtype=np.int32), grid, 2)
        assert near.tolist() == [[0, 4], [0, 4], [4, 0], [4, 0]]


@pytest.mark.parametrize("known_rows", [1, 30])
def test_cells_far_from_all_captured_ones_have_the_same_neighbours(known_rows: int) -> None:
    known = np.zeros((110, 60), dtype=bool)
    known[:known_rows, :9] = True
    grid, targets = Grid(np.ones_like(known), 3.0, 2.0), np.flatnonzero(~known).astype(np.int32)
    near = [form.nearest(known, targets, grid, 8) for form in FORMS]
    np.testing.assert_array_equal(near[0], near[1])
    np.testing.assert_array_equal(near[1], plain_nearest(known, grid, 8))


@program
def predict_one_by_one(flat: Any, targets: Any, steps: Any, field: Any, room: Any) -> None:
    """As a compiled simulator would, that keeps captured cells only."""
    columns, width, known = field
    near, scratch, result = room
    for index in range(len(targets)):
        target = targets[index]
        corner = (target // columns + steps.margin[0]) * width + target % columns + steps.margin[1]
        found, _ = look(flat, corner, target, steps, 0, near)
        result[index] = expect(near, found, target, known, scratch)[0] if found == len(near) else np.nan


@settings(max_examples=40)
@given(fields(), variograms)
def test_a_cell_that_is_predicted_alone_is_that_of_the_map(field: tuple[Flags, Grid], variogram: Variogram) -> None:
    known, grid = field
    targets, steps = np.flatnonzero(~known).astype(np.int32), compiled_kriging.steps_for(grid)
    values, places, padded = values_of(known), places_of(grid, variogram), compiled_kriging.with_margin(known, steps)
    found, count = np.empty(len(targets)), min(8, int(known.sum()))
    predict_one_by_one(
        padded.reshape(-1),
        targets,
        steps,
        (grid.columns, padded.shape[1], (values.reshape(-1), places)),
        (np.empty(count, dtype=np.int32), compiled_kriging.scratch_for(count), found),
    )
    reached = ~np.isnan(found)
    covered = len(steps.way) == (2 * grid.rows - 1) * (2 * grid.columns - 1) - 1  # not where cells are very long
    assert reached.all() or not covered
    np.testing.assert_array_equal(found[reached], predict(values, known, ~known, grid, variogram)[0][reached])


MAP = """
import hashlib, sys
{first}
import numpy as np
from fleet.contexts.grid import Grid
from fleet.functions import kriging
values = np.random.default_rng(3).normal(size=(30, 40))
values[np.random.default_rng(4).random((30, 40)) < 0.8] = np.nan
print(kriging.prepare_for_many() if {many} else "", "numba" in sys.modules)
found = kriging.krige(values, Grid(np.ones((30, 40), dtype=bool), 3.0, 2.0))
print(hashlib.sha256(found.values.tobytes() + found.deviation.tobytes()).hexdigest())
"""


def said(first: str = "", many: bool = False, **environment: str) -> list[str]:
    """What a new process says of the form it has, and the digest of its map."""
    everything = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    program = MAP.format(first=first, many=many)
    done = subprocess.run(
        [sys.executable, "-c", program], env=everything, capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout.splitlines()


def test_maps_are_the_same_with_and_without_numba_and_where_its_cache_cannot_be_written() -> None:
    few = said()
    assert few[0] == " False"  # a few maps are made without loading it
    assert said(many=True) == ["True True", few[1]]
    assert said(first="sys.modules['numba'] = None", many=True) == ["False True", few[1]]
    # The only place that numba may then take is the folder that a variable names, and none does.
    assert said(many=True, NUMBA_CACHE_LOCATOR_CLASSES="UserProvidedCacheLocator") == ["True True", few[1]]


def test_a_process_that_predicts_many_cells_loads_the_compiled_form(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kriging._Predicted, "cells", 0)
    kriging._compiled.cache_clear()
    assert kriging._form(kriging._PATIENCE) is local_kriging
    assert kriging._form(1) is compiled_kriging
    assert kriging._form(1) is compiled_kriging
