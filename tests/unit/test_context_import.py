"""Import of tables, points and pictures: what becomes of them, and what is said of bad lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.base import Media
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.importing import (
    Imported,
    ImportOptions,
    import_file,
    import_pictures,
    import_points,
    import_table,
)
from fleet.contexts.importing.points import yield_from_flow
from fleet.contexts.manifest import BrokenContext, GridSpec, RenderScale

OPTIONS = ImportOptions(name="plot", date="2018-06-01", cell_height_m=10.0, cell_width_m=10.0)
TABLE = """row,col,exg,lai,picture
0,0,10,0.5,a.jpg
0,0,20,,b.jpg
0,2,30,0.25,c.jpg
1,1,40,NA,d.jpg
"""
METRE = 1 / 111_194.93


def values(imported: Imported, feature: str) -> list[list[float | None]]:
    grid = AutonomyCube(imported.content).values(feature)
    return [[None if np.isnan(value) else value for value in row] for row in grid.tolist()]


def errors(call: object) -> list[str]:
    with pytest.raises(BrokenContext) as caught:
        call()  # type: ignore[operator]  # a lambda
    return [str(problem) for problem in caught.value.problems]


def test_pictures_of_a_cell_are_averaged_and_missing_cells_stay_missing() -> None:
    imported = import_table(TABLE, OPTIONS)
    assert values(imported, "exg") == [[15.0, None, 30.0], [None, 40.0, None]]
    assert values(imported, "lai") == [[0.5, None, 0.25], [None, None, None]]
    assert imported.notes == (
        "columns that hold no numbers were left out: picture",
        "lai is missing in 2 of 4 lines",
        "4 lines averaged to 3 cells",
    )


def test_a_table_becomes_a_manifest() -> None:
    manifest = import_table(TABLE, OPTIONS).content.manifest
    assert manifest.grid == GridSpec(rows=2, columns=3, cell_height_m=10.0, cell_width_m=10.0)
    assert (manifest.name, manifest.truth, manifest.dates, manifest.render) == ("plot", "exg", ("2018-06-01",), None)
    assert manifest.feature_names == ("exg", "lai")


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", "  "])
def test_separators_are_found_out(separator: str) -> None:
    text = '"row" "col" "exg"\r\n0 0 1.5\r\n\r\n0 1 2.5\r\n'.replace(" ", separator)
    assert values(import_table("\ufeff" + text, OPTIONS), "exg") == [[1.5, 2.5]]


def test_every_bad_line_is_listed_with_its_column_and_what_to_write() -> None:
    text = 'row,col,exg,lai\n0,0,1,1\n-1,0,2,1\n0,1.5,3,1\n0,x,4\n1,,5,1\n1,1,"1,5",1\n1,2,high,inf\n'
    assert errors(lambda: import_table(text, OPTIONS)) == [
        "line 3: column row: is '-1'; write a whole number from 0",
        "line 4: column col: is '1.5'; write a whole number from 0",
        "line 5: has 3 fields, but the header has 4; write a field for every column, empty or not",
        "line 6: column col: is empty; write a whole number from 0",
        "line 7: column exg: is '1,5'; write 1.5 with a point",
        "line 8: column exg: is 'high'; write a number, or leave the field empty where nothing was measured",
        "line 8: column lai: is 'inf'; write a number, or leave the field empty where nothing was measured",
    ]


def test_a_message_shows_a_hundred_problems_and_says_how_many_there_are() -> None:
    text = "row,col,exg\n0,0,1\n" + "".join(f"a,{index},1\n" for index in range(250))
    with pytest.raises(BrokenContext, match="and 150 more of this kind") as caught:
        import_table(text, OPTIONS)
    assert len(caught.value.problems) == 250


def test_lines_that_repeat_another_word_by_word_count_once() -> None:
    imported = import_table("row,col,exg\n0,0,1\n0,0,1\n0,0,4\n", OPTIONS)
    assert values(imported, "exg") == [[2.5]]
    assert imported.notes[0] == "1 lines repeat an earlier line word by word and were left out"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; give a header and at least one line"),
        ("row,col,exg\n", "has a header only; give a header and at least one line"),
        ("row,col,col,exg\n0,0,0,1\n", "header: has 'col' more than once, or empty; name every column once"),
        ("x1,x2\n0,1\n", "header: says not in which cell the lines are; give columns row and col, or lat and lon; "
         "the table has x1, x2"),
        ("row,col,lai\n0,0,1\n", "truth: is not given; choose one of lai"),
        ("row,col,note\n0,0,wet\n", "truth: is not given; the table has no column of numbers"),
        ("row,col,exg\n9999999,0,1\n", "line 2: column row: is '9999999'; the grid has 0 to 4095"),
        ("row,col,exg\n0,0,\n", "truth: is not given; the table has no column of numbers"),
        ("row,col,date,exg\n0,0,June,1\n", "line 2: column date: is 'June'; write a date such as 2018-06-01, 2018-06 "
         "or 2018"),
    ],
)  # fmt: skip
def test_a_table_that_cannot_become_a_context_says_why(text: str, message: str) -> None:
    assert message in errors(lambda: import_table(text, OPTIONS))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (ImportOptions("plot", "2018-06-01"), "cell size: is not known; give the height and width of a cell in m, or "
         "columns lat and lon"),
        (ImportOptions("plot", cell_height_m=1, cell_width_m=1), "date: is not given; write a date such as "
         "2018-06-01, 2018-06 or 2018"),
        (ImportOptions("My Plot", "2018", cell_height_m=1, cell_width_m=1), "name: is 'My Plot'; use small letters, "
         "digits and -, such as field-2018-06-01"),
        (ImportOptions("plot", "2018", truth="yeild", cell_height_m=1, cell_width_m=1), "truth: there is no column of "
         "numbers 'yeild'; choose one of exg, lai"),
        (ImportOptions("plot", "2018", features=("exg", "ndvi")), "ndvi: there is no such column; the table has row, "
         "col, exg, lai, picture"),
        (ImportOptions("plot", "2018", rows=1, cell_height_m=1, cell_width_m=1), "line 5: column row: is '1'; the "
         "grid has 0 to 0"),
        (ImportOptions("plot", "2018", where={"year": "2001"}), "year: there is no such column; the table has row, "
         "col, exg, lai, picture"),
        (ImportOptions("plot", "2018", where={"row": "7"}), "row: no line has '7'; it has 0, 1"),
    ],
)  # fmt: skip
def test_wrong_options_say_what_to_write(options: ImportOptions, message: str) -> None:
    assert message in errors(lambda: import_table(TABLE, options))


def test_size_and_direction_of_cells_are_measured_from_positions() -> None:
    lines = [
        f"{row},{col},{40 - row * 12 * METRE},{-80 - col * 9 * METRE / np.cos(np.radians(40))},{row + col}"
        for row in range(4)
        for col in range(5)
    ]
    text = "\n".join(["row,col,latitude,long,exg", *lines])
    manifest = import_table(text, ImportOptions("plot", "2018")).content.manifest
    assert manifest.grid == GridSpec(
        rows=4, columns=5, cell_height_m=12.0, cell_width_m=9.0, rows_go_south=True, columns_go_east=False
    )
    assert [(feature.name, feature.attribute) for feature in manifest.features] == [
        ("lat", True),
        ("lon", True),
        ("exg", False),
    ]


def test_points_are_gridded_from_the_north_west_and_averaged() -> None:
    text = "lat long yield\n" + "".join(
        f"{0 + north * METRE} {0 + east * METRE} {value}\n"
        for north, east, value in ((25, 1, 100), (24, 9, 110), (14, 1, 120), (1, 22, 130))
    )
    imported = import_points(text, ImportOptions("plot", "2018", outliers=0))
    assert values(imported, "yield") == [[105.0, None, None], [120.0, None, None], [None, None, 130.0]]
    assert imported.content.manifest.render == RenderScale(feature="yield", low=0.0, high=130.0)


def test_a_year_can_be_chosen_and_outliers_are_left_out() -> None:
    lines = [f"2001 0 {index * 11 * METRE} {100 + index % 5}\n" for index in range(20)]
    text = "year lat lon yield\n" + "".join(lines) + f"2001 0 {21 * 11 * METRE} 900\n1999 0 0 50\n"
    imported = import_points(text, ImportOptions("plot", "2001", where={"year": "2001"}))
    assert max(value for value in values(imported, "yield")[0] if value is not None) == 104.0
    assert imported.notes == (
        "1 points with an outlying yield, or none, were left out",
        "20 points averaged to 20 cells",
    )


def test_yield_is_computed_from_the_grain_flow() -> None:
    flow = np.array([[16.54, 3.0, 116.0, 18.5], [16.54, 3.0, 0.0, 18.5]])
    expected = (16.54 * 3 * (100 - 18.5) / (100 - 15.5) / 56) / (116 * 360 / 6272640)
    assert yield_from_flow(flow, 9.144) == pytest.approx([expected, np.nan], rel=1e-6, nan_ok=True)


def test_bad_positions_are_listed() -> None:
    text = "lat,lon,yield\n91,0,1\n0,-181,1\n0,,1\nnorth,0,1\n"
    assert errors(lambda: import_points(text, OPTIONS)) == [
        "line 2: column lat: is '91'; write degrees from -90 to 90",
        "line 3: column lon: is '-181'; write degrees from -180 to 180",
        "line 4: column lon: is empty; write a number, or remove the line",
        "line 5: column lat: is 'north'; write a number, or leave the field empty where nothing was measured",
    ]


def test_points_without_positions_or_values_are_refused() -> None:
    assert errors(lambda: import_points("a,b\n1,2\n", OPTIONS)) == [
        "header: says not where the lines are; give columns lat and lon in degrees; the table has a, b"
    ]
    assert errors(lambda: import_points("lat,lon,yield,a\n1,2,,3\n2,2,NA,3\n", OPTIONS)) == [
        "truth: is not given; choose one of a"
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a.jpg", "b.png", "c.JPG"):
        (tmp_path / name).write_bytes(name.encode())
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "notes.txt").write_bytes(b"x")
    return tmp_path


def test_located_pictures_are_kept_and_their_features_averaged(folder: Path) -> None:
    text = "picture,row,col,exg\na.jpg,0,0,10\nb.png,0,0,20\nc.JPG,0,1,30\n"
    imported = import_pictures(text, folder, OPTIONS)
    context = AutonomyCube(imported.content)
    assert values(imported, "exg") == [[15.0, 30.0]]
    assert context.observe(0).media == (Media("image/jpeg", b"a.jpg"), Media("image/png", b"b.png"))
    assert context.observe(1).attributes["rendered"] == 0.0
    assert not context.renders


def test_pictures_can_be_placed_by_position_and_measured(folder: Path) -> None:
    text = f"picture,lat,lon,date\na.jpg,0,0,2018-06-01\nb.png,0,{15 * METRE},2018-06-01\n"
    imported = import_pictures(
        text, folder, ImportOptions("plot"), measure=lambda media: {"exg": float(len(media.data))}
    )
    assert values(imported, "exg") == [[5.0, 5.0]]
    assert imported.content.manifest.truth == "exg"


def test_pictures_without_a_truth_can_be_flown_but_not_judged(folder: Path) -> None:
    imported = import_pictures("picture,row,col\na.jpg,0,1\n", folder, OPTIONS)
    environment = AutonomyCube(imported.content).environment
    assert (environment.truth, environment.truth_name) == (None, "")
    assert environment.grid.valid.tolist() == [[False, True]]
    assert imported.notes[-1] == "no truth is known: missions over this context have no accuracy"


def test_every_bad_picture_is_listed(folder: Path) -> None:
    text = "picture,row,col\na.jpg,0,1\nnone.jpg,0,1\nnotes.txt,0,1\nempty.jpg,0,1\n,0,1\n"
    kinds = "name a file that ends in .jpg, .jpeg, .png, .ppm, .tif, .tiff, .webp"
    assert errors(lambda: import_pictures(text, folder, OPTIONS)) == [
        f"line 3: column picture: is 'none.jpg'; there is no such file in {folder}; correct the name, or add the file",
        f"line 4: column picture: is 'notes.txt'; {kinds}",
        "line 5: column picture: is 'empty.jpg'; the file is empty; add the picture, or remove the line",
        f"line 6: column picture: is empty; {kinds}",
    ]


def test_pictures_that_cannot_be_measured_are_listed(folder: Path) -> None:
    def measure(media: Media) -> dict[str, float]:
        raise ValueError("not a picture")

    assert errors(lambda: import_pictures("picture,row,col\na.jpg,0,1\n", folder, OPTIONS, measure)) == [
        "line 2: column picture: is 'a.jpg'; it cannot be measured: not a picture"
    ]


def test_a_file_is_imported_by_its_header(tmp_path: Path, folder: Path) -> None:
    table, points, located = tmp_path / "table.csv", tmp_path / "points.txt", tmp_path / "located.csv"
    table.write_text(TABLE)
    points.write_text("lat lon yield\n0 0 1\n0 0.0001 2\n")
    located.write_text("picture,row,col\na.jpg,0,1\n")
    assert import_file(table, OPTIONS).content.manifest.truth == "exg"
    assert import_file(points, OPTIONS).content.manifest.truth == "yield"
    assert import_file(located, OPTIONS, pictures=folder).content.pictures is not None


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"row,col\n\xff\xfe")
    assert errors(lambda: import_file(tmp_path / "a.csv", OPTIONS)) == [
        "is not text at byte 8; save the table as CSV in UTF-8"
    ]
    assert errors(lambda: import_file(tmp_path / "none.csv", OPTIONS)) == [
        "cannot be read: No such file or directory; give the path of a table"
    ]


def test_the_yield_monitors_of_other_fields_are_imported(shared_data: Path) -> None:
    maize = import_file(shared_data / "yield" / "gartner.corn.txt", ImportOptions("maize", "2011-11-05"))
    roses = import_file(
        shared_data / "yield" / "lasrosas.corn.txt",
        ImportOptions("roses", "2001", where={"year": "2001"}, cell_height_m=12, cell_width_m=12),
    )
    assert maize.notes[-1] == "4817 points averaged to 2708 cells"
    assert roses.notes[-1] == "1705 points averaged to 639 cells"
    assert np.nanmean(AutonomyCube(maize.content).values("yield")) == pytest.approx(136, abs=1)
