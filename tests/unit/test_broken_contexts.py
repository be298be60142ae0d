"""Broken contexts: what is wrong, where, and what to write; nothing crashes, and nothing broken is flown over."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fleet.contexts.base import Media
from fleet.contexts.check import check_context
from fleet.contexts.files import write_cube
from fleet.contexts.load import copy_context, load_context
from fleet.contexts.manifest import BrokenContext, PictureKind, RenderScale
from fleet.errors import ContextError, StorageUnavailable
from tests.context_builders import DATE, MemoryStorage, cells, manifest, pictured, plot

Change = Callable[[dict[str, Any]], object]


def stored(content: Any = None) -> MemoryStorage:
    storage = MemoryStorage()
    write_cube(content or plot(), storage)
    return storage


def with_columns(change: Change) -> MemoryStorage:
    """A good context whose table was changed by hand."""
    storage = stored()
    columns = pq.read_table(io.BytesIO(storage.objects["features.parquet"])).to_pydict()
    change(columns)
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink)
    storage.objects["features.parquet"] = sink.getvalue()
    return storage


def with_manifest(old: str, new: str) -> MemoryStorage:
    storage = stored()
    text = storage.objects["context.yaml"].decode()
    assert old in text
    storage.objects["context.yaml"] = text.replace(old, new).encode()
    return storage


def problems_of(storage: MemoryStorage) -> str:
    """What the check says; loading must say the same."""
    report = check_context(storage)
    assert not report.statistics
    with pytest.raises(ContextError) as caught:
        load_context(storage)
    if isinstance(caught.value, BrokenContext):
        assert sorted(caught.value.problems) == sorted(report.problems)
    return "\n".join(map(str, report.problems))


def put(name: str, index: int, value: object) -> Change:
    return lambda columns: columns[name].__setitem__(index, value)


def test_a_good_context_has_no_problems() -> None:
    report = check_context(stored())
    assert report.is_good
    assert report.warnings == ()
    assert [statistics.with_data for statistics in report.statistics] == [11]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("column", 1, 0), "features.parquet: has more than one entry for row 0, column 0 (2018-06-01); keep one "
         "entry a cell and date; `fleet context import` averages them"),
        (put("row", 2, 3), "features.parquet.row: is outside of the grid in row 3, column 2 (2018-06-01); the grid of "
         "context.yaml has rows 0 to 2"),
        (put("column", 2, -1), "features.parquet.column: is outside of the grid in row 0, column -1 (2018-06-01); the "
         "grid of context.yaml has columns 0 to 3"),
        (put("date", 2, "2018-07-01"), "features.parquet.date: has 2018-07-01; list every date under dates in "
         "context.yaml"),
        (put("exg", 2, float("inf")), "exg: is infinite in row 0, column 2 (2018-06-01); leave the value out where it "
         "is unknown"),
        (put("exg", 2, -450.0), "render: the picture cannot show the value in row 0, column 2 (2018-06-01); pictures "
         "show excess green from -400 to 400; use another scale"),
        (put("row", 2, None), "features.parquet.row: is empty in 1 entries, first in entry 3; write whole numbers in "
         "every entry"),
        (put("date", 4, None), "features.parquet.date: is empty in 1 entries, first in entry 5; write text such as "
         "2018-06-01 in every entry"),
        (lambda columns: columns.update(row=[0.0] * 11), "features.parquet.row: is of type double; write whole "
         "numbers"),
        (lambda columns: columns.update(exg=["12"] * 11, brightness=[True] * 11), "features.parquet.exg: is of type "
         "string; write numbers\nfeatures.parquet.brightness: is of type bool; write numbers"),
        (lambda columns: columns.update(date=[20180601] * 11), "features.parquet.date: is of type int64; write text "
         "such as 2018-06-01"),
        (lambda columns: columns.pop("exg"), "features.parquet.exg: is missing; the file needs one such column of "
         "numbers"),
        (lambda columns: [values.clear() for values in columns.values()], "features.parquet.row: is of type null; "
         "write whole numbers"),
        (lambda columns: columns.update(exg=[float("nan")] * 11), "no cell has a value of exg; a context needs at "
         "least one cell with data"),
    ],
)  # fmt: skip
def test_a_wrong_table_is_refused_with_what_to_write(change: Change, message: str) -> None:
    assert message in problems_of(with_columns(change))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: AutonomyCube", "kind: Cube", "kind: there is no kind of context 'Cube'; write kind: AutonomyCube"),
        ("kind: AutonomyCube\n", "", "kind: is missing; write kind: AutonomyCube"),
        ("v1alpha1", "v9", "apiVersion: is 'context.fleetcomputer.io/v9'; this version reads "
         "context.fleetcomputer.io/v1alpha1"),
        ("rows: 3", "rows: 0", "grid.rows: input should be greater than or equal to 1, not 0"),
        ("rows: 3", "rows: three", "grid.rows: input should be a valid integer, unable to parse string as an integer, "
         "not 'three'"),
        ("rows: 3, ", "", "grid.rows: is missing; see docs/contexts.md for the format"),
        ("cellWidthM: 8.0", "cellWidthM: .nan", "grid.cellWidthM: input should be a finite number, not nan"),
        ("truth: exg", "truth: yield", "truth: there is no feature 'yield'; list it under features"),
        ("name: brightness", "name: exg", "features: 'exg' is a key column, or listed twice; give it another name"),
        ("name: brightness", "name: row", "features: 'row' is a key column, or listed twice; give it another name"),
        ("name: plot", "name: My Plot", "name: is 'My Plot'; use small letters, digits and -, such as "
         "field-2018-06-01"),
        ("licence:", "license:", "license: is not a field of context.yaml; remove it, or correct its name"),
        ("'2018-06-01'", "June", "dates.0: string should match pattern"),
        ("pictures: Rendered", "pictures: Drawn", "pictures: input should be 'Stored' or 'Rendered', not 'Drawn'"),
        ("pictures: Rendered", "pictures: Stored", "pictures.parquet: is missing; add it, or write pictures: Rendered "
         "in context.yaml"),
        ("pictures: Rendered", "render: {feature: exg, low: 1, high: 1}", "render: low and high must differ"),
        ("kind: AutonomyCube", "kind: [", "context.yaml: is not YAML"),
        ("kind: AutonomyCube", "dates: &a [1]\nkind: *a", "context.yaml: is not YAML: write it out in "
         "place of an alias"),
    ],
)  # fmt: skip
def test_a_wrong_context_yaml_is_refused_with_what_to_write(old: str, new: str, message: str) -> None:
    assert message in problems_of(with_manifest(old, new))


@pytest.mark.parametrize("content", [b"", b"12", b"- a", b"\xff\xfe\x00", b"null"])
def test_a_context_yaml_that_is_no_mapping_is_refused(content: bytes) -> None:
    storage = stored()
    storage.objects["context.yaml"] = content
    assert problems_of(storage).startswith("context.yaml: is not")


@pytest.mark.parametrize("name", ["context.yaml", "features.parquet"])
def test_a_missing_file_is_named(name: str) -> None:
    storage = stored()
    del storage.objects[name]
    assert problems_of(storage) == (f"{name}: is missing; a context is a folder with context.yaml and features.parquet")


@pytest.mark.parametrize("content", [b"", b"PAR1", b"row,col\n1,2\n", b"PAR1" * 100])
def test_a_table_that_is_not_parquet_is_refused(content: bytes) -> None:
    storage = stored()
    storage.objects["features.parquet"] = content
    assert problems_of(storage).startswith("features.parquet: is not Parquet that can be read")


def test_a_flipped_bit_in_the_data_is_found() -> None:
    storage = stored()
    data = bytearray(storage.objects["features.parquet"])
    data[60] ^= 1
    storage.objects["features.parquet"] = bytes(data)
    assert not check_context(storage).is_good


def test_cells_whose_truth_is_not_a_number_have_no_data() -> None:
    storage = with_columns(put("exg", 0, float("nan")))
    report = check_context(storage)
    context = load_context(storage)
    assert [str(warning) for warning in report.warnings] == [
        "exg: is missing in 1 of 11 entries; these cells count as cells without data"
    ]
    assert not context.environment.grid.valid[0, 0]
    with pytest.raises(ContextError, match="has no data in row 0, column 0"):
        context.observe(0)


def test_cells_without_another_feature_are_still_drawn() -> None:
    context = load_context(with_columns(put("brightness", 0, None)))
    assert context.observe(0).media


def test_a_column_that_nobody_reads_is_a_warning() -> None:
    report = check_context(with_columns(lambda columns: columns.update(note=["x"] * 11)))
    assert [str(warning) for warning in report.warnings] == [
        "note: is a column that nobody reads; list it under features in context.yaml"
    ]


@pytest.mark.parametrize("kind", ["VideoStream", "PointCloud"])
def test_kinds_that_come_later_are_refused_by_name(kind: str) -> None:
    storage = with_manifest("AutonomyCube", kind)
    assert not check_context(storage).is_good
    with pytest.raises(ContextError, match=f"contexts of kind {kind} are planned, but this version cannot fly them"):
        load_context(storage)


def test_a_cell_with_neither_picture_nor_feature_is_refused() -> None:
    content = pictured()
    bare = dataclasses.replace(
        content,
        manifest=manifest(("lai",), truth="lai", pictures=PictureKind.STORED),
        cells=cells([(0, 0), (2, 3)], {"lai": [1.0, 2.0]}),
    )
    assert problems_of(stored(bare)) == (
        "pictures: there is none and none can be rendered in row 2, column 3 (2018-06-01); add a picture, or the "
        "feature that pictures show, or leave the cell out"
    )


def test_an_empty_picture_is_refused() -> None:
    assert "pictures.parquet.data: is empty in row 0, column 1" in problems_of(
        stored(pictured([Media("image/png", b"x"), Media("image/png", b"")]))
    )


def test_nothing_to_draw_from_is_refused() -> None:
    content = dataclasses.replace(plot(), manifest=manifest(("brightness",), truth="brightness"))
    content = dataclasses.replace(content, cells=cells([(0, 0)], {"brightness": [0.5]}))
    assert problems_of(stored(content)) == (
        "render: nothing says what rendered pictures show; add a feature `exg`, or write render: "
        "{feature: ..., low: 0, high: ...} in context.yaml"
    )


def test_what_the_user_should_still_say_is_a_warning() -> None:
    content = plot()
    silent = content.manifest.model_copy(update={"source": "", "licence": "", "dates": (DATE, "2018-07-01")})
    report = check_context(stored(dataclasses.replace(content, manifest=silent)))
    assert report.is_good
    assert [warning.path for warning in report.warnings] == ["dates", "licence", "source"]


def test_a_storage_that_does_not_answer_is_a_problem_of_the_check() -> None:
    class Silent(MemoryStorage):
        def read(self, path: str) -> bytes:
            raise StorageUnavailable("the disk is gone")

    assert [str(problem) for problem in check_context(Silent()).problems] == ["the disk is gone"]


def test_a_broken_context_is_not_copied() -> None:
    target = MemoryStorage()
    with pytest.raises(BrokenContext):
        copy_context(with_columns(put("column", 1, 0)), "", target, "default/fleet/contexts/plot")
    assert target.objects == {}


def test_a_copy_is_written_once_and_is_the_same_context() -> None:
    source, target = stored(pictured()), MemoryStorage()
    source.write("unrelated.bin", b"x")
    copy_context(source, "", target, "a/b")
    first = dict(target.objects)
    copy_context(source, "", target, "a/b")
    assert sorted(target.objects) == ["a/b/context.yaml", "a/b/features.parquet", "a/b/pictures.parquet"]
    assert all(target.objects[path] is data for path, data in first.items())
    assert load_context(target, "a/b").environment.digest == load_context(source).environment.digest


def test_a_scale_draws_every_quantity() -> None:
    scale = RenderScale(feature="yield", high=200.0)
    content = dataclasses.replace(
        plot(), manifest=manifest(("yield",), truth="yield", render=scale), cells=cells([(0, 1)], {"yield": [100.0]})
    )
    environment = load_context(stored(content)).environment
    assert environment.truth_name == "exg"
    assert environment.truth is not None
    assert environment.truth[0, 1] == 50.0
    assert np.count_nonzero(environment.grid.valid) == 1
