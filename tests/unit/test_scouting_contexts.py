"""What a planned swarm is told beforehand changes its flight, and is never of the field that is flown."""

from __future__ import annotations

import json
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest

from bench.scouting.campaign import known
from bench.scouting.contexts import (
    EQUAL,
    Study,
    by_gains,
    by_search,
    document,
    own_mean,
    own_variogram,
    table,
    tactics_of,
    variogram_of_others,
)
from bench.scouting.fields import NOISE, PLANTED
from bench.scouting.flight import thorough_j
from bench.scouting.gains import FEATURES, Gains, gains, learned, missions
from bench.scouting.informed import (
    ENERGIES,
    HOWS,
    NOTHING,
    InformedBelief,
    Mission,
    Prior,
    accuracy,
    scouted,
    variogram_of,
)
from fleet.functions.belief import Belief
from fleet.planning.interest import FEW

STUDY = Study(("a", "b", "c"), 2, range(3), tactics_of([(1.0, 0.3), (0.0, 0.0)]))


def _belief(prior: Prior, captured: int) -> InformedBelief:
    place = known(PLANTED, 0)
    belief = InformedBelief(place, prior)
    cells = np.random.default_rng(1).choice(place.cells, captured, replace=False)
    belief.observe(cells, place.truth[cells])
    return belief


def test_a_prior_that_does_not_fade_is_kept_and_the_variance_is_that_of_the_captures() -> None:
    place, told = known(PLANTED, 0), Prior(25.0, 0.4, math.inf)
    belief, without = _belief(told, 200), Belief(place.grid)
    cells = np.flatnonzero(belief.known)
    without.observe(cells, place.truth[cells])
    assert (belief.variogram.length, belief.variogram.nugget) == (25.0, 0.4)
    assert belief.variogram.variance == without.variogram.variance
    assert not np.array_equal(belief.prediction().values, without.prediction().values)


@pytest.mark.parametrize("captured", [50, 150, 450])
def test_a_prior_of_50_captures_fades_as_captures_come_in(captured: int) -> None:
    place, belief = known(PLANTED, 0), _belief(Prior(1.0, 0.9, 50.0), captured)
    without = Belief(place.grid)
    without.observe(np.flatnonzero(belief.known), place.truth[np.flatnonzero(belief.known)])
    share = 50.0 / (50.0 + captured)
    assert belief.variogram.nugget == pytest.approx(share * 0.9 + (1.0 - share) * without.variogram.nugget)
    assert belief.variogram.length == pytest.approx(without.variogram.length ** (1.0 - share))


def test_a_known_mean_is_what_classes_refer_to() -> None:
    assert _belief(Prior(mean=77.0), 3).class_mean == 77.0
    assert _belief(Prior(), 3).class_mean != 77.0


def test_a_mission_is_flown_a_little_farther_than_it_is_compared() -> None:
    place = known(PLANTED, 0)
    flights = scouted(Mission(PLANTED, 3, 0))
    share = sum(flight.total_j for flight in flights) / thorough_j(place, 3)
    assert ENERGIES[-1] < share < ENERGIES[-1] + 0.06


def test_accuracy_is_that_of_the_map_and_depends_on_what_the_swarm_is_told() -> None:
    mission = Mission(PLANTED, 3, 0)
    plain = accuracy(mission)
    assert plain.shape == (len(HOWS), len(ENERGIES))
    assert np.all((plain > 0.5) & (plain <= 1.0))
    assert not np.array_equal(plain, accuracy(replace(mission, tactics=EQUAL)))
    assert not np.array_equal(plain, accuracy(replace(mission, prior=own_mean(PLANTED)[1])))


def test_coefficients_of_gains_are_found_and_none_is_negative() -> None:
    features = np.random.default_rng(0).random((4000, len(FEATURES)))
    gain = features @ np.array([2.0, 1.0, -3.0]) + np.random.default_rng(1).normal(0.0, 0.5, 4000) + 0.0
    found = learned([Gains(features[:2000], gain[:2000]), Gains(features[2000:], gain[2000:])])
    assert found.doubt == 1.0
    assert found.novelty == 0.0
    only = learned([Gains(features, features @ np.array([2.0, 1.0, 0.5]))])
    assert (only.doubt_around, only.novelty) == pytest.approx((0.5, 0.25))


def test_features_that_say_nothing_are_an_error() -> None:
    with pytest.raises(ValueError, match="nothing that is known"):
        learned([Gains(np.ones((5, len(FEATURES))), -np.ones(5))])


def test_on_the_planted_field_a_capture_brings_the_more_the_greater_the_doubt() -> None:
    found = gains(Mission(PLANTED, 3, 0))
    assert len(found.gain) == len(found.features) > 100
    assert found.gain.mean() > 0.0
    doubt = found.features[:, FEATURES.index("doubt")]
    assert np.corrcoef(doubt, found.gain)[0, 1] > 0.05


def test_flights_that_are_learned_from_begin_when_classes_mean_something() -> None:
    found = gains(Mission(NOISE, 2, 0))
    captures = sum(int(flight.captured.sum()) for flight in scouted(Mission(NOISE, 2, 0)))
    assert len(found.gain) <= captures - FEW


def test_what_is_told_about_a_field_is_learned_on_the_others() -> None:
    assert STUDY.others("b") == ["a", "c"]
    rows = np.eye(len(FEATURES))
    lessons = {name: [Gains(rows, rows[index])] for index, name in enumerate(STUDY.fields)}
    told = by_gains(STUDY, lessons)
    for index, name in enumerate(STUDY.fields):
        weights = told(name)[0].weights.model_dump()
        assert [weights[feature] > 0.01 for feature in FEATURES] == [other != index for other in range(len(FEATURES))]


def test_the_best_tactics_are_searched_on_the_fields_that_are_asked_for() -> None:
    shape = (3, 3, len(HOWS), len(ENERGIES))
    first, second = np.zeros(shape), np.zeros(shape)
    first[0], second[1:] = 1.0, 0.4
    others, own = by_search(STUDY, [first, second], STUDY.others), by_search(STUDY, [first, second], lambda n: [n])
    assert others[:, 0, 0, 0].tolist() == [0.0, 0.0, 0.0]
    assert own[:, 0, 0, 0].tolist() == [1.0, 0.4, 0.4]


def test_the_variogram_of_the_others_is_between_theirs_and_bounds_are_the_own() -> None:
    study = replace(STUDY, fields=(PLANTED, NOISE))
    prior = variogram_of_others(study)(PLANTED)[1]
    assert (prior.length, prior.nugget) == pytest.approx(
        (variogram_of(NOISE).length, variogram_of(NOISE).nugget), rel=1e-9
    )
    tactics, bound = own_variogram(PLANTED)
    assert tactics == NOTHING
    assert (bound.length, bound.captures) == (variogram_of(PLANTED).length, math.inf)
    assert bound.mean == pytest.approx(float(known(PLANTED, 0).truth.mean()))


def test_missions_that_are_learned_from_are_flown_in_more_than_one_way() -> None:
    found = missions(("a", "b"), 2, (7, 8))
    assert len(found) == 8
    assert len({mission.tactics.model_dump_json() for mission in found}) == 2


def test_a_study_flies_every_field_with_every_seed_and_prints_and_writes_its_result() -> None:
    study = replace(STUDY, fields=(PLANTED,), seeds=range(1), searched=(NOTHING,))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        base = study.accuracy(pool, lambda _: (NOTHING, Prior()))
    assert base.shape == (1, 1, len(HOWS), len(ENERGIES))
    found = {"default": base, "better": base + 0.01}
    assert table(study, found, 0).row_count == 1
    written = json.loads(json.dumps(document(study, found)))
    assert [run["points"] for run in written["runs"]] == pytest.approx([0.0, 0.0, 1.0, 1.0])
