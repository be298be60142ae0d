"""Why an agent made each of its moves: explained from the log, held against a plain reckoning of the same."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.errors import MissionError
from fleet.learning.models import load_model
from fleet.missions.flight import LAND
from fleet.missions.layout import MOVES
from fleet.missions.records import records_after_gap
from fleet.report import telling
from fleet.report.explain import Explanation, FlownLog, Reason, flights_of, open_log
from fleet.storage.local import LocalStorage
from tests.flown_missions import GRID, PATHS, REWARD, SSV, WEIGHTS, fly_missions, settings_of

EXPLORING: dict[str, Any] = {"sa": {"kind": "QLearning", "flightExploration": 0.3}}
CHECKED: dict[str, Any] = {"eval": {"function": "own:evaluate", "checks": "AfterGroup"}}
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "exploring": EXPLORING,
    "checked": CHECKED,
    "not in transit": {
        "stateSpace": {"context": "field", "groups": {"rows": 3, "columns": 3}, "captureInTransit": False}
    },
}


@pytest.fixture
def flown(tmp_path: Path, quick_disk: None) -> LocalStorage:
    return fly_missions(tmp_path / "storage")


def log_of(storage: LocalStorage, agent: str = "agent-2", mission: int = 2) -> FlownLog:
    return open_log(settings_of(storage, agent, mission))


@pytest.mark.parametrize("agent", WEIGHTS)
@pytest.mark.parametrize("changes", KINDS.values(), ids=KINDS.keys())
def test_each_recorded_move_is_the_one_that_its_explanation_gives(
    tmp_path: Path, quick_disk: None, changes: dict[str, Any], agent: str
) -> None:
    storage = fly_missions(tmp_path, missions=1, **changes)
    log = log_of(storage, agent, 1)
    steps = log.explain()
    assert [step.record for step in steps] == list(log.records)
    assert log.records[-1].move == LAND
    for step, following in zip(steps, [*log.records[1:], None], strict=True):
        assert step.record.move in plain_choice(storage, agent, step)
        if step.target is not None:
            assert following is not None
            assert far((following.row, following.column), step.target) < far(
                (step.record.row, step.record.column), step.target
            )


def plain_choice(storage: LocalStorage, agent: str, step: Explanation) -> set[int]:
    """The moves that may follow, reckoned from the models in storage and the SSV of the field."""
    record = step.record
    if step.reason in {Reason.ALL_GROUPS_EXPLORED, Reason.EVAL_FINISHED}:
        return {LAND}
    if step.reason is Reason.EXPLORATION:
        return set(step.legal)
    if step.reason is not Reason.HIGHEST_SCORE:
        assert record.legal == 0
        return set(range(4))
    total = np.zeros(len(MOVES))
    for key, weight in WEIGHTS[agent].items():
        scores = load_model(storage.read(f"{PATHS.root}/models/{key}.npz")).scores(SSV[record.cell][None])[0]
        total += weight * scores
        if weight:
            assert step.scores[key] == {move: scores[move] for move in step.legal}
    assert step.blended == pytest.approx({move: total[move] for move in step.legal}, abs=1e-9)
    assert step.weights == {key: weight for key, weight in WEIGHTS[agent].items() if weight}
    assert sum(1 << move for move in step.legal) == record.legal
    return {max(step.legal, key=lambda move: total[move])}


def far(one: tuple[int, int], other: tuple[int, int]) -> int:
    return abs(one[0] - other[0]) + abs(one[1] - other[1])


def test_u_and_v_are_the_sums_over_what_was_captured_in_the_group_and_say_when_it_is_left(flown: LocalStorage) -> None:
    utility, visited = Counter[int](), Counter[int]()
    left: set[int] = set()
    steps = log_of(flown).explain()
    for step in steps:
        if step.record.captured:
            visited[step.group_of_cell] += 1
            gained = REWARD.reward(SSV[step.record.cell][None])[0] if step.record.step else 0.0
            utility[step.group_of_cell] += gained  # type: ignore[assignment]  # a Counter counts in floats too
        for group in step.groups:
            history = group.history
            assert history.visited == visited[history.group]
            assert history.utility == pytest.approx(utility[history.group])
            over = (history.utility > REWARD.utility_threshold, history.visited > REWARD.visited_threshold)
            assert (group.useful_enough, group.seen_enough) == over
            if step.asked_ha:
                assert group.is_left == (any(over) or history.visited == history.cells)
            left |= {group.number} if group.is_left else set()
    assert left == set(range(1, steps[0].groups_of_agent + 1))


def test_every_reason_occurs_and_none_where_the_fleetspec_forbids_it(tmp_path: Path, quick_disk: None) -> None:
    found = {}
    for name, changes in {**KINDS, "both": {**EXPLORING, **CHECKED}}.items():
        storage = fly_missions(tmp_path / name.replace(" ", "-"), missions=1, **changes)
        found[name] = {step.reason for agent in WEIGHTS for step in log_of(storage, agent, 1).explain()}
    travels = {Reason.HIGHEST_SCORE, Reason.TRAVEL_IN_GROUP, Reason.TRAVEL_TO_GROUP}
    assert found["plain"] == {*travels, Reason.ALL_GROUPS_EXPLORED}
    assert found["exploring"] == {*found["plain"], Reason.EXPLORATION}
    assert found["checked"] >= {Reason.HIGHEST_SCORE, Reason.EVAL_FINISHED}
    assert Reason.ALL_GROUPS_EXPLORED not in found["checked"]
    assert set.union(*found.values()) == set(Reason)


def test_one_step_is_told_as_it_is_told_among_all(flown: LocalStorage) -> None:
    steps = log_of(flown).explain()
    for number in (0, len(steps) // 2, len(steps) - 1):
        (alone,) = log_of(flown).explain(number)
        assert telling.document(alone) == telling.document(steps[number])


def test_a_step_on_the_way_says_where_to_and_that_nobody_was_asked(flown: LocalStorage) -> None:
    step = next(step for step in log_of(flown).explain() if not step.asked_ha)
    told = dict(telling.lines(step))
    number = step.groups[-1].number
    assert step.target is not None
    row, column = step.target
    assert told["HA"] == f"was not asked: the agent is on its way to group {number}"
    assert told["SA"] == "was not asked: the agent is on its way to a cell"
    assert told["choice"] == (
        f"{step.record.action}: still on the way to a cell of its state group {number}: row {row}, column {column}"
    )
    assert telling.scores(step)[1] == ()


def test_scores_are_told_by_model_with_the_largest_weight_first(flown: LocalStorage) -> None:
    step = next(step for step in log_of(flown).explain() if len(step.legal) > 1)
    header, rows = telling.scores(step)
    assert header == ("model", "weight", *(str(MOVES[move]) for move in step.legal))
    assert [row[:2] for row in rows] == [("initial", "0.500000"), ("2", "0.300000"), ("1", "0.200000"), ("blended", "")]
    chosen = header.index(step.record.action)
    assert float(rows[-1][chosen]) == max(float(score) for score in rows[-1][2:])


def test_a_step_for_machines_is_json_with_moves_by_name(flown: LocalStorage) -> None:
    step = next(step for step in log_of(flown).explain() if step.legal)
    told = json.loads(json.dumps(telling.document(step)))
    assert told["captured"] == {"exg": SSV[step.record.cell][0], "brightness": SSV[step.record.cell][1]}
    assert told["legal"] == [str(MOVES[move]) for move in step.legal]
    assert set(told["blended"]) == set(told["legal"])
    assert max(told["blended"], key=told["blended"].get) == told["move"] == step.record.action
    assert (told["row"], told["column"]) == GRID.position(told["cell"])


def test_a_log_that_was_changed_is_refused_at_the_step_that_does_not_follow(flown: LocalStorage) -> None:
    records = [json.loads(line) for line in lines_of(flown)]
    changed = next(record for record in records if record["legal"].bit_count() > 1)
    others = [move for move in range(4) if changed["legal"] >> move & 1 and move != changed["move"]]
    changed["move"], changed["action"] = others[0], str(MOVES[others[0]])
    rewrite(flown, [json.dumps(record).encode() for record in records])
    log = log_of(flown)
    with pytest.raises(MissionError, match=f"step {changed['step']} of the log says {changed['action']}"):
        log.explain()


@pytest.mark.parametrize("ssv", [[0.5], []], ids=["too short", "empty"])
def test_an_ssv_that_lost_features_is_refused(flown: LocalStorage, ssv: list[float]) -> None:
    records = [json.loads(line) for line in lines_of(flown)]
    records[0]["ssv"] = ssv
    rewrite(flown, [json.dumps(record).encode() for record in records])
    with pytest.raises(MissionError, match=f"step 0 of the log has an SSV of {len(ssv)} features"):
        log_of(flown).explain()


def test_a_log_with_a_hole_is_explained_up_to_it_and_says_what_is_lost(flown: LocalStorage) -> None:
    whole = lines_of(flown)
    rewrite(flown, [*whole[:4], b'{"step":4,"cell":', *whole[5:]])
    log = log_of(flown)
    assert (len(log.explain()), log.lost) == (4, len(whole) - 5)


def test_a_torn_last_line_is_no_damage(flown: LocalStorage) -> None:
    data = b"\n".join([*lines_of(flown), b'{"step":9'])
    assert records_after_gap(data) == 0


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (PATHS.reward, "what agent-2 flew mission 2 with is not whole: there is no object .*reward.json"),
        (f"{PATHS.root}/models/1.npz", "what agent-2 flew mission 2 with is not whole: there is no object .*1.npz"),
        (PATHS.plan(2), "mission 2 has no plan in storage"),
        (PATHS.environment(2), "the place of mission 2 is not whole"),
        (PATHS.log(2, "agent-2"), "the log of agent-2 in mission 2 is not whole"),
    ],
)
def test_what_is_missing_is_named(flown: LocalStorage, path: str, message: str) -> None:
    flown.delete(path)
    with pytest.raises(MissionError, match=message):
        log_of(flown)


@pytest.mark.parametrize("path", [PATHS.reward, PATHS.plan(2), PATHS.environment(2), PATHS.log(2, "agent-2")])
def test_what_is_damaged_is_named(flown: LocalStorage, path: str) -> None:
    flown.write(path, b'{"torn')
    with pytest.raises(MissionError, match=r"mission 2.* (cannot be read: |has no step that can be read)"):
        log_of(flown)


def test_only_missions_with_a_log_of_the_agent_count_as_its_flights(flown: LocalStorage) -> None:
    flown.delete(PATHS.log(1, "agent-2"))
    flown.write(PATHS.weights(3), b"{}")
    assert [flights_of(settings_of(flown, agent, 0)) for agent in WEIGHTS] == [[1, 2], [2]]


def lines_of(storage: LocalStorage) -> list[bytes]:
    return [line for line in storage.read(PATHS.log(2, "agent-2")).splitlines() if line]


def rewrite(storage: LocalStorage, lines: list[bytes]) -> None:
    storage.write(PATHS.log(2, "agent-2"), b"\n".join([*lines, b""]))
