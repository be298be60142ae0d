"""Is it a good context? Problems, warnings and statistics of one on disk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import ContextKind
from fleet.contexts.cells import examine
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.files import place, read_cube, read_file
from fleet.contexts.manifest import MANIFEST, BrokenContext, kind_of
from fleet.errors import Problem, StorageError
from fleet.storage.port import Storage

FEW_CELLS = 9


@dataclass(frozen=True)
class FeatureStatistics:
    """A feature over the cells of one date.

    Args:
        missing: Cells with data in which the feature is not known.
        minimum, mean, maximum: In the feature's unit; NaN when no cell has it.
    """

    name: str
    unit: str
    missing: int
    minimum: float
    mean: float
    maximum: float


@dataclass(frozen=True)
class Statistics:
    """A context in numbers, on one date.

    Args:
        cells: Cells of the grid.
        with_data: Cells with data.
        rendered: Whether its pictures are drawn from the features.
        correlation_m: Distance at which the truth's autocorrelation falls to 1/e, in m; None when it does not
            within half of the grid, or there is no truth.
    """

    name: str
    kind: str
    digest: str
    date: str
    rows: int
    columns: int
    cells: int
    with_data: int
    rendered: bool
    features: tuple[FeatureStatistics, ...]
    correlation_m: float | None

    @property
    def coverage(self) -> float:
        """Share of the cells that have data."""
        return self.with_data / self.cells


@dataclass(frozen=True)
class ContextReport:
    """What a check found; statistics are there when there is no problem."""

    where: str
    problems: tuple[Problem, ...]
    warnings: tuple[Problem, ...] = ()
    statistics: tuple[Statistics, ...] = ()

    @property
    def is_good(self) -> bool:
        """Whether missions can fly over the context."""
        return not self.problems


def check_context(storage: Storage, path: str = "") -> ContextReport:
    """Look at a context on disk; whatever is wrong with it is in the report, nothing is raised.

    Returns:
        Statistics of each of its dates when it is good.
    """
    where = place(storage, path)
    try:
        kind = kind_of(read_file(storage, path, MANIFEST), where)
        if kind is not ContextKind.AUTONOMY_CUBE:
            hint = f"this version flies {ContextKind.AUTONOMY_CUBE}"
            return ContextReport(where, (Problem("kind", f"{kind} is planned, but not built", hint),))
        content, unread = read_cube(storage, path)
    except BrokenContext as error:
        return ContextReport(where, error.problems)
    except StorageError as error:
        return ContextReport(where, (Problem("", str(error)),))
    findings = examine(content)
    hint = "list it under features in context.yaml"
    warnings = [*findings.warnings, *(Problem(name, "is a column that nobody reads", hint) for name in unread)]
    if findings.problems:
        return ContextReport(where, tuple(sorted(findings.problems)), tuple(sorted(warnings)))
    newest = AutonomyCube(content)
    cubes = [newest.at(date) for date in newest.observed]
    for cube in cubes:
        warnings += _thin(cube)
    return ContextReport(where, (), tuple(sorted(warnings)), tuple(statistics_of(cube) for cube in cubes))


def statistics_of(cube: AutonomyCube) -> Statistics:
    """A cube in numbers, on its date."""
    environment = cube.environment
    grid = environment.grid
    correlation = None
    if environment.truth is not None:
        truth = np.where(grid.valid, environment.truth, np.nan)
        correlation = correlation_length_m(truth, grid.cell_height_m, grid.cell_width_m)
    return Statistics(
        name=environment.name,
        kind=cube.kind.value,
        digest=environment.digest,
        date=cube.date,
        rows=grid.rows,
        columns=grid.columns,
        cells=grid.cells,
        with_data=int(np.count_nonzero(grid.valid)),
        rendered=cube.renders,
        features=tuple(_feature(cube, feature.name, feature.unit) for feature in cube.manifest.features),
        correlation_m=correlation,
    )


def correlation_length_m(values: NDArray[np.float64], height_m: float, width_m: float) -> float | None:
    """Distance at which the autocorrelation of a map falls to 1/e, in m.

    Pairs of cells in the same row or column are compared, up to half of the grid; linear between lags.

    Args:
        values: The map, [rows, columns]; NaN is left out.
        height_m, width_m: Size of a cell.

    Returns:
        None when it does not fall so far, or the map does not vary.
    """
    spread = values - np.nanmean(values)
    variance = float(np.nanmean(spread**2))
    if not variance > 0:
        return None
    lags = [(lag * height_m, _at_lag(spread, lag)) for lag in range(1, values.shape[0] // 2 + 1)]
    lags += [(lag * width_m, _at_lag(spread.T, lag)) for lag in range(1, values.shape[1] // 2 + 1)]
    before_m, before = 0.0, 1.0
    for distance_m, covariance in sorted(lags):
        if np.isnan(covariance):
            continue
        now = covariance / variance
        if now <= np.exp(-1):
            share = (before - np.exp(-1)) / (before - now)
            return float(before_m + share * (distance_m - before_m))
        before_m, before = distance_m, now
    return None


def _at_lag(spread: NDArray[np.float64], lag: int) -> float:
    """Mean product of cells that are a lag apart along the first axis; NaN without pairs."""
    products = spread[lag:] * spread[:-lag]
    known = products[np.isfinite(products)]
    return float(known.mean()) if len(known) else float("nan")


def _feature(cube: AutonomyCube, name: str, unit: str) -> FeatureStatistics:
    values = cube.values(name)[cube.environment.grid.valid]
    known = values[np.isfinite(values)]
    missing = len(values) - len(known)
    if not len(known):
        return FeatureStatistics(name, unit, missing, float("nan"), float("nan"), float("nan"))
    return FeatureStatistics(name, unit, missing, float(known.min()), float(known.mean()), float(known.max()))


def _thin(cube: AutonomyCube) -> list[Problem]:
    with_data = int(np.count_nonzero(cube.environment.grid.valid))
    found = []
    if with_data < FEW_CELLS:
        found.append(Problem("", f"only {with_data} cells have data on {cube.date}", "agents have nothing to choose"))
    truth = cube.environment.truth
    if truth is not None and with_data > 1 and np.nanmin(truth) == np.nanmax(truth):
        found.append(Problem(cube.manifest.truth or "", f"is the same everywhere on {cube.date}"))
    return found
