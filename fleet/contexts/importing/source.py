"""Import of a file, whatever its layout."""

from __future__ import annotations

from pathlib import Path

from fleet.contexts.importing.options import Imported, ImportOptions
from fleet.contexts.importing.pictures import Measure, import_pictures
from fleet.contexts.importing.points import import_points
from fleet.contexts.importing.sheet import VERDICT, read_sheet
from fleet.contexts.importing.table import COLUMN, ROW, import_table
from fleet.contexts.manifest import BrokenContext
from fleet.errors import Problem


def import_file(
    file: Path, options: ImportOptions, pictures: Path | None = None, measure: Measure | None = None
) -> Imported:
    """Make a cube of a table: with a folder of pictures, with rows and columns, or with points, as its header says.

    Args:
        file: The table.
        options: What the table does not say.
        pictures: Folder of the pictures that the table names.
        measure: Measures features of each picture.

    Raises:
        BrokenContext: it cannot be read; lists every bad line.
    """
    where = str(file)
    try:
        text = file.read_text("utf-8")
    except OSError as error:
        problem = Problem("", f"cannot be read: {error.strerror or error}", "give the path of a table")
        raise BrokenContext(where, [problem], VERDICT) from error
    except UnicodeDecodeError as error:
        problem = Problem("", f"is not text at byte {error.start}", "save the table as CSV in UTF-8")
        raise BrokenContext(where, [problem], VERDICT) from error
    if pictures is not None:
        return import_pictures(text, pictures, options, measure, where)
    sheet, _ = read_sheet(text, where)
    if sheet.find(*ROW) is not None and sheet.find(*COLUMN) is not None:
        return import_table(text, options, where)
    return import_points(text, options, where)
