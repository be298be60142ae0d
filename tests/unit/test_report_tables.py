from __future__ import annotations

import numpy as np

from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.missions.records import Record
from fleet.report.collect import AgentRun, MissionRun
from fleet.report.tables import map_csv, trace_csv

NAN = float("nan")


def record(step: int, cell: int, captured: bool, action: str, time_s: float, energy_j: float) -> Record:
    return Record(step, cell, cell // 3, cell % 3, captured, (1.0,), 1, 0, action, time_s, energy_j)


def mission(number: int) -> MissionRun:
    valid = np.array([[True, True, True], [True, False, True]])
    truth = np.array([[1.0, 2.5, 0.1], [1e-7, NAN, 4.0]])
    agents = (
        AgentRun(
            "agent-1",
            (
                record(0, 0, True, "East", 14.0, 823.7),
                record(1, 1, False, "East", 20.00049, 1 / 3),
                record(2, 2, True, "Land", 26.0, 1e6),
            ),
            None,
        ),
        AgentRun("agent-2", (record(0, 5, True, "Land", 14.0, 823.7),), None),
        AgentRun("agent-3", (), None),
    )
    artefacts = {
        "predicted": np.array([[1.0, 2.25, NAN], [0.3, 9.0, 4.0]]),
        "class": np.array([[0.0, 3.0, NAN], [1.0, 2.0, 3.0]]),
    }
    return MissionRun(
        number, "field", Environment("field", "d", Grid(valid), "exg", truth), False, agents, None, artefacts
    )


def test_the_trace_has_a_line_for_each_visited_state_in_order() -> None:
    assert trace_csv([mission(1), mission(12)]) == (
        "mission,agent,step,t_s,row,col,captured,action,energy_j\n"
        "1,agent-1,0,14,0,0,1,East,823.7\n"
        "1,agent-1,1,20,0,1,0,East,0.333\n"
        "1,agent-1,2,26,0,2,1,Land,1000000\n"
        "1,agent-2,0,14,1,2,1,Land,823.7\n"
        "12,agent-1,0,14,0,0,1,East,823.7\n"
        "12,agent-1,1,20,0,1,0,East,0.333\n"
        "12,agent-1,2,26,0,2,1,Land,1000000\n"
        "12,agent-2,0,14,1,2,1,Land,823.7\n"
    )


def test_the_map_has_a_line_for_each_cell_with_data_and_nothing_where_nothing_is_known() -> None:
    assert map_csv(mission(1)) == (
        "row,col,truth,predicted,class,visited\n"
        "0,0,1,1,0,1\n"
        "0,1,2.5,2.25,3,1\n"
        "0,2,0.1,,,1\n"
        "1,0,1e-07,0.3,1,0\n"
        "1,2,4,4,3,1\n"
    )


def test_without_its_context_the_map_has_the_predicted_cells() -> None:
    lost = MissionRun(1, "field", artefacts={"predicted": np.array([[1.5, NAN]])})
    assert map_csv(lost) == "row,col,truth,predicted,class,visited\n0,0,,1.5,,0\n"


def test_artefacts_of_another_shape_count_as_none() -> None:
    whole = mission(1)
    torn = MissionRun(1, "field", whole.environment, False, whole.agents, None, {"predicted": np.ones((2, 2))})
    assert map_csv(torn).splitlines()[1] == "0,0,1,,,1"


def test_nothing_flown_gives_headers_only() -> None:
    assert trace_csv([]) == "mission,agent,step,t_s,row,col,captured,action,energy_j\n"
    assert map_csv(MissionRun(1)) == "row,col,truth,predicted,class,visited\n"
