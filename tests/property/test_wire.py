"""Everything that goes over the wire comes back the same."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from fleet.contexts.base import Environment, Expectation, Media, Observation
from fleet.contexts.grid import Grid
from fleet.functions import wire
from fleet.functions.contract import AgentMetrics, Evaluation, FeatureSpace, Metrics

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NUMBERS = st.floats(allow_infinity=False)
NAMES = st.text(max_size=12)
OBSERVATIONS = st.builds(
    Observation,
    st.integers(0, 10**6),
    NAMES,
    st.lists(st.builds(Media, NAMES, st.binary(max_size=64)), max_size=3).map(tuple),
    st.dictionaries(NAMES, FINITE, max_size=4),
    st.floats(0, 1e9),
)
COUNTS = st.integers(0, 10**9)
SPENT = st.floats(0, 1e15)  # sums over agents stay finite
AGENTS = st.builds(AgentMetrics, NAMES, COUNTS, COUNTS, SPENT, SPENT, SPENT, COUNTS, COUNTS)


@st.composite
def environments(draw: st.DrawFn) -> Environment:
    shape = draw(hnp.array_shapes(min_dims=2, max_dims=2, max_side=6))
    grid = Grid(
        draw(hnp.arrays(bool, shape)), draw(st.floats(0.1, 99)), draw(st.floats(0.1, 99)), draw(st.booleans()),
        draw(st.booleans()),
    )  # fmt: skip
    truth = draw(st.none() | hnp.arrays(np.float64, shape, elements=NUMBERS))
    maps = hnp.arrays(np.float64, shape, elements=FINITE)
    expected = draw(st.none() | st.builds(Expectation, maps, maps))
    return Environment(draw(NAMES), draw(NAMES), grid, draw(NAMES), truth, expected)


def over_the_wire(message: object) -> dict[str, object]:
    """Through JSON as any language would read it."""
    data = wire.dump(message)
    assert json.loads(data, parse_constant=pytest.fail) == wire.load(data)
    return wire.load(data)


@settings(max_examples=60)
@given(OBSERVATIONS)
def test_observations(observation: Observation) -> None:
    assert wire.decode_observation(over_the_wire(wire.encode_observation(observation))) == observation


@settings(max_examples=60)
@given(environments())
def test_environments(environment: Environment) -> None:
    same_environment(wire.decode_environment(over_the_wire(wire.encode_environment(environment))), environment)


@settings(max_examples=60)
@given(st.data(), environments(), st.lists(NAMES, unique=True, max_size=4), st.lists(AGENTS, max_size=3))
def test_evaluation_requests(
    data: st.DataObject, environment: Environment, features: list[str], agents: list[AgentMetrics]
) -> None:
    cells = sorted(data.draw(st.sets(st.integers(0, environment.grid.cells - 1))))
    ssv = data.draw(hnp.arrays(np.float64, (len(cells), len(features)), elements=FINITE))
    fs = FeatureSpace(tuple(features), np.array(cells, dtype=np.int64), ssv, environment)
    metrics = Metrics(tuple(agents))
    found, found_metrics = wire.decode_evaluation_request(over_the_wire(wire.encode_evaluation_request(fs, metrics)))
    assert (found.features, found.states.tolist(), found_metrics) == (fs.features, cells, metrics)
    np.testing.assert_array_equal(found.ssv, ssv)
    same_environment(found.environment, environment)


@settings(max_examples=60)
@given(
    st.booleans(),
    st.dictionaries(NAMES, FINITE, max_size=4),
    st.dictionaries(NAMES, hnp.arrays(np.float64, (2, 3), elements=NUMBERS), max_size=3),
)
def test_evaluations(finished: bool, metrics: dict[str, float], artefacts: dict[str, np.ndarray]) -> None:
    found = wire.decode_evaluation(over_the_wire(wire.encode_evaluation(Evaluation(finished, metrics, artefacts))))
    assert (found.finished, found.metrics, list(found.artefacts)) == (finished, metrics, list(artefacts))
    for name, values in artefacts.items():
        np.testing.assert_array_equal(found.artefacts[name], values)


JSON = st.recursive(
    st.none() | st.booleans() | FINITE | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
FIELDS = st.sampled_from(
    ["state", "label", "media", "attributes", "timeS", "grid", "featureSpace", "metrics", "agents"]
)


@settings(max_examples=150)
@given(st.dictionaries(FIELDS, JSON | st.dictionaries(FIELDS, JSON, max_size=3), max_size=5))
def test_any_object_is_decoded_or_refused_with_a_wire_error(message: dict[str, object]) -> None:
    for decode in (wire.decode_observation, wire.decode_environment, wire.decode_evaluation_request):
        try:
            decode(message)
        except wire.WireError as error:
            assert str(error)  # noqa: PT017  # either outcome is right


@given(st.binary(max_size=40))
def test_any_body_is_read_or_refused_with_a_wire_error(body: bytes) -> None:
    try:
        assert isinstance(wire.load(body), dict)
    except wire.WireError as error:
        assert str(error)  # noqa: PT017  # either outcome is right


def same_environment(found: Environment, wanted: Environment) -> None:
    first, second = asdict(found), asdict(wanted)
    for part in (first, second):
        part["valid"] = part["grid"].pop("valid")
    maps = [(part.pop("truth"), *(part.pop("expected") or {"": None, "-": None}).values()) for part in (first, second)]
    np.testing.assert_array_equal(first.pop("valid"), second.pop("valid"))
    assert first == second
    for one, other in zip(*maps, strict=True):
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("values", "deviation"), [([1.0, np.nan], [0.0, 0.0]), ([1.0, 2.0], [0.0, np.nan])])
def test_an_expectation_with_a_hole_is_refused(values: list[float], deviation: list[float]) -> None:
    expected = Expectation(np.array([values]), np.array([deviation]))
    place = Environment("field", "d", Grid(np.ones((1, 2), dtype=np.bool_)), expected=expected)
    with pytest.raises(wire.WireError, match="a cell with data has no number"):
        wire.decode_environment(over_the_wire(wire.encode_environment(place)))


def test_an_expectation_without_its_certainty_is_refused() -> None:
    place = Environment("field", "d", Grid(np.ones((1, 2), dtype=np.bool_)))
    message = over_the_wire(wire.encode_environment(place)) | {"expected": [[1.0, 2.0]]}
    with pytest.raises(wire.WireError, match="expectedDeviation: is missing"):
        wire.decode_environment(message)
