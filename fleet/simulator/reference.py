"""The plain form of the simulator: one `Flight` after the other, state by state.

It says what the kernel must do, and is what the kernel is tested and timed against.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fleet.missions.flight import LAND, Decision, Flight
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import Layout
from fleet.simulator.arrays import scored_moves
from fleet.simulator.batch import Batch, Finished, Flown, Trace, broken_table


def fly(layout: Layout, batch: Batch, traced: bool = False, finished: Finished | None = None) -> Flown:
    """The same as `fleet.simulator.batch.fly`, in plain Python.

    Raises:
        MissionError: the batch does not fit the layout, or has no score where one may be needed.
    """
    batch.check(layout)
    broken = np.isnan(batch.scores[:, layout.group_of >= 0, : len(scored_moves(layout))]).any(axis=(1, 2))
    if broken.any():
        raise broken_table(int(broken.argmax()))
    flown = Flown.blank(len(batch), layout.agents, layout.grid.cells)
    logs: dict[tuple[int, int], list[Decision]] = {}
    for mission in range(len(batch)):
        for agent in range(layout.agents):
            flight = start(layout, batch, mission, agent)
            logs[mission, agent] = _run(flight, batch, mission, _question(flight, mission, finished))
            _count(flown, mission, flight, logs[mission, agent])
    return replace(flown, trace=_trace(flown.steps, logs)) if traced else flown


def start(layout: Layout, batch: Batch, mission: int, agent: int) -> Flight:
    """One agent of one mission before it takes off."""
    return Flight(
        layout,
        agent,
        ThresholdHA(float(batch.utility_thresholds[mission]), int(batch.visited_thresholds[mission])),
        seed=batch.seed,
        mission=int(batch.missions[mission]),
        exploration=float(batch.exploration[mission]),
    )


def _question(flight: Flight, mission: int, finished: Finished | None) -> Callable[[], bool] | None:
    if finished is None:
        return None

    def ask() -> bool:
        captured: NDArray[np.bool_] = np.zeros(flight.layout.grid.cells, dtype=np.bool_)
        captured[list(flight.captured)] = True
        return finished(mission, flight.agent, captured)

    return ask


def _run(flight: Flight, batch: Batch, mission: int, finished: Callable[[], bool] | None) -> list[Decision]:
    scores = batch.scores[batch.table[mission, flight.agent]]
    rewards = batch.rewards[batch.reward_of[mission]]
    log = []
    while not flight.landed:
        cell = flight.cell
        log.append(flight.decide(lambda cell=cell: scores[cell].tolist(), float(rewards[cell]), finished))  # type: ignore[misc]  # mypy cannot type a lambda's default
    return log


def _count(flown: Flown, mission: int, flight: Flight, log: list[Decision]) -> None:
    agent = flight.agent
    flown.captured[mission, list(flight.captured)] = True
    for decision in log:
        if decision.move != LAND:
            flown.moves[mission, agent, decision.move] += 1
    flown.captures[mission, agent] = sum(decision.captured for decision in log)
    flown.decisions[mission, agent] = sum(decision.legal != 0 for decision in log)
    flown.steps[mission, agent] = len(log)
    flown.groups_explored[mission, agent] = flight.groups_explored


def _trace(steps: NDArray[np.int64], logs: dict[tuple[int, int], list[Decision]]) -> Trace:
    missions, agents = steps.shape
    trace = Trace.blank(missions, agents, int(steps.max(initial=0)))
    trace.steps[:] = steps
    for (mission, agent), log in logs.items():
        end = len(log)
        trace.cell[mission, agent, :end] = [decision.cell for decision in log]
        trace.captured[mission, agent, :end] = [decision.captured for decision in log]
        trace.legal[mission, agent, :end] = [decision.legal for decision in log]
        trace.move[mission, agent, :end] = [decision.move for decision in log]
    return trace
