"""Map(), Eval() and C of the FleetSpec: the user's functions, and the contexts of earlier missions."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from fleet.spec.base import Duration, FunctionReference, Model, Name, Resources, Uri, distinct


class FunctionSpec(Model):
    """A user function: a Python `module:function` beside the FleetSpec, or a container that serves the contract."""

    function: FunctionReference | None = Field(default=None, description="Python function as `module:function`.")
    image: str | None = Field(
        default=None, description="Container image that serves the HTTP contract.", min_length=1, max_length=512
    )
    command: tuple[Annotated[str, Field(max_length=4096)], ...] = Field(
        default=(), description="Command of the image, when not its own.", max_length=64
    )
    timeout: Duration = Field(default="10s", description="A call that takes longer has failed.")
    retries: int = Field(default=2, description="How often a failed call is tried again.", ge=0, le=20)
    resources: Resources = Field(default=Resources(), description="CPU and memory of the function's container.")


class MapSpec(FunctionSpec):
    """Map(): sensor data to state-space vector."""


class EvalChecks(StrEnum):
    """When Eval() is asked."""

    AT_END = "AtEnd"
    AFTER_GROUP = "AfterGroup"


class EvalSpec(FunctionSpec):
    """Eval(): feature space and metrics to evaluation."""

    checks: EvalChecks = Field(
        default=EvalChecks.AT_END,
        description="AtEnd: Eval() is asked when a mission ends. AfterGroup: an agent asks it also whenever it "
        "leaves a state group, so that `finished` can end its flight early.",
    )

    timeout: Duration = Field(default="60s", description="A call that takes longer has failed.")


class ContextUse(StrEnum):
    """What a context is for: C_t shapes the reward, C_r retrains SA, Mission is flown."""

    SHAPING = "Shaping"
    TRAINING = "Training"
    MISSION = "Mission"


class ContextSpec(Model):
    """One context of C."""

    name: Name = Field(description="Unique within the fleet.", examples=["field-2018-09-16"])
    uri: Uri = Field(
        description="Where the context is: a folder beside the FleetSpec, or a storage address.",
        examples=["contexts/2018-09-16"],
    )
    use: Annotated[tuple[ContextUse, ...], Field(min_length=1, max_length=3)] = Field(
        default=(ContextUse.SHAPING, ContextUse.TRAINING),
        description="What the context is for: Shaping finds reward and thresholds, Training trains SA, "
        "Mission is flown over.",
        json_schema_extra=distinct(),
    )
