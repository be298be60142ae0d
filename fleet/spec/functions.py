"""Map(), Eval() and C of the FleetSpec: the user's functions, and the contexts of earlier missions."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from fleet.spec.base import Duration, FunctionReference, Model, Name, Resources, Uri


class FunctionSpec(Model):
    """A user function: a Python `module:function` beside the FleetSpec, or a container that serves the contract."""

    function: FunctionReference | None = Field(None, description="Python function as `module:function`.")
    image: str | None = Field(None, description="Container image that serves the HTTP contract.", min_length=1)
    command: tuple[str, ...] = Field((), description="Command of the image, when not its own.")
    timeout: Duration = Field("10s", description="A call that takes longer has failed.")
    retries: int = Field(2, description="How often a failed call is tried again.", ge=0, le=20)
    resources: Resources = Field(Resources(), description="CPU and memory of the function's container.")


class MapSpec(FunctionSpec):
    """Map(): sensor data to state-space vector."""


class EvalSpec(FunctionSpec):
    """Eval(): feature space and metrics to evaluation."""

    timeout: Duration = Field("60s", description="A call that takes longer has failed.")


class ContextUse(StrEnum):
    """What a context is for: C_t shapes the reward, C_r retrains SA, Mission is flown."""

    SHAPING = "Shaping"
    TRAINING = "Training"
    MISSION = "Mission"


class ContextSpec(Model):
    """One context of C."""

    name: Name = Field(description="Unique within the fleet.")
    uri: Uri = Field(description="Where the context is: a folder beside the FleetSpec, or a storage address.")
    use: Annotated[tuple[ContextUse, ...], Field(min_length=1)] = Field(
        (ContextUse.SHAPING, ContextUse.TRAINING), description="What the context is for."
    )
