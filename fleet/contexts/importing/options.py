"""What an import is told, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fleet.contexts.cells import CubeContent

DEFAULT_CELL_M = 10.0
SWATH_M = 9.144
"""Twelve rows of maize: 360 inches."""


@dataclass(frozen=True)
class ImportOptions:
    """What the source itself does not say.

    Args:
        name: Name of the context.
        date: Year, month or day of all lines; not needed where the source has a column `date`.
        truth: The quantity that missions map; `exg`, else `yield`, when left out.
        source, licence, description: For people.
        rows, columns: Size of the grid; as large as the data needs when left out.
        cell_height_m, cell_width_m: Size of a cell; for a table with rows and columns they are measured from its
            positions when left out, for points 10 m.
        rows_go_south, columns_go_east: Which way rows and columns grow; measured from the positions when left out.
        features: Columns to import; every column of numbers when left out.
        where: Lines to import: the text that they must have in a column, such as {"year": "2001"}.
        outliers: Points whose truth is further from the median than this many robust standard deviations are left
            out; 0 keeps all.
        swath_m: Width that a harvester cuts, for yield from grain flow.
    """

    name: str
    date: str = ""
    truth: str = ""
    source: str = ""
    licence: str = ""
    description: str = ""
    rows: int | None = None
    columns: int | None = None
    cell_height_m: float | None = None
    cell_width_m: float | None = None
    rows_go_south: bool | None = None
    columns_go_east: bool | None = None
    features: tuple[str, ...] = ()
    where: Mapping[str, str] = field(default_factory=dict)
    outliers: float = 5.0
    swath_m: float = SWATH_M


@dataclass(frozen=True, eq=False)
class Imported:
    """A cube, and what the user should know of how it was made."""

    content: CubeContent
    notes: tuple[str, ...]
