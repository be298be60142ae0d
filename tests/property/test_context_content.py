"""Cubes on disk: what goes in comes out, the digest knows every change, damage never crashes."""

from __future__ import annotations

import contextlib
import dataclasses
import random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.contexts.base import Media
from fleet.contexts.cells import Cells, CubeContent, Pictures, examine
from fleet.contexts.check import check_context, correlation_length_m
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.files import read_cube, write_cube
from fleet.contexts.importing import ImportOptions, import_table
from fleet.contexts.manifest import BrokenContext, PictureKind, manifest_text, parse_manifest
from tests.context_builders import DATE, MemoryStorage, manifest, pictured, plot

DATES = (DATE, "2018-08-02")
number = st.floats(-300, 300, width=32)
positions = st.lists(
    st.tuples(st.sampled_from(DATES), st.integers(0, 3), st.integers(0, 4)), min_size=1, max_size=20, unique=True
)


@st.composite
def contents(draw: st.DrawFn) -> CubeContent:
    where = draw(positions)
    count = len(where)
    features = {
        "exg": draw(st.lists(number, min_size=count, max_size=count)),
        "lai": draw(st.lists(number | st.just(float("nan")), min_size=count, max_size=count)),
    }
    keys = (
        np.array([row for _, row, _ in where], dtype=np.int64),
        np.array([column for _, _, column in where], dtype=np.int64),
        np.array([date for date, _, _ in where], dtype=np.str_),
    )
    values = {name: np.array(numbers, dtype=np.float64) for name, numbers in features.items()}
    blobs = draw(st.none() | st.lists(st.binary(min_size=1, max_size=9), min_size=count, max_size=count))
    pictures = None if blobs is None else Pictures(*keys, tuple(Media("image/png", blob) for blob in blobs))
    kind = PictureKind.RENDERED if pictures is None else PictureKind.STORED
    return CubeContent(
        manifest(("exg", "lai"), rows=4, columns=5, dates=DATES, pictures=kind), Cells(*keys, values), pictures
    )


def shuffled(content: CubeContent, seed: int) -> CubeContent:
    """The same content with its entries in another order."""
    order = np.random.default_rng(seed).permutation(len(content.cells))
    cells = content.cells
    features = {name: values[order] for name, values in reversed(list(cells.features.items()))}
    moved = Cells(cells.rows[order], cells.columns[order], cells.dates[order], features)
    return dataclasses.replace(content, cells=moved)


@settings(max_examples=60)
@given(contents())
def test_a_written_cube_is_read_back(content: CubeContent) -> None:
    storage = MemoryStorage()
    write_cube(content, storage, "folder")
    found, unread = read_cube(storage, "folder")
    assert unread == ()
    assert found.manifest == content.manifest
    assert found.digest() == content.digest()
    assert examine(found) == examine(content)


@settings(max_examples=60)
@given(contents(), st.integers(0, 100))
def test_the_digest_does_not_depend_on_the_order_of_entries(content: CubeContent, seed: int) -> None:
    assert shuffled(content, seed).digest() == content.digest()


@settings(max_examples=100)
@given(contents(), st.data())
def test_the_digest_changes_with_any_content(content: CubeContent, data: st.DataObject) -> None:
    index = data.draw(st.integers(0, len(content.cells) - 1))
    change = data.draw(st.sampled_from(["exg", "lai", "row", "date", "name", "picture", "entry"]))
    assert changed(content, change, index).digest() != content.digest()


def changed(content: CubeContent, change: str, index: int) -> CubeContent:
    cells = content.cells
    if change in cells.features:
        values = cells.features[change].copy()
        values[index] = 1.0 if np.isnan(values[index]) else values[index] + 1.0
        return dataclasses.replace(
            content, cells=dataclasses.replace(cells, features={**cells.features, change: values})
        )
    if change == "row":
        rows = cells.rows.copy()
        rows[index] += 4
        return dataclasses.replace(content, cells=dataclasses.replace(cells, rows=rows))
    if change == "date":
        dates = cells.dates.copy()
        dates[index] = "2019-01-01"
        return dataclasses.replace(content, cells=dataclasses.replace(cells, dates=dates))
    if change == "picture" and content.pictures is not None:
        media = list(content.pictures.media)
        media[index] = Media(media[index].type, media[index].data + b"x")
        return dataclasses.replace(content, pictures=dataclasses.replace(content.pictures, media=tuple(media)))
    if change == "entry":
        features = {name: np.delete(values, index) for name, values in cells.features.items()}
        left = Cells(*(np.delete(keys, index) for keys in (cells.rows, cells.columns, cells.dates)), features)  # type: ignore[arg-type]  # numpy's delete keeps the type
        return dataclasses.replace(content, cells=left)
    return dataclasses.replace(content, manifest=content.manifest.model_copy(update={"name": "other"}))


def test_each_date_of_a_cube_has_a_digest_of_its_own() -> None:
    content = dataclasses.replace(plot(), manifest=manifest(("exg", "brightness"), dates=DATES))
    dates = content.cells.dates.copy()
    dates[0] = DATES[1]
    cube = AutonomyCube(dataclasses.replace(content, cells=dataclasses.replace(content.cells, dates=dates)))
    assert cube.date == DATES[1]
    assert cube.environment.digest != cube.at(DATES[0]).environment.digest


@settings(max_examples=60)
@given(contents())
def test_a_manifest_is_read_back(content: CubeContent) -> None:
    assert parse_manifest(manifest_text(content.manifest), "here") == content.manifest


@settings(max_examples=200)
@given(st.integers(0, 2**32), st.sampled_from(["context.yaml", "features.parquet", "pictures.parquet"]))
def test_a_damaged_file_never_crashes_the_check(seed: int, name: str) -> None:
    storage = MemoryStorage()
    write_cube(pictured(), storage)
    draw = random.Random(seed)
    data = bytearray(storage.objects[name])
    for _ in range(draw.randint(1, 4)):
        data[draw.randrange(len(data))] = draw.randrange(256)
    storage.objects[name] = bytes(data[: draw.choice([len(data), draw.randrange(len(data))])])
    report = check_context(storage)
    assert report.is_good == bool(report.statistics)


lines = st.lists(
    st.tuples(
        st.integers(0, 3), st.integers(0, 3), st.floats(-100, 100).map(lambda value: round(value, 3)) | st.none()
    ),
    min_size=1,
    max_size=30,
    unique=True,
).filter(lambda found: any(value is not None for _, _, value in found))


@settings(max_examples=100)
@given(lines)
def test_an_import_averages_what_is_known_of_each_cell(found: list[tuple[int, int, float | None]]) -> None:
    text = "row,col,exg\n" + "".join(f"{row},{col},{'' if value is None else value}\n" for row, col, value in found)
    options = ImportOptions("plot", DATE, rows=4, columns=4, cell_height_m=1.0, cell_width_m=1.0)
    imported = AutonomyCube(import_table(text, options).content).values("exg")
    for row in range(4):
        for column in range(4):
            known = [value for r, c, value in found if (r, c) == (row, column) and value is not None]
            expected = sum(known) / len(known) if known else float("nan")
            np.testing.assert_allclose(imported[row, column], expected, atol=1e-9)


@settings(max_examples=200)
@given(st.text(alphabet='row,col exg\n\t;"0123456789.-naN', max_size=80))
def test_no_text_crashes_an_import(text: str) -> None:
    options = ImportOptions("plot", DATE, cell_height_m=1.0, cell_width_m=1.0)
    for head in ("", "row,col,exg\n", "row col exg\n"):
        with contextlib.suppress(BrokenContext):
            import_table(head + text, options)


def test_correlation_length_is_that_of_the_map() -> None:
    rows, columns = np.meshgrid(np.arange(60), np.arange(60), indexing="ij")
    waves = np.sin(2 * np.pi * rows / 40) + np.sin(2 * np.pi * columns / 40)
    quarter = correlation_length_m(waves, 1.0, 1.0)
    assert quarter is not None
    assert 11 < quarter < 13  # (1 + cos(2 pi d / 40)) / 2 is 1/e at 11.7 cells
    noise = np.random.default_rng(0).normal(size=(60, 60))
    nearest = correlation_length_m(noise, 10.0, 10.0)
    assert nearest is not None
    assert nearest < 10.0
    assert correlation_length_m(np.ones((5, 5)), 1.0, 1.0) is None
