"""What a mission expects of its place: the map that the mission before it left, made with what that one expected.

So all that was ever captured is in it, the newest last. It is made of storage alone, and every agent makes the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.base import Environment, Expectation
from fleet.contexts.grid import Grid
from fleet.functions import wire
from fleet.learning.reward import RewardModel
from fleet.missions.records import Record
from fleet.runtime.evaluation import read_logs
from fleet.runtime.settings import Settings
from fleet.spec.learning import SAKind

Values = NDArray[np.float64]


def kept_environment(settings: Settings, environment: Environment) -> Environment:
    """Where the mission flies, with what is expected there: as it is in storage, where it is put if nobody has yet.

    Args:
        environment: As the sensor tells it.
    """
    storage, path = settings.storage, settings.paths.environment(settings.mission)
    if storage.exists(path):
        return stored_environment(settings)
    known = replace(environment, expected=_expected(settings, environment.grid))
    storage.write(path, wire.dump(wire.encode_environment(known)))
    return known


def stored_environment(settings: Settings) -> Environment:
    """Where the mission flies, as the first of its agents has put it into storage.

    Raises:
        ObjectNotFound: none has yet.
    """
    path = settings.paths.environment(settings.mission)
    return wire.decode_environment(wire.load(settings.storage.read(path)))


def found(environment: Environment, captured: Values) -> Expectation | None:
    """The map that a mission leaves of a quantity: what the next one expects.

    Args:
        environment: Where it flew, with what it expected.
        captured: float64 [rows, columns]; NaN where nothing was captured.

    Returns:
        None when nothing is known.
    """
    from fleet.functions.extrapolation import extrapolate  # noqa: PLC0415 - loads scipy, where something is expected

    if not np.isfinite(captured).any():
        return environment.expected
    map_ = extrapolate(captured, environment.grid, expected=environment.expected)
    return Expectation(map_.values, map_.deviation)


def filled(expected: Expectation, known: NDArray[np.bool_]) -> Expectation:
    """The same for a place that has data in other cells too: nothing is known of these but the others' mean and range.

    Args:
        known: Cells of which something is expected, bool [rows, columns].
    """
    values = expected.values[known]
    return Expectation(
        np.where(known, expected.values, values.mean()), np.where(known, expected.deviation, values.std())
    )


def captured_values(logs: Mapping[str, Sequence[Record]], reward: RewardModel, grid: Grid) -> Values:
    """The mapped quantity where a mission captured it, float64 [rows, columns]; NaN elsewhere.

    Args:
        logs: Records of each agent, in the fleet's order: of what several captured the first one's counts.
    """
    column = reward.features.index(reward.of_planner.feature)
    captured = np.full(grid.valid.shape, np.nan)
    for log in reversed(list(logs.values())):
        for record in log:
            if record.captured:
                captured.flat[record.cell] = record.ssv[column]
    return captured


def _expected(settings: Settings, grid: Grid) -> Expectation | None:
    fleet, storage, paths = settings.fleet, settings.storage, settings.paths
    if fleet.sa.kind is not SAKind.PLANNER or not fleet.online_learning.memory:
        return None
    reward = RewardModel.model_validate_json(storage.read(paths.reward))
    if not reward.of_planner.expects:
        return None
    for number in range(settings.mission - 1, 0, -1):
        if storage.exists(paths.environment(number)):
            return _left_by(settings.at_mission(number), reward, grid)
    return None


def _left_by(settings: Settings, reward: RewardModel, grid: Grid) -> Expectation | None:
    """What an earlier mission says of a place; None when it flew elsewhere."""
    environment = stored_environment(settings)
    if not _alike(environment.grid, grid):
        return None
    logs = read_logs(settings, [agent.name for agent in settings.fleet.agents.resolved])
    map_ = found(environment, captured_values(logs, reward, environment.grid))
    return None if map_ is None else filled(map_, environment.grid.valid)


def _alike(one: Grid, other: Grid) -> bool:
    """Whether two grids may be of one place: their cells are, though not all need have data in both."""
    sides = [(grid.valid.shape, grid.cell_height_m, grid.cell_width_m) for grid in (one, other)]
    ways = [(grid.rows_go_south, grid.columns_go_east) for grid in (one, other)]
    return sides[0] == sides[1] and ways[0] == ways[1]
