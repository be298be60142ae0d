"""Fields to scout: real ones of the shared data, one on which a good policy must win, and one on which none can.

Measurements that fall into one cell are averaged. Cells with data: 2,106, 1,278 and 1,787 of the corn field's three
dates, 2,759 of gartner on 10 m, and on 12 m 638 of lasrosas 2001 and 582 of lasrosas 1999. In 2001 lasrosas is one half
low and one half high, with few cells between (41 and 53 % in the outer classes); in 1999 no yield is far from the mean
(7, 17, 21 and 56 % in the four classes).
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid

ROOT = Path(__file__).resolve().parents[2]
CORN = ("2018-06-01", "2018-08-02", "2018-09-16")
REAL = (*CORN, "gartner", "lasrosas", "lasrosas-1999")
AIMED = (*CORN, "gartner")
"""The fields whose mean the aims are stated for; lasrosas is small, and 2001 is too easy."""
PLANTED, NOISE = "planted", "noise"
MADE_UP = (PLANTED, NOISE)
NAMES = (*REAL, *MADE_UP)
_CORN_SHAPE, _CORN_CELL_M = (56, 44), (11.9, 8.9)
Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Field:
    """A field, completely known.

    Args:
        environment: Its grid, and the true quantity in every cell.
    """

    environment: Environment

    @property
    def name(self) -> str:
        """Name of the field."""
        return self.environment.name

    @property
    def grid(self) -> Grid:
        """Its cells."""
        return self.environment.grid

    @cached_property
    def truth(self) -> Values:
        """The quantity in every cell, float64 [cells]; NaN without data."""
        assert self.environment.truth is not None
        return self.environment.truth.reshape(-1)

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """Cells with data, ascending."""
        return np.flatnonzero(self.grid.valid)

    def seen(self, captured: NDArray[np.bool_]) -> Values:
        """What is known after some cells were captured, float64 [rows, columns]; NaN elsewhere.

        Args:
            captured: bool [cells].
        """
        return np.where(captured, self.truth, np.nan).reshape(self.grid.rows, self.grid.columns)


def averaged_over(names: Sequence[str]) -> list[str]:
    """Of some fields those whose mean is told: those of the aims where all of them are there, else all."""
    return list(AIMED) if set(AIMED) <= set(names) else list(names)


def data_folder() -> Path:
    """Where the real data is: FLEET_DATA, or the shared data beside the checkout.

    Raises:
        FileNotFoundError: it is not there.
    """
    folder = Path(os.environ.get("FLEET_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        raise FileNotFoundError(f"the real data is not at {folder}; set FLEET_DATA to its folder")
    return folder


def field(name: str, seed: int = 0) -> Field:
    """A field by name; one that is made up is drawn anew with every seed.

    Raises:
        KeyError: there is no such field.
        FileNotFoundError: the real data is not there.
    """
    readers: dict[str, Callable[[], Environment]] = {
        **{date: partial(_corn_of, date) for date in CORN},
        "gartner": lambda: gartner(data_folder()),
        "lasrosas": lambda: lasrosas(data_folder(), "lasrosas", "2001"),
        "lasrosas-1999": lambda: lasrosas(data_folder(), "lasrosas-1999", "1999"),
        PLANTED: lambda: planted(seed),
        NOISE: lambda: noise(seed),
    }
    return Field(readers[name]())


def _corn_of(date: str) -> Environment:
    return corn(data_folder(), date)


def corn(data: Path, date: str) -> Environment:
    """Excess green of the Ohio corn field, the mean of the pictures in each cell."""
    with (data / "corn-cube" / f"{date}.csv").open(newline="") as file:
        rows = [(int(row["row"]), int(row["col"]), float(row["exg"])) for row in csv.DictReader(file)]
    cells = np.array([row[:2] for row in rows])
    grid = Grid(np.ones(_CORN_SHAPE, dtype=np.bool_), *_CORN_CELL_M, rows_go_south=True, columns_go_east=False)
    return _averaged((date, "exg"), cells, np.array([row[2] for row in rows]), grid)


def gartner(data: Path) -> Environment:
    """Grain flow of the Gartner field on 10 m; points at which the harvester stood empty are no yield."""
    points = _points(data / "yield" / "gartner.corn.txt", "mass")
    return _yield("gartner", points[points[:, 2] > 0], 10.0)


def lasrosas(data: Path, name: str, year: str) -> Environment:
    """Yield of the Las Rosas field in one of its two seasons on 12 m."""
    return _yield(name, _points(data / "yield" / "lasrosas.corn.txt", "yield", year=year), 12.0)


def planted(seed: int, rows: int = 40, columns: int = 50) -> Environment:
    """Two wide zones without doubt, and a narrow band between them where classes change from cell to cell.

    Whoever looks at its belief flies where classes are in doubt, and needs a fraction of what a plan without it needs.
    """
    generator = np.random.default_rng(seed)
    across = np.arange(columns)[None, :] - columns * (0.3 + 0.2 * np.arange(rows)[:, None] / rows)
    level = np.where(across < 0, 60.0, 120.0)
    doubt = np.abs(across) < 0.12 * columns
    truth = np.where(doubt, generator.uniform(60.0, 120.0, (rows, columns)), level)
    truth = truth + generator.normal(0.0, 1.0, (rows, columns))
    return Environment(f"{PLANTED}-{seed}" if seed else PLANTED, "", _full(rows, columns), "exg", truth)


def noise(seed: int, rows: int = 40, columns: int = 50) -> Environment:
    """White noise about the bound between two classes: at equal cells no plan can beat another.

    No cell says anything about another one, and whatever class a map gives an unseen cell, it is right in one case of
    two. (With a wider noise it would not be so: of the four classes some are more probable, and who captures where
    the map has one of the others gains some points without having predicted anything.)
    """
    truth = np.random.default_rng(seed).normal(100.0, 3.0, (rows, columns))
    return Environment(f"{NOISE}-{seed}" if seed else NOISE, "", _full(rows, columns), "exg", truth)


def _full(rows: int, columns: int) -> Grid:
    return Grid(np.ones((rows, columns), dtype=np.bool_), 10.0, 10.0)


def _points(path: Path, quantity: str, **where: str) -> Values:
    """Latitude, longitude and a quantity, float64 [n, 3]."""
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file, delimiter="\t") if all(row[k] == v for k, v in where.items())]
    return np.array([[float(row[name]) for name in ("lat", "long", quantity)] for row in rows])


def _yield(name: str, points: Values, cell_m: float) -> Environment:
    """Points on square cells; row 0 is the most southern, column 0 the most western."""
    lat, lon, quantity = points.T
    north_m, east_m = _metres_a_degree(math.radians(float(lat.mean())))
    cells = np.stack(((lat - lat.min()) * north_m // cell_m, (lon - lon.min()) * east_m // cell_m), axis=1).astype(int)
    shape = (int(cells[:, 0].max()) + 1, int(cells[:, 1].max()) + 1)
    grid = Grid(np.ones(shape, dtype=np.bool_), cell_m, cell_m, rows_go_south=False)
    return _averaged((name, "yield"), cells, quantity, grid)


def _metres_a_degree(lat: float) -> tuple[float, float]:
    """Length of a degree of latitude and of longitude on the WGS 84 ellipsoid, in m; `lat` in rad."""
    north = 111_132.92 - 559.82 * math.cos(2 * lat) + 1.175 * math.cos(4 * lat)
    return north, 111_412.84 * math.cos(lat) - 93.5 * math.cos(3 * lat)


def _averaged(names: tuple[str, str], cells: NDArray[np.int64], values: Values, whole: Grid) -> Environment:
    """Mean of the values in each cell; a cell without any has no data."""
    numbers = cells[:, 0] * whole.columns + cells[:, 1]
    count = np.bincount(numbers, minlength=whole.cells)
    total = np.bincount(numbers, values, minlength=whole.cells)
    truth = np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(whole.rows, whole.columns)
    grid = Grid(np.isfinite(truth), whole.cell_height_m, whole.cell_width_m, whole.rows_go_south, whole.columns_go_east)
    return Environment(names[0], "", grid, names[1], truth)
