"""Map() runs once for each state of a context, and its answers are found again by content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fleet.contexts.base import ContextKind, Environment, Observation
from fleet.contexts.grid import Grid
from fleet.functions.clients import open_map
from fleet.simulator.terrain import survey
from fleet.spec.functions import MapSpec
from fleet.storage.local import LocalStorage

PATH = "default/fleet/mapped/a.npz"
VALID = np.array([[True, False, True], [True, True, False]])
EXPECTED = np.array([[0.0, 0.5], [np.nan] * 2, [2.0, 2.5], [3.0, 3.5], [4.0, 4.5], [np.nan] * 2])


@dataclass(frozen=True)
class Numbered:
    """A context whose observations are the numbers of its states."""

    digest: str = "d1"
    kind: ContextKind = ContextKind.AUTONOMY_CUBE

    @property
    def environment(self) -> Environment:
        return Environment("field", self.digest, Grid(VALID))

    def observe(self, state: int) -> Observation:
        return Observation(state, f"state {state}", attributes={"number": float(state)})


@dataclass
class Counting:
    """Map() that keeps what it was asked."""

    features: tuple[str, ...] = ("a", "b")
    version: str = "v1"
    asked: list[int] = field(default_factory=list)

    def map(self, observation: Observation, agent: str = "") -> NDArray[np.float64]:
        self.asked.append(observation.state)
        return np.array([observation.attributes["number"], observation.attributes["number"] + 0.5])


@pytest.fixture
def storage(tmp_path: Path) -> LocalStorage:
    return LocalStorage(tmp_path)


def test_maps_each_state_with_data_once_and_tells_progress() -> None:
    mapper, told = Counting(), []
    ssv = survey(Numbered(), mapper, progress=lambda done, of: told.append((done, of)))
    np.testing.assert_array_equal(ssv, EXPECTED)
    assert mapper.asked == [0, 2, 3, 4]
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_the_second_survey_of_the_same_content_asks_nothing(storage: LocalStorage) -> None:
    survey(Numbered(), Counting(), storage, PATH)
    again = Counting()
    np.testing.assert_array_equal(survey(Numbered(), again, storage, PATH), EXPECTED)
    assert again.asked == []


@pytest.mark.parametrize(
    ("context", "mapper"),
    [
        (Numbered(digest="d2"), Counting()),
        (Numbered(), Counting(version="v2")),
        (Numbered(), Counting(features=("a", "c"))),
    ],
)
def test_other_content_is_mapped_anew(storage: LocalStorage, context: Numbered, mapper: Counting) -> None:
    survey(Numbered(), Counting(), storage, PATH)
    survey(context, mapper, storage, PATH)
    assert mapper.asked == [0, 2, 3, 4]
    survey(context, mapper, storage, PATH)
    assert mapper.asked == [0, 2, 3, 4]


def test_a_map_that_declares_no_features_is_known_by_its_first_answer(
    storage: LocalStorage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plain_map.py").write_text("def plain(observation):\n    return {'a': observation.state, 'b': 1.0}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    ssv = survey(Numbered(), open_map(MapSpec(function="plain_map:plain")), storage, PATH)
    assert ssv[[0, 2, 3, 4]].tolist() == [[0.0, 1.0], [2.0, 1.0], [3.0, 1.0], [4.0, 1.0]]


def broken(data: bytes) -> Sequence[bytes]:
    torn = [data[:length] for length in range(0, len(data), 7)]
    flipped = [data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :] for at in range(0, len(data), 3)]
    return [*torn, *flipped, b"not a zip"]


def test_a_corrupt_cache_is_made_anew(storage: LocalStorage) -> None:
    survey(Numbered(), Counting(), storage, PATH)
    for data in broken(storage.read(PATH)):
        storage.write(PATH, data)
        np.testing.assert_array_equal(survey(Numbered(), Counting(), storage, PATH), EXPECTED)
