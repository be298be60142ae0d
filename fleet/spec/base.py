"""Building blocks of every resource: the model base, names, quantities, durations, addresses."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, JsonValue
from pydantic.alias_generators import to_camel

GROUP = "fleetcomputer.io"
VERSION = "v1alpha1"
API_VERSION: Literal["fleetcomputer.io/v1alpha1"] = "fleetcomputer.io/v1alpha1"


POWERSET_LIMIT = 8
"""Agents up to which every subset has a model: 255 models."""
ABSOLUTE_LIMIT = 4
"""Agents up to which usefulness is absolute by default."""
MAX_SEED = 2**53 - 1
"""The largest whole number that every JSON reader keeps exactly."""

Schema = dict[str, JsonValue]
"""A part of a JSON schema."""


class Model(BaseModel):
    """A part of a resource: immutable, camelCase outside, no unknown fields, and no NaN."""

    model_config = ConfigDict(
        alias_generator=to_camel,
        populate_by_name=True,
        extra="forbid",
        frozen=True,
        use_enum_values=False,
        allow_inf_nan=False,
    )


def named_list(key: str = "name") -> Schema:
    """What a schema says of a list of objects of which no two have the same `key`."""
    return {"x-kubernetes-list-type": "map", "x-kubernetes-list-map-keys": [key]}


def distinct() -> Schema:
    """What a schema says of a list without repeated values."""
    return {"x-kubernetes-list-type": "set"}


_SUFFIX: dict[str, Decimal] = {
    "m": Decimal("0.001"), "": Decimal(1), "k": Decimal(10) ** 3, "M": Decimal(10) ** 6, "G": Decimal(10) ** 9,
    "T": Decimal(10) ** 12, "Ki": Decimal(2) ** 10, "Mi": Decimal(2) ** 20, "Gi": Decimal(2) ** 30,
    "Ti": Decimal(2) ** 40,
}  # fmt: skip
QUANTITY_PATTERN = r"^[0-9]+(\.[0-9]+)?(m|k|M|G|T|Ki|Mi|Gi|Ti)?$"
DURATION_PATTERN = r"^([0-9]+(\.[0-9]+)?(ms|s|m|h))+$"
NAME_PATTERN = r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$"
NODE_PATTERN = r"^[a-z0-9]([-.a-z0-9]*[a-z0-9])?$"
FUNCTION_PATTERN = r"^[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*:[A-Za-z_][A-Za-z0-9_]*$"
METRIC_PATTERN = r"^[a-z][a-z0-9_]*$"
_SECONDS = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0}


def quantity_value(text: str) -> float:
    """The number that a Kubernetes quantity means: `500m` is 0.5, `256Mi` is 268435456."""
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)([A-Za-z]*)", text)
    if match is None or match[2] not in _SUFFIX:
        raise ValueError(f'"{text}" is not a quantity; write it as Kubernetes does: 500m, 2, 256Mi, 1Gi')
    return float(Decimal(match[1]) * _SUFFIX[match[2]])


def duration_s(text: str) -> float:
    """The seconds that a duration means: `90s` is 90, `1h30m` is 5400."""
    if re.fullmatch(DURATION_PATTERN, text) is None:
        raise ValueError(f'"{text}" is not a duration; write it as Kubernetes does: 500ms, 90s, 5m, 1h30m')
    return sum(float(number) * _SECONDS[unit] for number, unit in re.findall(r"([0-9.]+)(ms|s|m|h)", text))


def _as_text(value: Any) -> Any:
    """YAML reads `cpu: 2` as a number; a quantity is a text. Kubernetes takes whole numbers only."""
    if isinstance(value, float):
        hint = f'{value} is a number with a fraction; write it as a text: "{value}"'
        raise ValueError(hint)  # noqa: TRY004 - pydantic reports a ValueError; a TypeError would end validation
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _check_quantity(text: str) -> str:
    quantity_value(text)
    return text


def _check_duration(text: str) -> str:
    duration_s(text)
    return text


Quantity = Annotated[
    str,
    BeforeValidator(_as_text),
    AfterValidator(_check_quantity),
    Field(max_length=32, json_schema_extra={"x-kubernetes-int-or-string": True, "pattern": QUANTITY_PATTERN}),
]
Duration = Annotated[
    str, AfterValidator(_check_duration), Field(max_length=32, json_schema_extra={"pattern": DURATION_PATTERN})
]
Name = Annotated[str, Field(pattern=NAME_PATTERN, min_length=1, max_length=40)]
NodeName = Annotated[str, Field(pattern=NODE_PATTERN, min_length=1, max_length=253)]
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", min_length=1, max_length=63)]
FunctionReference = Annotated[str, Field(pattern=FUNCTION_PATTERN, max_length=253)]
MetricName = Annotated[str, Field(pattern=METRIC_PATTERN, min_length=1, max_length=63)]
ProfileReference = Annotated[str, Field(min_length=1, max_length=253)]
Uri = Annotated[str, Field(min_length=1, max_length=1024)]
Seed = Annotated[int, Field(ge=0, le=MAX_SEED)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class Amounts(Model):
    """CPU and memory, as Kubernetes writes them."""

    cpu: Quantity | None = Field(default=None, description="CPU cores: `500m` is half a core.")
    memory: Quantity | None = Field(default=None, description="Memory: `256Mi`.")


class Resources(Model):
    """What a container asks for, and what it may use at most (Kubernetes' own meaning)."""

    requests: Amounts = Field(default=Amounts(), description="What the scheduler keeps free for the container.")
    limits: Amounts = Field(default=Amounts(), description="What the container may use at most.")


class Metadata(BaseModel):
    """The part of Kubernetes' ObjectMeta that the library reads; the rest is kept as it is."""

    model_config = ConfigDict(alias_generator=to_camel, populate_by_name=True, extra="allow", frozen=True)

    name: Name
    namespace: str = "default"
    labels: dict[str, str] = {}
    annotations: dict[str, str] = {}
    uid: str = ""
    generation: int = 0


class MissionMetadata(Metadata):
    """Metadata of a Mission: its name is longer than that of its fleet."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, min_length=1, max_length=63)]


class NodeMetadata(Metadata):
    """Metadata of an EdgeNode: named like the node, which may be a host name with dots."""

    name: NodeName


class Condition(Model):
    """A condition as Kubernetes' conventions have it."""

    type: str = Field(description="What the condition is about, in CamelCase.", min_length=1, max_length=63)
    status: str = Field(description="`True`, `False` or `Unknown`.", pattern="^(True|False|Unknown)$")
    reason: str = Field(default="", description="One CamelCase word that a program can match.", max_length=1024)
    message: str = Field(default="", description="A sentence for people.", max_length=32768)
    observed_generation: int = Field(default=0, description="The metadata.generation that this condition speaks of.")
    last_transition_time: str = Field(default="", description="When the status last changed, RFC 3339.", max_length=64)


Conditions = Annotated[tuple[Condition, ...], Field(max_length=32, json_schema_extra=named_list("type"))]
