"""Map() as a composition of extractors (paper, figure "Map and Eval function pseudocode for crop scouting")."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import TypeVar

from fleet.contexts.base import Observation
from fleet.functions.contract import SSV, Extractor

_DECLARED = "__fleet_features__"
F = TypeVar("F", bound=Callable[[Observation], SSV])


@dataclass(frozen=True)
class Feature:
    """One feature of an SSV, as an extractor declares it.

    Args:
        name: Name of the feature; unique within a Map().
        units: Unit of the value; "1" for a share or an index.
        low, high: Smallest and largest possible value.
    """

    name: str
    units: str = "1"
    low: float = -inf
    high: float = inf


class ExtractorError(Exception):
    """An extractor failed inside a composed Map(); the cause is in `__cause__`.

    Args:
        extractor: Name of the extractor.
        message: What went wrong.
        kind: Type name of the exception that was raised in the extractor.
    """

    def __init__(self, extractor: str, message: str, kind: str) -> None:
        self.extractor = extractor
        self.message = message
        self.kind = kind
        super().__init__(f"extractor {extractor}: {kind}: {message}")


def extractor(*features: Feature | str) -> Callable[[F], F]:
    """Declare the features of an extractor, or of a whole Map(), so that they are known before the first call.

    Args:
        features: In the order in which the function answers them; a text is a feature without unit and range.
    """
    if not features:
        raise ValueError("an extractor declares at least one feature: @extractor('height')")
    known = tuple(Feature(feature) if isinstance(feature, str) else feature for feature in features)
    _no_duplicates([feature.name for feature in known])

    def declare(function: F) -> F:
        setattr(function, _DECLARED, known)
        return function

    return declare


def declared(function: object) -> tuple[Feature, ...] | None:
    """The features that an extractor or a Map() declares; None when it declares none."""
    if isinstance(function, ComposedMap):
        return function.declared
    features: tuple[Feature, ...] | None = getattr(function, _DECLARED, None)
    return features


class ComposedMap:
    """A Map() that asks one extractor after the other; made by `compose`.

    Attributes:
        extractors: The parts, in order.
        declared: Features of all parts, in order; None when a part declares none.
    """

    def __init__(self, extractors: tuple[Extractor, ...]) -> None:
        self.extractors = extractors
        self._parts = tuple((_name(part), part, _declared_names(part)) for part in extractors)
        found: list[Feature] = []
        for part in extractors:
            found += declared(part) or ()
        _no_duplicates([feature.name for feature in found])
        self.declared = tuple(found) if all(names is not None for _, _, names in self._parts) else None

    def __call__(self, observation: Observation) -> SSV:
        """SSV of an observation. Raises ExtractorError, which names the extractor that failed."""
        ssv: SSV = {}
        for name, part, names in self._parts:
            answer = _call(name, part, observation)
            _check_names(name, answer, names, ssv)
            ssv.update(answer)
        return ssv

    def __repr__(self) -> str:
        return f"compose({', '.join(name for name, _, _ in self._parts)})"


def compose(*extractors: Extractor) -> ComposedMap:
    """Compose extractors to a Map(); the SSV has their features in the order of the extractors.

    Raises:
        ValueError: there is no extractor, or two of them declare the same feature.
    """
    if not extractors:
        raise ValueError("compose needs at least one extractor: compose(excess_green, brightness)")
    return ComposedMap(extractors)


def _call(name: str, part: Extractor, observation: Observation) -> SSV:
    try:
        return part(observation)
    except ExtractorError:  # a composition within a composition has named its extractor already
        raise
    except Exception as error:
        raise ExtractorError(name, str(error), type(error).__name__) from error


def _check_names(name: str, answer: object, names: tuple[str, ...] | None, before: SSV) -> None:
    if not isinstance(answer, dict):
        raise ExtractorError(
            name, f"answered {type(answer).__name__}; return a dict of features, such as {{'height': 1.5}}", "TypeError"
        )
    if names is not None and set(answer) != set(names):
        raise ExtractorError(
            name, f"answered {_list(answer)} but declares {_list(names)}; make both the same", "ValueError"
        )
    again = [feature for feature in answer if feature in before]
    if again:
        raise ExtractorError(
            name, f"answered {_list(again)}, which an earlier extractor answers too; rename it", "ValueError"
        )


def _declared_names(part: Extractor) -> tuple[str, ...] | None:
    features = declared(part)
    return None if features is None else tuple(feature.name for feature in features)


def _name(part: Extractor) -> str:
    return str(getattr(part, "__name__", None) or repr(part))


def _no_duplicates(names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"feature {_list(twice)} is declared more than once; every feature has its own name")


def _list(names: object) -> str:
    return ", ".join(map(str, names)) if isinstance(names, list | tuple | dict) and names else "nothing"
