"""Why an agent that plans made each of its moves: explained from the logs, held against a plain reckoning."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.energy.model import energy_model
from fleet.errors import MissionError
from fleet.functions.belief import Belief
from fleet.learning.planner import PlannerModel, load_planner
from fleet.missions.documents import MissionOrder, ModelReference
from fleet.missions.flight import LAND
from fleet.missions.layout import MOVES
from fleet.planning.interest import FEW, features
from fleet.planning.scouting import Ending, Scout, Scouting
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.report import telling_scout
from fleet.report.explain import open_log
from fleet.report.explain_scout import ScoutExplanation
from fleet.spec.learning import BELIEVED
from fleet.storage.local import LocalStorage
from tests.flown_missions import PATHS as GROUPED
from tests.flown_missions import fly_missions
from tests.flown_missions import settings_of as grouped_settings_of
from tests.planned_flights import FEATURES, PATHS, REWARD, fly, log_of, prepared, put, settings_of, spec_of
from tests.planning import Values, drawn, environment

TRUTH = drawn(2, 10, 12)
AGENTS = ("agent-1", "agent-2")
GIVEN = {
    "initial": InterestWeights(doubt=1.0, doubt_around=0.5, novelty=0.2),
    "1": InterestWeights(doubt=0.2, doubt_around=0.0, novelty=1.0),
    "2": InterestWeights(doubt=3.0, doubt_around=1.0, novelty=0.0),
}
INTERESTS = {key: PlannerModel.blank(FEATURES, weights).interest for key, weights in GIVEN.items()}
WEIGHTS = {
    "agent-1": {"initial": 0.25, "1": 0.75, "2": 0.0},
    "agent-2": {"initial": 0.5, "1": 0.2, "2": 0.3},
}


def flown(folder: Path) -> LocalStorage:
    """A mission of two agents, each in a thread of its own, with weights of their own over three models."""
    storage = prepared(folder, 2, TRUTH)
    references = tuple(ModelReference(key=key, path=f"{PATHS.root}/models/{key}.npz") for key in INTERESTS)
    for reference in references:
        model = PlannerModel.blank(FEATURES, GIVEN[reference.key])
        storage.write(reference.path, model.to_bytes())
    put(storage, PATHS.plan(1), MissionOrder(number=1, context="field", seed=5, models=references, weights=WEIGHTS))
    fly(storage)
    return storage


@pytest.fixture(scope="module")
def storage(tmp_path_factory: pytest.TempPathFactory) -> LocalStorage:
    return flown(tmp_path_factory.mktemp("explained"))


def steps_of(storage: LocalStorage, agent: str, step: int | None = None) -> tuple[ScoutExplanation, ...]:
    return open_log(settings_of(storage, agent)).explain_scout(step)


def relived(storage: LocalStorage, agent: str, step: ScoutExplanation) -> Scouting:
    """What the agent knew at a look: the captures of both in the order of time, without a mind."""
    me = AGENTS.index(agent)
    captures = []
    for index, name in enumerate(AGENTS):
        count = step.record.step + 1 if index == me else step.record.heard[index]
        captures += [(one.time_s, index, one.cell) for one in log_of(storage, name)[:count] if one.captured]
    grid = environment(TRUTH).grid
    scouts = [Scout(log_of(storage, name)[0].cell) for name in AGENTS]
    scouts[me].cell = step.record.cell
    scouting = Scouting(Belief(grid), energy_model(spec_of(2).spec), scouts, Tactics(), REWARD.of_planner.rule)
    for _, _, cell in sorted(captures):
        scouting.take_in(cell, float(TRUTH.flat[cell]))
    return scouting


def by_hand(weights: InterestWeights, believed: Values) -> float:
    return float(sum(getattr(weights, name) * believed[index] for index, name in enumerate(BELIEVED)))


@pytest.mark.parametrize("agent", AGENTS)
def test_each_state_is_explained_by_the_decision_that_was_made_there(storage: LocalStorage, agent: str) -> None:
    records, steps = log_of(storage, agent), steps_of(storage, agent)
    assert [step.record for step in steps] == list(records)
    assert (records[-1].move, steps[-1].ending is None) == (LAND, False)
    assert all(step.ending is None for step in steps[:-1])
    other = AGENTS[1 - AGENTS.index(agent)]
    for step, following in pairwise(steps):
        if following.claim is None:  # the plan goes on: its first move is what is flown next
            assert following.record.move == step.record.plan[0]
            assert following.record.plan == step.record.plan[1:]
    for step in steps:
        record = step.record
        assert (step.claim is None) == (record.heard == ()) == (record.claimed is None)
        assert bool(step.ahead) == (step.claim is not None and step.ending is None)
        assert step.weights == {key: weight for key, weight in WEIGHTS[agent].items() if weight}
        assert step.ssv == (dict(zip(FEATURES, record.ssv, strict=True)) if record.captured else {})
        if step.claim is not None:
            assert (step.claim.accuracy, step.claim.predictions) == (record.claimed, record.predictions)
            assert step.claim.time_s == record.time_s
            assert step.heard == {other: record.heard[AGENTS.index(other)]}


@pytest.mark.parametrize("agent", AGENTS)
def test_what_is_told_of_the_cells_ahead_is_what_was_believed_and_made_of_it(storage: LocalStorage, agent: str) -> None:
    grid, looks = environment(TRUTH).grid, 0
    for step in steps_of(storage, agent):
        if not step.ahead:
            continue
        belief = relived(storage, agent, step).belief
        assert step.claim is not None
        assert belief.captured == step.claim.captured
        assert step.record.move in step.ahead
        for move, found in step.ahead.items():
            assert found.cell == grid.neighbour(step.record.cell, MOVES[move])
            assert found.is_open == bool(belief.free.flat[found.cell])
            assert set(found.scores) == set(step.weights)
            total = sum(step.weights[key] * found.scores[key] for key in step.weights)
            assert found.blended == pytest.approx(total, abs=1e-12)
            if belief.captured < FEW:
                assert found.believed == ()
                continue
            looks += 1
            believed = features(belief).reshape(len(BELIEVED), -1)[:, found.cell]
            assert found.believed == pytest.approx(believed.tolist(), abs=1e-12)
            for key, score in found.scores.items():
                assert score == pytest.approx(by_hand(INTERESTS[key], believed) * found.is_open, abs=1e-12)
    assert looks > 5


@pytest.mark.parametrize("agent", AGENTS)
def test_the_interests_are_those_of_the_models_in_storage(storage: LocalStorage, agent: str) -> None:
    step = steps_of(storage, agent, 0)[0]
    for key in step.weights:
        model = load_planner(storage.read(f"{PATHS.root}/models/{key}.npz"))
        assert step.interests[key] == model.interest == INTERESTS[key]
    for name in BELIEVED:
        mean = sum(weight * getattr(INTERESTS[key], name) for key, weight in WEIGHTS[agent].items())
        assert getattr(step.blended, name) == pytest.approx(mean)


def test_the_first_plan_is_the_path_that_is_worth_most_from_the_take_off(storage: LocalStorage) -> None:
    """Nobody has said anything by then: the other agent is where it takes off."""
    (step,) = steps_of(storage, "agent-1", 0)
    assert step.record.heard == (0, 0)
    scouting = relived(storage, "agent-1", step)
    scouting.scouts[0].weights = step.blended
    assert (step.record.move, *step.record.plan) == tuple(scouting.choose_path(scouting.scouts[0]))


def test_what_is_needed_to_land_is_the_rule_and_agents_land_by_it(storage: LocalStorage) -> None:
    rule, endings = REWARD.of_planner.rule, []
    for agent in AGENTS:
        steps = steps_of(storage, agent)
        endings.append(steps[-1].ending)
        for step in steps:
            least = telling_scout.needed(step)
            if step.claim is None or step.claim.predictions == 0:
                assert least is None
                continue
            assert least == rule.goal + 0.01 + rule.caution / step.claim.predictions**0.5
            assert (step.claim.accuracy >= least) == (step.ending is Ending.GOAL_CLAIMED)
    assert Ending.GOAL_CLAIMED in endings
    assert set(endings) <= {Ending.GOAL_CLAIMED, Ending.ANOTHER_LANDED}


def test_a_step_is_told_alone_as_it_is_told_among_all_and_as_json(storage: LocalStorage) -> None:
    steps = steps_of(storage, "agent-2")
    for number in (0, len(steps) // 2, len(steps) - 1):
        (alone,) = steps_of(storage, "agent-2", number)
        told = telling_scout.document(alone)
        assert told == telling_scout.document(steps[number])
        assert json.loads(json.dumps(told, allow_nan=False)) == told
    last: dict[str, Any] = telling_scout.document(steps[-1])
    record = steps[-1].record
    assert {name: last[name] for name in ("step", "cell", "row", "column", "move", "plan", "ahead", "ending")} == {
        "step": record.step, "cell": record.cell, "row": record.row, "column": record.column, "move": "Land",
        "plan": [], "ahead": {}, "ending": str(steps[-1].ending),
    }  # fmt: skip


def test_scores_are_told_with_the_largest_weight_first_and_what_is_believed_above_them(storage: LocalStorage) -> None:
    steps = steps_of(storage, "agent-2")
    step = next(one for one in steps if one.ahead and one.claim and one.claim.captured >= FEW)
    header, rows = telling_scout.scores(step)
    assert header == ("", "weight", *(str(MOVES[move]) for move in step.ahead))
    names = [row[0] for row in rows]
    assert names == ["cell", *BELIEVED, "model initial", "model 2", "model 1", "blended"]
    assert [row[1] for row in rows[4:]] == ["0.500000", "0.300000", "0.200000", ""]
    assert rows[-1][2:] == tuple(f"{one.blended:.6f}" for one in step.ahead.values())
    between = next(one for one in steps if one.claim is None)
    assert telling_scout.scores(between) == ((), ())


def test_lines_say_who_was_heard_why_it_lands_and_how_the_plan_goes_on(storage: LocalStorage) -> None:
    steps = steps_of(storage, "agent-2")
    between = next(one for one in steps if one.claim is None)
    told = dict(telling_scout.lines(between))
    assert told["HA"] == "was not asked: the agent looks again when it has flown what it planned to"
    assert told["choice"] == f"{between.record.action}: goes on with its plan"
    assert "heard" not in told
    (first,) = steps_of(storage, "agent-1", 0)
    assert dict(telling_scout.lines(first))["HA"] == "1 cells known; too few to claim anything of the others"
    landing = next(steps_of(storage, agent)[-1] for agent in AGENTS if landed_by_claim(storage, agent))
    assert landing.claim is not None
    least = telling_scout.needed(landing)
    assert least is not None
    assert telling_scout.step_row(landing)[5:] == (
        f"{landing.claim.accuracy:.1%}", f"{least:.1%}", "Land", "the map is good enough",
    )  # fmt: skip
    assert dict(telling_scout.lines(landing))["HA"].endswith(": the map is good enough")


def landed_by_claim(storage: LocalStorage, agent: str) -> bool:
    return steps_of(storage, agent)[-1].ending is Ending.GOAL_CLAIMED


# logs of other runs


def test_a_log_of_agents_that_took_off_elsewhere_is_refused(tmp_path: Path, storage: LocalStorage) -> None:
    other = flown(tmp_path)
    members = [{"name": name, "start": {"row": 0, "column": index}} for index, name in enumerate(AGENTS)]
    document = json.loads(other.read(PATHS.fleet_spec))
    document["spec"]["agents"] = {"members": members}
    other.write(PATHS.fleet_spec, json.dumps(document).encode())
    with pytest.raises(MissionError, match=r"start a new run|of another run"):
        steps_of(other, "agent-1")
    assert steps_of(storage, "agent-1")


def test_a_log_that_was_flown_with_other_models_is_refused(tmp_path: Path) -> None:
    other = flown(tmp_path)
    elsewhere = PlannerModel.blank(FEATURES, InterestWeights(doubt=0.0, doubt_around=0.0, novelty=1.0))
    for key in INTERESTS:
        other.write(f"{PATHS.root}/models/{key}.npz", elsewhere.to_bytes())
    with pytest.raises(MissionError, match="start a new run"):
        steps_of(other, "agent-2")


def test_a_log_whose_others_are_cut_off_is_refused(tmp_path: Path) -> None:
    other = flown(tmp_path)
    data = other.read(PATHS.log(1, "agent-1"))
    other.write(PATHS.log(1, "agent-1"), data[: len(data) // 3])
    with pytest.raises(MissionError, match=r"records of agent-1, whose log has \d+; the log is damaged"):
        steps_of(other, "agent-2")


def test_each_kind_of_log_has_its_own_explanation(tmp_path: Path, storage: LocalStorage) -> None:
    grouped = open_log(grouped_settings_of(fly_missions(tmp_path, missions=1), "agent-1", 1))
    planned = open_log(settings_of(storage, "agent-1"))
    assert (grouped.plans, planned.plans) == (False, True)
    assert GROUPED != PATHS
    with pytest.raises(MissionError, match="flew through state groups"):
        grouped.explain_scout()
    with pytest.raises(MissionError, match="did not fly through state groups"):
        planned.explain()
    assert np.isfinite(TRUTH).all()
