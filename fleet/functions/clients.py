"""Map() and Eval() for those who call them: in this process, or behind the HTTP contract; every answer is checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fleet.clock import Clock, SystemClock
from fleet.contexts.base import Observation
from fleet.errors import CallSite, FunctionError
from fleet.functions import wire
from fleet.functions.calls import CallError, Failure, attempt, call_with_timeout
from fleet.functions.checks import check_evaluation, check_ssv
from fleet.functions.compose import declared
from fleet.functions.contract import EvalClient, Evaluation, FeatureSpace, MapClient, Metrics
from fleet.functions.resolve import resolve, version_of
from fleet.spec.base import duration_s
from fleet.spec.functions import EvalSpec, FunctionSpec, MapSpec


def open_map(spec: MapSpec, url: str | None = None) -> MapClient:
    """Map() of a FleetSpec: behind an address, or in this process when there is none.

    The client can be pickled. In this process, a call that hangs is given up after the timeout but goes on in a
    daemon thread until the process ends; a call that ends the process ends the caller too.

    Raises:
        FunctionError: the function cannot be imported, or is a container and there is no address.
    """
    reference, retries = _reference(spec, url), spec.retries
    if url is None:
        local = _LocalFunction(reference, duration_s(spec.timeout))
        local.load()
        return _Map(reference, _LocalMap(local), retries)
    return _Map(reference, _RemoteMap(_RemoteFunction("Map", url, duration_s(spec.timeout))), retries)


def open_eval(spec: EvalSpec, url: str | None = None) -> EvalClient:
    """Eval() of a FleetSpec: behind an address, or in this process when there is none; see `open_map`.

    Raises:
        FunctionError: the function cannot be imported, or is a container and there is no address.
    """
    reference, retries = _reference(spec, url), spec.retries
    if url is None:
        local = _LocalFunction(reference, duration_s(spec.timeout))
        local.load()
        return _Eval(reference, _LocalEval(local), retries)
    return _Eval(reference, _RemoteEval(_RemoteFunction("Eval", url, duration_s(spec.timeout))), retries)


def _reference(spec: FunctionSpec, url: str | None) -> str:
    if url is None and spec.function is None:
        raise FunctionError(
            "is a container and cannot run in this process; give the address of its server",
            CallSite(spec.image or "a function without name"),
        )
    return spec.function or spec.image or url or ""


class _MapBackend(Protocol):
    """Where a Map() runs. Every method raises CallError or FunctionError."""

    def features(self) -> tuple[str, ...] | None: ...

    def version(self) -> str: ...

    def answer(self, observation: Observation) -> object: ...


class _EvalBackend(Protocol):
    """Where an Eval() runs. Every method raises CallError or FunctionError."""

    def version(self) -> str: ...

    def answer(self, fs: FeatureSpace, metrics: Metrics) -> object: ...


class _LocalFunction:
    """A Python function, imported once in each process; a pickle carries its reference only."""

    def __init__(self, reference: str, timeout_s: float) -> None:
        self.reference = reference
        self.timeout_s = timeout_s
        self._function: Callable[..., Any] | None = None

    def __reduce__(self) -> tuple[type[_LocalFunction], tuple[str, float]]:
        return _LocalFunction, (self.reference, self.timeout_s)

    def load(self) -> Callable[..., Any]:
        if self._function is None:
            self._function = resolve(self.reference)
        return self._function

    def call(self, *arguments: Any) -> object:
        return call_with_timeout(self.load(), arguments, self.timeout_s)


class _LocalMap:
    def __init__(self, function: _LocalFunction) -> None:
        self._function = function

    def features(self) -> tuple[str, ...] | None:
        known = declared(self._function.load())
        return None if known is None else tuple(feature.name for feature in known)

    def version(self) -> str:
        return version_of(self._function.load())

    def answer(self, observation: Observation) -> object:
        return self._function.call(observation)


class _LocalEval:
    def __init__(self, function: _LocalFunction) -> None:
        self._function = function

    def version(self) -> str:
        return version_of(self._function.load())

    def answer(self, fs: FeatureSpace, metrics: Metrics) -> object:
        return self._function.call(fs, metrics)


class _RemoteFunction:
    """A function behind an address; the connection is opened once in each process."""

    def __init__(self, kind: str, url: str, timeout_s: float) -> None:
        # httpx must not load in a process that calls its functions directly.
        from fleet.functions.http_client import HttpFunction  # noqa: PLC0415

        self._arguments = (kind, url, timeout_s)
        self._http = HttpFunction(url, timeout_s)
        self._description: dict[str, Any] | None = None

    def __reduce__(self) -> tuple[type[_RemoteFunction], tuple[str, str, float]]:
        return _RemoteFunction, self._arguments

    def describe(self) -> dict[str, Any]:
        if self._description is None:
            kind, url, _ = self._arguments
            found = self._http.describe()
            if found.get("kind") != kind:
                raise CallError(
                    Failure(
                        f"the server at {url} serves {found.get('kind')!r} instead of {kind!r}; correct the address",
                        passing=False,
                    )
                )
            self._description = found
        return self._description

    def post(self, path: str, message: dict[str, Any], limit_bytes: int) -> dict[str, Any]:
        return self._http.post(path, message, limit_bytes)


class _RemoteMap:
    def __init__(self, function: _RemoteFunction) -> None:
        self._function = function

    def features(self) -> tuple[str, ...] | None:
        names = self._function.describe().get("features")
        return tuple(map(str, names)) if isinstance(names, list) and names else None

    def version(self) -> str:
        return str(self._function.describe().get("version", ""))

    def answer(self, observation: Observation) -> object:
        message = wire.encode_observation(observation)
        answer = self._function.post("/map", message, wire.MAX_SSV_BYTES)
        if "ssv" not in answer:
            raise CallError(Failure('the answer of /map has no "ssv"; answer {"ssv": {"name": number}}'))
        return answer["ssv"]


class _RemoteEval:
    def __init__(self, function: _RemoteFunction) -> None:
        self._function = function

    def version(self) -> str:
        return str(self._function.describe().get("version", ""))

    def answer(self, fs: FeatureSpace, metrics: Metrics) -> object:
        message = wire.encode_evaluation_request(fs, metrics)
        answer = self._function.post("/eval", message, wire.MAX_EVALUATION_BYTES)
        try:
            return wire.decode_evaluation(answer)
        except wire.WireError as error:
            raise CallError(Failure(f"the answer of /eval {error}; answer as docs/functions.md says")) from error


class _Map:
    """MapClient over either backend."""

    def __init__(self, reference: str, backend: _MapBackend, retries: int, clock: Clock | None = None) -> None:
        self._reference = reference
        self._backend = backend
        self._retries = retries
        self._clock = clock or SystemClock()
        self._features: tuple[str, ...] | None = None

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the SSV's features. Raises FunctionError when they are neither declared nor seen yet."""
        site = CallSite(self._reference)
        features = self._features or attempt(self._backend.features, self._retries, site, self._clock)
        if features is None:
            raise FunctionError(
                "its features are known only after its first answer; declare them with @extractor('name', ...)", site
            )
        self._features = features
        return features

    @property
    def version(self) -> str:
        """Changes when Map() may give another SSV for the same observation."""
        return attempt(self._backend.version, self._retries, CallSite(self._reference), self._clock)

    def map(self, observation: Observation, agent: str = "") -> NDArray[np.float64]:
        """SSV of an observation, float64 [len(features)], finite."""
        site = CallSite(self._reference, agent, observation.label or str(observation.state))

        def call() -> NDArray[np.float64]:
            known = self._features or self._backend.features()
            self._features, values = check_ssv(self._backend.answer(observation), known)
            return values

        return attempt(call, self._retries, site, self._clock)


class _Eval:
    """EvalClient over either backend."""

    def __init__(self, reference: str, backend: _EvalBackend, retries: int, clock: Clock | None = None) -> None:
        self._reference = reference
        self._backend = backend
        self._retries = retries
        self._clock = clock or SystemClock()

    @property
    def version(self) -> str:
        """Changes when Eval() may say something else of the same mission."""
        return attempt(self._backend.version, self._retries, CallSite(self._reference), self._clock)

    def evaluate(self, fs: FeatureSpace, metrics: Metrics, agent: str = "") -> Evaluation:
        """Evaluate a mission, or one agent's part of it."""

        def call() -> Evaluation:
            return check_evaluation(self._backend.answer(fs, metrics), fs.environment.grid)

        return attempt(call, self._retries, CallSite(self._reference, agent), self._clock)
