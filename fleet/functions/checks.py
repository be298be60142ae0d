"""What Map() and Eval() may answer; everything else is refused with a message that says what to mend."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.functions.contract import Evaluation

MAX_FEATURES = 1024
MAX_METRICS = 1024
MAX_NAME = 256
MAX_ARTEFACTS = 64
_SHOWN = 8


class AnswerError(ValueError):
    """A function answered something that is not an SSV or not an evaluation."""


def check_ssv(answer: object, features: tuple[str, ...] | None) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Check what Map() answered.

    Args:
        answer: Should be a mapping from the name of a feature to a finite number.
        features: The features that Map() declares or gave before; None when they are not known yet.
    Returns:
        The features, and the values in their order, float64 [len(features)].
    Raises:
        AnswerError: it is no SSV, or has other features than before.
    """
    if not isinstance(answer, Mapping):
        raise AnswerError(
            f"answered {_kind(answer)} instead of features by name; return a dict such as {{'height': 1.5}}"
        )
    if not answer:
        raise AnswerError("answered no features; return at least one")
    if len(answer) > MAX_FEATURES:
        raise AnswerError(f"answered {len(answer)} features; an SSV has at most {MAX_FEATURES}")
    for name in answer:
        if not isinstance(name, str) or not name:
            raise AnswerError(f"answered a feature whose name is {name!r}; names are texts")
        if len(name) > MAX_NAME:
            raise AnswerError(
                f"answered a feature whose name has {len(name)} characters; a name has at most {MAX_NAME}"
            )
    if features is not None and set(answer) != set(features):
        raise AnswerError(_other_features(features, answer))
    order = features or tuple(answer)
    values = [_number(f"feature {name}", answer[name]) for name in order]
    return order, np.array(values, dtype=np.float64)


def check_evaluation(answer: object, grid: Grid) -> Evaluation:
    """Check what Eval() answered.

    Args:
        answer: Should be an Evaluation, or a tuple (finished, metrics, artefacts) as in the paper.
        grid: Artefacts are on this grid.
    Returns:
        The evaluation, with plain floats and float64 [rows, columns] artefacts.
    Raises:
        AnswerError: it is no evaluation.
    """
    if isinstance(answer, tuple) and len(answer) == 3:
        answer = Evaluation(*answer)
    if not isinstance(answer, Evaluation):
        raise AnswerError(f"answered {_kind(answer)} instead of an Evaluation; return Evaluation(finished, metrics)")
    if not isinstance(answer.finished, bool | np.bool_):
        raise AnswerError(f"answered {_kind(answer.finished)} for `finished`; return True or False")
    metrics, artefacts = answer.metrics, answer.artefacts
    if not isinstance(metrics, Mapping) or not all(isinstance(name, str) for name in metrics):
        raise AnswerError(f"answered {_kind(metrics)} for `metrics`; return a dict from names to numbers")
    if not isinstance(artefacts, Mapping) or not all(isinstance(name, str) for name in artefacts):
        raise AnswerError(f"answered {_kind(artefacts)} for `artefacts`; return a dict from names to grids")
    for count, limit, what in ((len(metrics), MAX_METRICS, "metrics"), (len(artefacts), MAX_ARTEFACTS, "artefacts")):
        if count > limit:
            raise AnswerError(f"answered {count} {what}; an evaluation has at most {limit}")
    return Evaluation(
        bool(answer.finished),
        {name: _number(f"metric {name}", value) for name, value in metrics.items()},
        {name: _artefact(name, value, grid) for name, value in artefacts.items()},
    )


def _number(what: str, value: object) -> float:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool | np.bool_):
        raise AnswerError(f"{what} is {value}, a truth value; return a number (1.0 or 0.0)")
    if not isinstance(value, Real):
        raise AnswerError(f"{what} is {_kind(value)}; return a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise AnswerError(
            f"{what} is {number}; return a finite number, or a neutral value when there is nothing to measure"
        )
    return number


def _artefact(name: str, value: object, grid: Grid) -> NDArray[np.float64]:
    try:
        values = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise AnswerError(f"artefact {name} is not a grid of numbers: {error}") from error
    if values.shape != (grid.rows, grid.columns):
        shape = " x ".join(map(str, values.shape)) or "a single number"
        raise AnswerError(f"artefact {name} is {shape}; return a grid of {grid.rows} rows x {grid.columns} columns")
    if np.isinf(values).any():
        raise AnswerError(f"artefact {name} has infinite values; use NaN where nothing is known")
    return values


def _other_features(features: tuple[str, ...], answer: Mapping[object, object]) -> str:
    missing = [name for name in features if name not in answer]
    new = [str(name) for name in answer if name not in features]
    parts = []
    if missing:
        parts.append(f"without {_some(missing)}")
    if new:
        parts.append(f"with unknown {_some(new)}")
    return (
        f"answered {len(answer)} features instead of {len(features)}: {' and '.join(parts)}; "
        "every SSV of a Map() has the same features"
    )


def _some(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _kind(value: object) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
