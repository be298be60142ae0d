"""Parquet files of an autonomy cube; the only door to pyarrow.

features.parquet has `row`, `column` (whole numbers), `date` (text or date32) and a column of numbers for each
feature; pictures.parquet has the same three, `media_type` (text) and `data` (binary). Other columns are not read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from fleet.contexts.base import Media
from fleet.contexts.cells import Cells, Pictures
from fleet.contexts.manifest import KEYS
from fleet.errors import Problem

FEATURES = "features.parquet"
PICTURES = "pictures.parquet"


class TableError(Exception):
    """A table cannot be read; `problems` has everything that is wrong with it."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, problems)))


def read_cells(data: bytes, features: Sequence[str]) -> tuple[Cells, tuple[str, ...]]:
    """Read features.parquet.

    Args:
        data: The file.
        features: Names of the columns to read.

    Returns:
        The cells, and the names of columns that were not read.

    Raises:
        TableError: it is not Parquet, or columns are missing or of a wrong type.
    """
    table = _open(data, FEATURES)
    columns = _Columns(table, FEATURES)
    rows, numbers, dates = columns.integers("row"), columns.integers("column"), columns.dates("date")
    values = {name: columns.numbers(name) for name in features}
    columns.check()
    others = tuple(name for name in table.column_names if name not in {*KEYS, *features})
    return Cells(rows, numbers, dates, values), others


def write_cells(cells: Cells, float64: Sequence[str] = ()) -> bytes:
    """features.parquet of some cells.

    Args:
        cells: What to write.
        float64: Features that need more than the 24 bits of a float32.
    """
    columns = {
        name: pa.array(values, type=pa.float64() if name in float64 else pa.float32(), from_pandas=True)
        for name, values in cells.features.items()
    }
    return _write(pa.table({**_key_columns(cells), **columns}))


def read_pictures(data: bytes) -> Pictures:
    """Read pictures.parquet. Raises TableError, see `read_cells`."""
    columns = _Columns(_open(data, PICTURES), PICTURES)
    rows, numbers, dates = columns.integers("row"), columns.integers("column"), columns.dates("date")
    types, blobs = columns.texts("media_type"), columns.blobs("data")
    columns.check()
    media = tuple(Media(kind, blob) for kind, blob in zip(types, blobs, strict=True))
    return Pictures(rows, numbers, dates, media)


def write_pictures(pictures: Pictures) -> bytes:
    """pictures.parquet of some pictures."""
    media = {
        "media_type": pa.array([item.type for item in pictures.media], type=pa.string()),
        "data": pa.array([item.data for item in pictures.media], type=pa.binary()),
    }
    return _write(pa.table({**_key_columns(pictures), **media}))


class _Columns:
    """Typed columns of a table; collects what is wrong with them."""

    def __init__(self, table: pa.Table, file: str) -> None:
        self._table = table
        self._file = file
        self._problems: list[Problem] = []

    def check(self) -> None:
        """Raise what was found."""
        if self._problems:
            raise TableError(self._problems)

    def integers(self, name: str) -> NDArray[np.int64]:
        column = self._column(name, pa.types.is_integer, "whole numbers", nulls=False)
        if column is None:
            return np.zeros(0, dtype=np.int64)
        return np.asarray(column.cast(pa.int64(), safe=False).to_numpy(), dtype=np.int64)

    def numbers(self, name: str) -> NDArray[np.float64]:
        column = self._column(name, _is_number, "numbers", nulls=True)
        if column is None:
            return np.zeros(0, dtype=np.float64)
        return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)

    def dates(self, name: str) -> NDArray[np.str_]:
        column = self._column(name, _is_date, "text such as 2018-06-01", nulls=False)
        if column is None:
            return np.zeros(0, dtype=np.str_)
        return np.array(column.cast(pa.string()).to_pylist(), dtype=np.str_)

    def texts(self, name: str) -> list[str]:
        column = self._column(name, _is_text, "text", nulls=False)
        return [] if column is None else column.cast(pa.string()).to_pylist()

    def blobs(self, name: str) -> list[bytes]:
        column = self._column(name, _is_binary, "bytes", nulls=False)
        return [] if column is None else column.cast(pa.large_binary()).to_pylist()

    def _column(self, name: str, fits: object, wanted: str, *, nulls: bool) -> pa.ChunkedArray | None:
        """The column, or None when something is wrong with it."""
        path = f"{self._file}.{name}"
        found = self._table.schema.get_all_field_indices(name)
        if len(found) != 1:
            message = "is missing" if not found else "is there more than once"
            self._problems.append(Problem(path, message, f"the file needs one such column of {wanted}"))
            return None
        column = self._table.column(found[0])
        if pa.types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if not callable(fits) or not fits(column.type):
            self._problems.append(Problem(path, f"is of type {column.type}", f"write {wanted}"))
            return None
        if column.null_count and not nulls:
            first = next(i for i, value in enumerate(column.is_null().to_pylist()) if value)
            message = f"is empty in {column.null_count} entries, first in entry {first + 1}"
            self._problems.append(Problem(path, message, f"write {wanted} in every entry"))
            return None
        return column


def _open(data: bytes, file: str) -> pa.Table:
    # Damaged Parquet raises almost anything: ArrowException, OSError, ValueError, UnicodeDecodeError, MemoryError.
    try:
        table = pq.read_table(pa.BufferReader(data), page_checksum_verification=True, use_threads=False)
        table.validate(full=True)
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise TableError([Problem(file, f"is not Parquet that can be read: {reason[:200]}")]) from error
    return table


def _write(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True, store_schema=False)
    return bytes(sink.getvalue().to_pybytes())


def _key_columns(table: Cells | Pictures) -> Mapping[str, pa.Array]:
    return {
        "row": pa.array(table.rows, type=pa.int32()),
        "column": pa.array(table.columns, type=pa.int32()),
        "date": pa.array(table.dates.tolist(), type=pa.string()),
    }


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _is_date(kind: pa.DataType) -> bool:
    return _is_text(kind) or bool(pa.types.is_date32(kind))


def _is_binary(kind: pa.DataType) -> bool:
    return bool(pa.types.is_binary(kind) or pa.types.is_large_binary(kind))
