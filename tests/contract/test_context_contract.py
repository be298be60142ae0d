"""What every context must keep, whatever its kind. A new kind subclasses `ContextContract`."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.base import Context, ContextKind
from fleet.contexts.cube import AutonomyCube
from fleet.contexts.files import write_cube
from fleet.contexts.load import load_context
from fleet.contexts.manifest import RenderScale
from fleet.errors import ContextError
from fleet.storage.local import LocalStorage
from tests.context_builders import MemoryStorage, cells, manifest, pictured, plot

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "crop-scouting" / "contexts"


def some_states(context: Context, valid: bool) -> list[int]:
    states = np.flatnonzero(context.environment.grid.valid.ravel() == valid).tolist()
    return states[:: max(1, len(states) // 20)]


class ContextContract:
    @pytest.fixture
    def context(self) -> Context:
        raise NotImplementedError

    def test_it_has_a_kind_a_name_and_a_digest(self, context: Context) -> None:
        environment = context.environment
        assert isinstance(context.kind, ContextKind)
        assert environment.name
        assert environment.digest

    def test_at_least_one_state_has_data(self, context: Context) -> None:
        assert context.environment.grid.valid.any()

    def test_the_truth_is_known_in_every_state_with_data_or_nowhere(self, context: Context) -> None:
        environment = context.environment
        if environment.truth is None:
            assert environment.truth_name == ""
            return
        assert environment.truth.shape == environment.grid.valid.shape
        assert environment.truth.dtype == np.float64
        assert np.isfinite(environment.truth[environment.grid.valid]).all()
        assert environment.truth_name

    def test_every_state_with_data_gives_media_and_finite_numbers(self, context: Context) -> None:
        for state in some_states(context, valid=True):
            observation = context.observe(state)
            assert observation.state == state
            assert observation.label
            assert observation.media
            for media in observation.media:
                assert media.data
                assert media.type.count("/") == 1
            assert np.isfinite(list(observation.attributes.values())).all()

    def test_observing_twice_gives_the_same(self, context: Context) -> None:
        state = some_states(context, valid=True)[0]
        assert context.observe(state) == context.observe(state)

    def test_a_state_without_data_is_refused_and_named(self, context: Context) -> None:
        for state in some_states(context, valid=False):
            row, column = context.environment.grid.position(state)
            with pytest.raises(ContextError, match=f"row {row}, column {column}"):
                context.observe(state)

    @pytest.mark.parametrize("beyond", [-1, 10**9])
    def test_a_state_that_does_not_exist_is_refused(self, context: Context, beyond: int) -> None:
        with pytest.raises(ContextError):
            context.observe(beyond)

    def test_it_can_be_sent_to_a_worker_process(self, context: Context) -> None:
        copy = pickle.loads(pickle.dumps(context))
        state = some_states(context, valid=True)[-1]
        assert copy.observe(state) == context.observe(state)
        assert copy.environment.digest == context.environment.digest


class TestRenderedCube(ContextContract):
    @pytest.fixture
    def context(self) -> Context:
        return AutonomyCube(plot())


class TestCubeOfAnotherQuantity(ContextContract):
    @pytest.fixture
    def context(self) -> Context:
        scale = RenderScale(feature="yield", high=200.0)
        content = dataclasses.replace(
            plot(),
            manifest=manifest(("yield",), truth="yield", render=scale),
            cells=cells([(0, 0), (2, 3)], {"yield": [120.0, 180.0]}),
        )
        return AutonomyCube(content)


class TestCubeWithStoredPictures(ContextContract):
    @pytest.fixture
    def context(self) -> Context:
        return AutonomyCube(pictured())


class TestCubeWithoutTruth(ContextContract):
    @pytest.fixture
    def context(self) -> Context:
        return AutonomyCube(dataclasses.replace(plot(), manifest=manifest(("exg", "brightness"), truth=None)))


class TestEarlierDateOfACube(ContextContract):
    @pytest.fixture
    def context(self) -> Context:
        measured = cells([(0, 0), (0, 1), (0, 0)], {"exg": [1.0, 2.0, 3.0]}, ["2018-06-01", "2018-06-01", "2018-08-02"])
        content = dataclasses.replace(plot(), manifest=manifest(dates=("2018-06-01", "2018-08-02")), cells=measured)
        return AutonomyCube(content).at("2018-06-01")


class TestCubeLoadedFromStorage(ContextContract):
    @pytest.fixture
    def context(self) -> Context:
        storage = MemoryStorage()
        write_cube(pictured(), storage, "default/fleet/contexts/plot")
        return load_context(storage, "default/fleet/contexts/plot")


@pytest.mark.parametrize("date", ["2018-06-01", "2018-08-02", "2018-09-16"])
class TestExampleCubes(ContextContract):
    @pytest.fixture
    def context(self, date: str) -> Context:
        return load_context(LocalStorage(EXAMPLES / date))
