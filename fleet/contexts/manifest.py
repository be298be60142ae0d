"""context.yaml: what a context on disk says of itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from fleet.contexts.base import ContextKind
from fleet.errors import ContextError, Problem
from fleet.plain_yaml import NotPlain, load_plain
from fleet.spec.base import Identifier, Model, Name

MANIFEST = "context.yaml"
CONTEXT_API_VERSION: Literal["context.fleetcomputer.io/v1alpha1"] = "context.fleetcomputer.io/v1alpha1"
FULL_SCALE_EXG = 100.0
"""Excess green that the high end of a render scale is drawn with."""
_SHOWN = 100
"""Problems that a message shows."""
KEYS = ("row", "column", "date")
"""Columns of features.parquet that say which cell and date a row is about."""

Date = Annotated[str, Field(pattern=r"^[0-9]{4}(-[0-9]{2}(-[0-9]{2})?)?$")]
_Size = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=1, le=4096)]


class PictureKind(StrEnum):
    """Where the pictures of a context come from."""

    STORED = "Stored"
    RENDERED = "Rendered"


class GridSpec(Model):
    """The grid of an autonomy cube, in rows and columns of its source."""

    rows: _Count = Field(description="Number of rows.")
    columns: _Count = Field(description="Number of columns.")
    cell_height_m: _Size = Field(description="Size of a cell along a column, in m.")
    cell_width_m: _Size = Field(description="Size of a cell along a row, in m.")
    rows_go_south: bool = Field(default=True, description="Whether the row number grows to the south.")
    columns_go_east: bool = Field(default=True, description="Whether the column number grows to the east.")


class FeatureSpec(Model):
    """One measured quantity: a column of features.parquet."""

    name: Identifier = Field(description="Name of the column.")
    unit: str = Field(default="", description="Unit; `1` for a share or an index.")
    description: str = Field(default="", description="What was measured.")
    attribute: bool = Field(
        default=False, description="Whether the sensor gives it beside the picture, as lat and lon."
    )


class RenderScale(Model):
    """How a quantity becomes the excess green of a rendered picture: 0 at `low`, 100 at `high`, linear between."""

    feature: Identifier = Field(description="The feature that pictures show.")
    low: float = Field(default=0.0, description="Value drawn with excess green 0.", allow_inf_nan=False)
    high: float = Field(description="Value drawn with excess green 100.", allow_inf_nan=False)

    @model_validator(mode="after")
    def _ends_differ(self) -> RenderScale:
        if self.high == self.low:
            raise ValueError("low and high must differ")
        return self

    @property
    def exg_per_unit(self) -> float:
        """Excess green of one unit of the quantity."""
        return FULL_SCALE_EXG / (self.high - self.low)


class CubeManifest(Model):
    """context.yaml of an autonomy cube."""

    api_version: Literal["context.fleetcomputer.io/v1alpha1"] = CONTEXT_API_VERSION
    kind: Literal["AutonomyCube"] = "AutonomyCube"
    name: Name = Field(description="Name of the context.")
    description: str = Field(default="", description="What the context is, for people.")
    source: str = Field(default="", description="Where the data comes from.")
    licence: str = Field(default="", description="Licence of the data.")
    dates: tuple[Date, ...] = Field(description="When it was observed: years, months or days.", min_length=1)
    grid: GridSpec = Field(description="The grid.")
    truth: Identifier | None = Field(default=None, description="The feature that missions map, when one is known.")
    features: tuple[FeatureSpec, ...] = Field(default=(), description="Columns of features.parquet.")
    pictures: PictureKind = Field(
        default=PictureKind.RENDERED, description="Stored: in pictures.parquet. Rendered: drawn from the features."
    )
    render: RenderScale | None = Field(
        default=None, description="How pictures show a quantity other than excess green; without it they show `exg`."
    )

    @model_validator(mode="after")
    def _names_fit(self) -> CubeManifest:
        names = [feature.name for feature in self.features]
        for name, times in Counter([*KEYS, *names]).items():
            if times > 1:
                raise ValueError(f"features: {name!r} is a key column, or listed twice; give it another name")
        shown = self.render.feature if self.render is not None else None
        for path, wanted in (("truth", self.truth), ("render.feature", shown)):
            if wanted is not None and wanted not in names:
                raise ValueError(f"{path}: there is no feature {wanted!r}; list it under features")
        if len(set(self.dates)) != len(self.dates):
            raise ValueError("dates: a date is listed twice")
        return self

    @property
    def feature_names(self) -> tuple[str, ...]:
        """Names of all features, in order."""
        return tuple(feature.name for feature in self.features)

    @property
    def pictured(self) -> str | None:
        """The feature that rendered pictures show; None when nothing can be rendered."""
        if self.render is not None:
            return self.render.feature
        return "exg" if "exg" in self.feature_names else None


class BrokenContext(ContextError):
    """A context, or what should become one, is not a good one; `problems` has everything that is wrong with it."""

    def __init__(self, where: str, problems: Sequence[Problem], verdict: str = "is not a good context") -> None:
        self.where = where
        self.problems = tuple(problems)
        lines = [f"  {problem}" for problem in self.problems[:_SHOWN]]
        if len(self.problems) > _SHOWN:
            lines.append(f"  and {len(self.problems) - _SHOWN} more of this kind")
        super().__init__("\n".join([f"{where} {verdict}:", *lines]))


def kind_of(data: bytes, where: str) -> ContextKind:
    """The kind of context that a context.yaml declares.

    Raises:
        BrokenContext: it is not a context.yaml.
    """
    document = _document(data, where)
    kind = document.get("kind")
    try:
        return ContextKind(str(kind))
    except ValueError as error:
        hint = "write kind: AutonomyCube"
        message = "is missing" if kind is None else f"there is no kind of context {kind!r}"
        raise BrokenContext(where, [Problem("kind", message, hint)]) from error


def parse_manifest(data: bytes, where: str) -> CubeManifest:
    """Read the context.yaml of an autonomy cube.

    Raises:
        BrokenContext: it is not valid; has every problem at once.
    """
    try:
        return CubeManifest.model_validate(_document(data, where))
    except ValidationError as error:
        raise BrokenContext(where, problems_of(error)) from error


def manifest_text(manifest: CubeManifest) -> bytes:
    """A manifest as the text of context.yaml; the same manifest always gives the same bytes."""
    document = manifest.model_dump(mode="json", by_alias=True, exclude_none=True)
    text: str = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=110, default_flow_style=None)
    return text.encode()


def _document(data: bytes, where: str) -> dict[str, Any]:
    try:
        document = load_plain(data)
    except NotPlain as error:
        raise BrokenContext(where, [Problem(MANIFEST, str(error))]) from error
    if not isinstance(document, dict):
        hint = "write fields such as kind: AutonomyCube"
        raise BrokenContext(where, [Problem(MANIFEST, "is not a mapping", hint)])
    # YAML reads 2018-06-01 as a date and 2001 as a number; both are dates as text here.
    if isinstance(document.get("dates"), list):
        document["dates"] = [str(date) for date in document["dates"]]
    return document


def problems_of(error: ValidationError) -> list[Problem]:
    """What a manifest's model found, in words for the user."""
    return [_problem(detail) for detail in error.errors()]


def _problem(detail: Any) -> Problem:
    path = ".".join(str(part) for part in detail["loc"])
    match detail["type"]:
        case "missing":
            return Problem(path, "is missing", "see docs/contexts.md for the format")
        case "extra_forbidden":
            return Problem(path, "is not a field of context.yaml", "remove it, or correct its name")
        case "literal_error" if path == "apiVersion":
            return Problem(path, f"is {detail['input']!r}", f"this version reads {CONTEXT_API_VERSION}")
        case "string_pattern_mismatch" if path == "name":
            hint = "use small letters, digits and -, such as field-2018-06-01"
            return Problem(path, f"is {detail['input']!r}", hint)
        case "value_error":
            return Problem(path, detail["msg"].removeprefix("Value error, "))
        case _:
            return Problem(path, f"{detail['msg'][:1].lower()}{detail['msg'][1:]}, not {_short(detail['input'])}")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
