"""Tables as text: comma, semicolon, tab or space separated, quoted or not, with a header."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.manifest import BrokenContext
from fleet.errors import Problem

VERDICT = "cannot be imported"
MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})
_DATE = re.compile(r"[0-9]{4}(-[0-9]{2}(-[0-9]{2})?)?")


@dataclass(eq=False)
class Sheet:
    """A table of text, and what was found wrong in it.

    Args:
        where: Name of the source, for messages.
        header: Names of the columns.
        numbers: Line number of each line in the file.
        lines: Fields of each line.
        problems: Grows as columns are read; `check` raises them all.
    """

    where: str
    header: tuple[str, ...]
    numbers: list[int]
    lines: list[tuple[str, ...]]
    problems: list[Problem] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.lines)

    def find(self, *names: str) -> str | None:
        """The first column that has one of these names, in whatever case; None when there is none."""
        by_name = {column.lower(): column for column in reversed(self.header)}
        return next((by_name[name] for name in names if name in by_name), None)

    def texts(self, column: str) -> list[str]:
        """Fields of a column."""
        index = self.header.index(column)
        return [line[index] for line in self.lines]

    def floats(self, column: str, *, required: bool = False) -> NDArray[np.float64]:
        """Numbers of a column, NaN where nothing was measured; what is no number becomes a problem of its line."""
        values = np.full(len(self), np.nan)
        for index, text in enumerate(self.texts(column)):
            if text.lower() in MISSING:
                if required:
                    self.blame(index, column, text, "write a number, or remove the line")
                continue
            value = as_number(text)
            if value is None:
                self.blame(index, column, text, _advice(text))
            else:
                values[index] = value
        return values

    def integers(self, column: str) -> NDArray[np.int64]:
        """Whole numbers from 0 of a column; everything else becomes a problem of its line."""
        values = np.zeros(len(self), dtype=np.int64)
        for index, text in enumerate(self.texts(column)):
            value = as_number(text)
            if value is None or value != int(value) or not 0 <= value < 2**31:
                self.blame(index, column, text, "write a whole number from 0")
            else:
                values[index] = int(value)
        return values

    def dates(self, column: str | None, date: str) -> NDArray[np.str_]:
        """Dates of a column, or one date for all lines; what is no date becomes a problem."""
        hint = "write a date such as 2018-06-01, 2018-06 or 2018"
        if column is None:
            if not _DATE.fullmatch(date):
                self.problems.append(Problem("date", f"is {date!r}" if date else "is not given", hint))
            return np.array([date] * len(self), dtype=np.str_)
        texts = [text[:10] for text in self.texts(column)]
        for index, text in enumerate(texts):
            if not _DATE.fullmatch(text):
                self.blame(index, column, text, hint)
        return np.array(texts, dtype=np.str_)

    def blame(self, index: int, column: str, text: str, hint: str) -> None:
        """Note that a field of a line is not what it should be."""
        shown = f"is {text[:40]!r}" if text else "is empty"
        self.problems.append(Problem(f"column {column}", shown, hint, self.numbers[index]))

    def check(self) -> None:
        """Raise everything that was found, in the order of the lines.

        Raises:
            BrokenContext: something was found.
        """
        if self.problems:
            raise BrokenContext(self.where, sorted(set(self.problems), key=lambda found: (found.line, found)), VERDICT)

    def is_numeric(self, column: str) -> bool:
        """Whether at least half of what a column has are numbers."""
        texts = [text for text in self.texts(column) if text.lower() not in MISSING]
        return bool(texts) and 2 * sum(as_number(text) is not None for text in texts) >= len(texts)

    def having(self, column: str, wanted: str) -> Sheet:
        """The same table with the lines that have a text in a column."""
        chosen = [index for index, text in enumerate(self.texts(column)) if text == wanted]
        numbers, lines = [self.numbers[i] for i in chosen], [self.lines[i] for i in chosen]
        return Sheet(self.where, self.header, numbers, lines, self.problems)


def read_sheet(text: str, where: str, selection: Mapping[str, str] | None = None) -> tuple[Sheet, list[str]]:
    """Read a table; lines that repeat an earlier one word by word count once.

    Args:
        text: The table with its header; the separator is found out.
        where: Name of the source, for messages.
        selection: Only lines that have this text in this column.

    Returns:
        The table, and notes for the user.

    Raises:
        BrokenContext: it is empty, or columns of the selection are not there.
    """
    rows = list(_rows(text.removeprefix("\ufeff"), where))
    if len(rows) < 2:
        hint = "give a header and at least one line"
        raise BrokenContext(where, [Problem("", "is empty" if not rows else "has a header only", hint)], VERDICT)
    header = tuple(name.strip() for name in rows[0][1])
    sheet = Sheet(where, header, [], [])
    twice = sorted({name for name in header if header.count(name) > 1 or not name})
    if twice:
        names = ", ".join(repr(name) for name in twice)
        sheet.problems.append(Problem("header", f"has {names} more than once, or empty", "name every column once"))
        sheet.check()
    repeated = _fill(sheet, rows[1:])
    notes = [f"{repeated} lines repeat an earlier line word by word and were left out"] if repeated else []
    return _selected(sheet, selection or {}), notes


def as_number(text: str) -> float | None:
    """The finite number that a text means, else None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in text else None


def _rows(text: str, where: str) -> Iterator[tuple[int, list[str]]]:
    first = text.split("\n", 1)[0]
    separator = next((mark for mark in "\t;," if mark in first), " ")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    try:
        for row in reader:
            fields = [part.strip() for part in row]
            if separator == " ":
                fields = [part for part in fields if part]
            if any(fields):
                yield reader.line_num, fields
    except csv.Error as error:
        hint = "check the quotes of that line"
        raise BrokenContext(where, [Problem("", str(error), hint, reader.line_num)], VERDICT) from error


def _fill(sheet: Sheet, rows: list[tuple[int, list[str]]]) -> int:
    """Take over all good lines; returns how many repeat an earlier one."""
    seen: set[tuple[str, ...]] = set()
    repeated = 0
    for number, fields in rows:
        line = tuple(fields)
        if len(line) != len(sheet.header):
            message = f"has {len(line)} fields, but the header has {len(sheet.header)}"
            sheet.problems.append(Problem("", message, "write a field for every column, empty or not", number))
        elif line in seen:
            repeated += 1
        else:
            seen.add(line)
            sheet.numbers.append(number)
            sheet.lines.append(line)
    return repeated


def _selected(sheet: Sheet, selection: Mapping[str, str]) -> Sheet:
    for column, wanted in selection.items():
        if column not in sheet.header:
            hint = f"the table has {', '.join(sheet.header)}"
            raise BrokenContext(sheet.where, [Problem(column, "there is no such column", hint)], VERDICT)
        there = sorted(set(sheet.texts(column)))
        sheet = sheet.having(column, wanted)
        if not sheet.lines:
            problem = Problem(column, f"no line has {wanted!r}", f"it has {', '.join(there[:10])}")
            raise BrokenContext(sheet.where, [problem], VERDICT)
    return sheet


def _advice(text: str) -> str:
    comma = text.replace(",", ".")
    if comma != text and as_number(comma) is not None:
        return f"write {comma} with a point"
    return "write a number, or leave the field empty where nothing was measured"
