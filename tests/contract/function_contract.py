"""What every Map() and Eval() must do, wherever it runs and in whatever language it is written.

The Map() under test gives the features `bytes` (length of the first medium) and `state`; it raises when the attribute
`fail` is 1. The Eval() under test gives the metric `captured` (number of SSVs) and `time_s`, the artefact `twice`
(twice the truth) and is finished when every agent has explored all its groups.
"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from fleet.contexts.base import Environment, Media, Observation
from fleet.contexts.grid import Grid
from fleet.errors import FunctionError
from fleet.functions.contract import AgentMetrics, EvalClient, FeatureSpace, MapClient, Metrics


def observation(state: int = 5, size: int = 7, fail: float = 0.0) -> Observation:
    media = (Media("application/octet-stream", bytes(range(size))),)
    return Observation(state, f"cell {state}", media, {"fail": fail, "lat": 39.6}, 12.5)


def feature_space() -> FeatureSpace:
    valid = np.array([[True, True, False], [True, True, True]])
    truth = np.where(valid, np.arange(6.0).reshape(2, 3), np.nan)
    states = np.array([0, 3, 5], dtype=np.int64)
    ssv = np.array([[0.5, 1.0], [-2.0, 1e300], [0.1, 3.0]])
    return FeatureSpace(("a", "b"), states, ssv, Environment("field", "d1", Grid(valid, 11.9, 8.9), "exg", truth))


class MapContract:
    """Tests of a MapClient; a subclass gives the fixture `client`, made for one retry."""

    def test_gives_the_features_in_order_as_finite_numbers(self, client: MapClient) -> None:
        ssv = client.map(observation(state=5, size=7), "agent-1")
        assert (client.features, ssv.tolist(), ssv.dtype) == (("bytes", "state"), [7.0, 5.0], np.float64)

    def test_gives_the_same_answer_for_the_same_observation(self, client: MapClient) -> None:
        assert client.map(observation()).tolist() == client.map(observation()).tolist()

    def test_takes_media_of_a_megabyte(self, client: MapClient) -> None:
        big = Observation(1, "cell 1", (Media("image/png", bytes(2**20)),), {"fail": 0.0})
        assert client.map(big).tolist() == [2.0**20, 1.0]

    def test_has_a_version_that_stays(self, client: MapClient) -> None:
        assert client.version
        assert client.version == client.version

    def test_survives_pickling(self, client: MapClient) -> None:
        client.map(observation())
        again: MapClient = pickle.loads(pickle.dumps(client))
        assert again.map(observation(state=9, size=2)).tolist() == [2.0, 9.0]

    def test_an_exception_names_function_agent_and_state_and_the_next_call_works(self, client: MapClient) -> None:
        with pytest.raises(FunctionError) as caught:
            client.map(observation(state=3, fail=1.0), "agent-2")
        assert (caught.value.site.agent, caught.value.site.state) == ("agent-2", "cell 3")
        assert "raised ValueError" in str(caught.value)
        assert "told to fail" in str(caught.value)
        assert str(caught.value).endswith("(2 attempts)")
        assert client.map(observation(state=4, size=1)).tolist() == [1.0, 4.0]


class EvalContract:
    """Tests of an EvalClient; a subclass gives the fixture `client`."""

    def test_evaluates_a_feature_space(self, client: EvalClient) -> None:
        metrics = Metrics(
            (AgentMetrics("agent-1", 4, 3, 60.5, 100.0, 5.0, 2, 2), AgentMetrics("agent-2", time_s=71.25))
        )
        evaluation = client.evaluate(feature_space(), metrics)
        assert (evaluation.finished, dict(evaluation.metrics)) == (True, {"captured": 3.0, "time_s": 71.25})
        expected = [[0.0, 2.0, np.nan], [6.0, 8.0, 10.0]]
        np.testing.assert_array_equal(evaluation.artefacts["twice"], expected)

    def test_evaluates_a_mission_without_captured_states(self, client: EvalClient) -> None:
        whole = feature_space()
        empty = FeatureSpace(whole.features, whole.states[:0], whole.ssv[:0], whole.environment)
        evaluation = client.evaluate(empty, Metrics((AgentMetrics("agent-1", groups=1),)))
        assert (evaluation.finished, dict(evaluation.metrics)) == (False, {"captured": 0.0, "time_s": 0.0})
