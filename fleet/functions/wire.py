"""JSON of the HTTP contract: observations, SSVs, feature spaces, metrics, evaluations. See docs/functions.md.

Names are camelCase, as in the FleetSpec. A number that is not known (NaN) is null.
"""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment, Expectation, Media, Observation
from fleet.contexts.grid import Grid
from fleet.errors import ContextError
from fleet.functions.contract import AgentMetrics, Evaluation, FeatureSpace, Metrics

MAX_REQUEST_BYTES = 64 * 2**20
MAX_SSV_BYTES = 2**20
MAX_EVALUATION_BYTES = 64 * 2**20


class WireError(ValueError):
    """A message is not what the contract says; the text names the field."""


def dump(message: object) -> bytes:
    """JSON of a message. Raises WireError when it has NaN or an infinity, which JSON does not have."""
    try:
        return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
    except ValueError as error:
        raise WireError(f"cannot be written as JSON: {error}") from error


def load(data: bytes) -> dict[str, Any]:
    """The message in a body. Raises WireError when it is not a JSON object."""
    try:
        message = json.loads(data)
    except ValueError as error:
        raise WireError(f"is not JSON: {error}") from error
    except RecursionError as error:
        raise WireError("is nested too deeply") from error
    if not isinstance(message, dict):
        raise WireError(f"is a JSON {_json_type(message)} instead of an object")
    return message


def encode_observation(observation: Observation) -> dict[str, Any]:
    """Body of POST /map."""
    return {
        "state": observation.state,
        "label": observation.label,
        "timeS": observation.time_s,
        "attributes": dict(observation.attributes),
        "media": [
            {"type": media.type, "data": base64.b64encode(media.data).decode("ascii")} for media in observation.media
        ],
    }


def decode_observation(message: Mapping[str, Any]) -> Observation:
    """An observation from the body of POST /map. Raises WireError."""
    attributes = _field(message, "attributes", dict, {})
    return Observation(
        state=int(_field(message, "state", int)),
        label=str(_field(message, "label", str, "")),
        media=tuple(_media(part) for part in _field(message, "media", list, [])),
        attributes={str(name): float(_as("attributes", value, (int, float))) for name, value in attributes.items()},
        time_s=float(_field(message, "timeS", (int, float), 0.0)),
    )


def encode_environment(environment: Environment) -> dict[str, Any]:
    """An environment: name, digest, grid with `valid` as rows of truth values, truth as rows of numbers or null; and
    what is expected of the cells likewise, where anything is."""
    grid = environment.grid
    message = {
        "name": environment.name,
        "digest": environment.digest,
        "grid": {
            "rows": grid.rows,
            "columns": grid.columns,
            "valid": grid.valid.tolist(),
            "cellHeightM": grid.cell_height_m,
            "cellWidthM": grid.cell_width_m,
            "rowsGoSouth": grid.rows_go_south,
            "columnsGoEast": grid.columns_go_east,
        },
        "truthName": environment.truth_name,
        "truth": None if environment.truth is None else encode_numbers(environment.truth),
    }
    if environment.expected is not None:
        message["expected"] = encode_numbers(environment.expected.values)
        message["expectedDeviation"] = encode_numbers(environment.expected.deviation)
    return message


def decode_environment(message: Mapping[str, Any]) -> Environment:
    """The environment of `encode_environment`. Raises WireError."""
    encoded = _field(message, "grid", dict)
    try:
        valid = np.asarray(_field(encoded, "valid", list), dtype=np.bool_)
        grid = Grid(
            valid,
            float(_field(encoded, "cellHeightM", (int, float), 1.0)),
            float(_field(encoded, "cellWidthM", (int, float), 1.0)),
            bool(_field(encoded, "rowsGoSouth", bool, True)),
            bool(_field(encoded, "columnsGoEast", bool, True)),
        )
    except (ValueError, ContextError) as error:
        raise WireError(f"grid: {error}") from error
    truth, expected, deviation = (
        None if message.get(name) is None else decode_numbers(name, message[name], (grid.rows, grid.columns))
        for name in ("truth", "expected", "expectedDeviation")
    )
    return Environment(
        name=str(_field(message, "name", str, "")),
        digest=str(_field(message, "digest", str, "")),
        grid=grid,
        truth_name=str(_field(message, "truthName", str, "")),
        truth=truth,
        expected=None if expected is None else _expectation(expected, deviation, grid),
    )


def _expectation(values: NDArray[np.float64], deviation: NDArray[np.float64] | None, grid: Grid) -> Expectation:
    if deviation is None:
        raise WireError("expectedDeviation: is missing beside expected")
    for name, given in (("expected", values), ("expectedDeviation", deviation)):
        if not np.isfinite(given[grid.valid]).all():
            raise WireError(f"{name}: a cell with data has no number")
    return Expectation(values, deviation)


def encode_evaluation_request(fs: FeatureSpace, metrics: Metrics) -> dict[str, Any]:
    """Body of POST /eval."""
    return {
        "featureSpace": {
            "features": list(fs.features),
            "states": fs.states.tolist(),
            "ssv": encode_numbers(fs.ssv),
            "environment": encode_environment(fs.environment),
        },
        "metrics": {
            "agents": [_encode_agent(agent) for agent in metrics.agents],
            "timeS": metrics.time_s,
            "uavEnergyJ": metrics.uav_energy_j,
            "edgeEnergyJ": metrics.edge_energy_j,
            "explored": metrics.explored,
        },
    }


def decode_evaluation_request(message: Mapping[str, Any]) -> tuple[FeatureSpace, Metrics]:
    """Feature space and metrics from the body of POST /eval. Raises WireError."""
    encoded = _field(message, "featureSpace", dict)
    features = tuple(str(name) for name in _field(encoded, "features", list))
    environment = decode_environment(_field(encoded, "environment", dict))
    try:
        states = np.asarray(_field(encoded, "states", list), dtype=np.int64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise WireError(f"states: {error}") from error
    if len(states) and not (states.min() >= 0 and states.max() < environment.grid.cells):
        raise WireError(f"states: outside of the grid's {environment.grid.cells} cells")
    ssv = decode_numbers("ssv", _field(encoded, "ssv", list), (len(states), len(features)))
    agents = _field(_field(message, "metrics", dict), "agents", list)
    return FeatureSpace(features, states, ssv, environment), Metrics(tuple(_decode_agent(agent) for agent in agents))


def encode_evaluation(evaluation: Evaluation) -> dict[str, Any]:
    """Answer of POST /eval."""
    return {
        "finished": evaluation.finished,
        "metrics": dict(evaluation.metrics),
        "artefacts": {name: encode_numbers(values) for name, values in evaluation.artefacts.items()},
    }


def decode_evaluation(message: Mapping[str, Any]) -> Evaluation:
    """An evaluation from the answer of POST /eval, for `check_evaluation` to check further. Raises WireError."""
    if "finished" not in message or "metrics" not in message:
        raise WireError('has no "finished" and "metrics"; the answer is {"finished": ..., "metrics": {...}}')
    artefacts = _field(message, "artefacts", dict, {})
    return Evaluation(
        finished=message["finished"],
        metrics=message["metrics"],
        artefacts={str(name): decode_numbers(f"artefact {name}", values) for name, values in artefacts.items()},
    )


def encode_numbers(values: NDArray[np.float64]) -> list[Any]:
    """Nested lists of an array of numbers, with null for NaN."""
    values = np.asarray(values, dtype=np.float64)
    missing = np.isnan(values)
    if not missing.any():
        return list(values.tolist())
    known = values.astype(object)
    known[missing] = None
    return list(known.tolist())


def decode_numbers(name: str, values: object, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """Numbers of nested lists, with NaN for null. Raises WireError, also when the shape is not the one given."""
    try:
        array = np.asarray(values, dtype=np.float64)  # None becomes NaN
    except (TypeError, ValueError) as error:
        raise WireError(f"{name}: is not rows of numbers or null") from error
    if shape is not None and array.size == 0 and 0 in shape:
        return np.zeros(shape)
    if shape is not None and array.shape != shape:
        raise WireError(f"{name}: has shape {array.shape} instead of {shape}")
    return array


def _media(message: object) -> Media:
    if not isinstance(message, dict):
        raise WireError('media: each is {"type": ..., "data": base64}')
    try:
        data = base64.b64decode(_field(message, "data", str), validate=True)
    except (binascii.Error, ValueError) as error:
        raise WireError(f"media: data is not base64: {error}") from error
    return Media(str(_field(message, "type", str)), data)


def _encode_agent(agent: AgentMetrics) -> dict[str, Any]:
    return {
        "agent": agent.agent,
        "steps": agent.steps,
        "captures": agent.captures,
        "timeS": agent.time_s,
        "uavEnergyJ": agent.uav_energy_j,
        "edgeEnergyJ": agent.edge_energy_j,
        "groups": agent.groups,
        "groupsExplored": agent.groups_explored,
    }


def _decode_agent(message: object) -> AgentMetrics:
    if not isinstance(message, dict):
        raise WireError("agents: each is an object")
    return AgentMetrics(
        agent=str(_field(message, "agent", str)),
        steps=int(_field(message, "steps", int, 0)),
        captures=int(_field(message, "captures", int, 0)),
        time_s=float(_field(message, "timeS", (int, float), 0.0)),
        uav_energy_j=float(_field(message, "uavEnergyJ", (int, float), 0.0)),
        edge_energy_j=float(_field(message, "edgeEnergyJ", (int, float), 0.0)),
        groups=int(_field(message, "groups", int, 0)),
        groups_explored=int(_field(message, "groupsExplored", int, 0)),
    )


_REQUIRED = object()


def _field(message: Mapping[str, Any], name: str, kind: type | tuple[type, ...], default: Any = _REQUIRED) -> Any:
    value = message.get(name, default)
    if value is _REQUIRED:
        raise WireError(f"{name}: is missing")
    return _as(name, value, kind)


def _as(name: str, value: Any, kind: type | tuple[type, ...]) -> Any:
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise WireError(f"{name}: is a JSON {_json_type(value)}")
    return value


def _json_type(value: object) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "truth value"
        case int() | float():
            return "number"
        case str():
            return "text"
        case list():
            return "list"
        case _:
            return "object"
