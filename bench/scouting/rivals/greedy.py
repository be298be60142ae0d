"""Plans that look at a map while they fly: always the stretch with the most worth on its way for its energy.

Whenever an agent is half-way along its stretch, all cells are given a worth, and it takes the stretch of one or two
straight legs whose not yet captured cells are worth most for the energy of moves and captures. It captures its whole
path. The
map is shared: it has what all agents have captured by then, and no agent counts cells to which another one is on its
way. Agents begin in a random cell of their parts, and may fly anywhere.

- The Gaussian process finds worth where the class is in doubt by its own account.
- The oracle knows the truth and finds worth where the class is wrong on the map. No plan can know that; it is greedy,
  so it is no bound, but nothing that we know of does better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.scouting.fields import Field
from bench.scouting.flight import ENERGY, Flights, flown, move_costs, thorough_j
from bench.scouting.paths import between
from fleet.contexts.grid import Grid
from fleet.functions.classes import class_mean, class_probabilities, classes
from fleet.functions.kriging import krige
from fleet.missions.partition import parts

Values = NDArray[np.float64]
Flags = NDArray[np.bool_]
Worth = Callable[[Field, Flags, Flags], Values]
"""Worth of capturing each cell, float64 [rows, columns]; from the captured cells and those that will be before long,
both bool [cells]."""
_LEAST = 1e-9
"""Worth of any stretch, so that the nearest is taken where none is worth anything."""
_LONGEST = 1.3
"""E after which the mission ends though cells are left."""


def doubt(place: Field, captured: Flags, awaited: Flags) -> Values:
    """Probability that the most probable class of a cell is wrong, by kriging; classes refer to the map's own mean.

    Cells that others are on their way to count as captured with the value that is expected of them.
    """
    prediction = krige(place.seen(captured), place.grid)
    if awaited.any():
        expected = np.where(awaited | captured, prediction.values.reshape(-1), np.nan)
        prediction = krige(expected.reshape(prediction.values.shape), place.grid)
    mean = float(np.nanmean(prediction.values))
    return np.asarray(1.0 - np.nan_to_num(class_probabilities(prediction, mean).max(axis=0), nan=1.0))


def mistakes(place: Field, captured: Flags, awaited: Flags) -> Values:
    """1 where the class on the kriged map is wrong, else 0."""
    predicted, environment = krige(place.seen(captured), place.grid).values, place.environment
    mean = class_mean(predicted, environment)
    wrong = classes(predicted, mean) != classes(place.truth.reshape(predicted.shape), mean)
    return np.where(place.grid.valid, wrong, 0.0)


@dataclass(frozen=True)
class Greedy:
    """A plan that follows a worth.

    Args:
        name: For tables.
        worth: What capturing a cell is worth.
        shortest, longest: Moves in a stretch; it is longer where nothing is left so near.
        flown: Share of a stretch after which the agent looks again.
    """

    name: str
    worth: Worth
    shortest: int = 6
    longest: int = 20
    flown: float = 0.5

    def budgets(self, place: Field) -> Sequence[float]:
        """None: it flies on until nothing is left."""
        return ()

    def fly(self, place: Field, agents: int, seed: int, budget: float | None) -> Flights:
        """Fly until every cell is captured."""
        generator = np.random.default_rng(seed)
        swarm = _Swarm(place, [int(generator.choice(part)) for part in parts(place.grid, agents)])
        while swarm.left.any() and swarm.spent_j < _LONGEST * thorough_j(place, agents):
            agent = int(np.argmin(swarm.time_s))
            worth = np.where(swarm.left, self.worth(place, *swarm.known(agent)), 0.0)
            swarm.follow(agent, self._stretch(swarm, agent, worth))
        return tuple(
            flown(place.grid, np.array(path), np.array(captured))
            for path, captured in zip(swarm.paths, swarm.captures, strict=True)
        )

    def _stretch(self, swarm: _Swarm, agent: int, worth: Values) -> NDArray[np.int64]:
        """The cells of the best stretch, as far as it is flown, without the one that the agent is in."""
        grid, here = swarm.place.grid, swarm.paths[agent][-1]
        moves, energy_j = _distances(grid, here)
        on_way = _along_legs(grid, np.stack((worth, swarm.left.astype(np.float64))), here)
        price_j = energy_j + on_way[:, 1] * ENERGY.capture().energy_j
        near = swarm.left & (moves >= self.shortest) & (moves <= self.longest)
        if not near.any():
            near = swarm.left & (moves <= max(self.longest, int(moves[swarm.left].min())))
        rate = np.where(near, (on_way[:, 0] + _LEAST) / np.maximum(price_j, 1.0), -1.0)
        leg, target = divmod(int(rate.argmax()), grid.cells)
        path = between(grid, here, target, rows_first=leg == 0)[1:]
        first = int(np.argmax(swarm.left.reshape(-1)[path]))  # looking again before it could turn it back
        return path[: max(first + 1, round(self.flown * len(path)))]


def gaussian_process() -> Greedy:
    """The class-aware Gaussian process that captures its whole path."""
    return Greedy("GP over its path", doubt)


def greedy_oracle() -> Greedy:
    """The same with the worth of one who knows the truth."""
    return Greedy("greedy oracle", mistakes)


@dataclass
class _Swarm:
    """Where all agents are.

    Args:
        place: The field.
        starts: Take-off cells.
    """

    place: Field
    starts: list[int]
    paths: list[list[int]] = field(init=False)
    captures: list[list[bool]] = field(init=False)
    time_s: Values = field(init=False)
    spent_j: float = field(init=False)
    captured_s: Values = field(init=False)
    left: Flags = field(init=False)

    def __post_init__(self) -> None:
        self.paths = [[start] for start in self.starts]
        self.captures = [[True] for _ in self.starts]
        self.time_s = np.full(len(self.starts), ENERGY.take_off().time_s + ENERGY.capture().time_s)
        self.spent_j = len(self.starts) * (ENERGY.take_off() + ENERGY.land() + ENERGY.capture()).energy_j
        self.captured_s = np.full(self.place.grid.cells, np.inf)
        self.captured_s[self.starts] = self.time_s
        self.left = self.place.grid.valid.copy()
        self.left.flat[self.starts] = False

    def known(self, agent: int) -> tuple[Flags, Flags]:
        """Cells captured by the agent's time, and those that others are on their way to, bool [cells]."""
        captured = self.captured_s <= self.time_s[agent]
        return captured, np.isfinite(self.captured_s) & ~captured

    def follow(self, agent: int, path: NDArray[np.int64]) -> None:
        """Fly along some cells, and capture those that nobody has."""
        energy_j, time_s = move_costs(self.place.grid)
        row, column = self.place.grid.position(self.paths[agent][-1])
        for cell in path.tolist():
            before = row, column
            row, column = self.place.grid.position(cell)
            step = row - before[0] + 1, column - before[1] + 1
            self.time_s[agent] += time_s[step]
            self.spent_j += energy_j[step]
            self.paths[agent].append(cell)
            self.captures[agent].append(bool(self.left.flat[cell]))
            if self.left.flat[cell]:
                self.time_s[agent] += ENERGY.capture().time_s
                self.spent_j += ENERGY.capture().energy_j
                self.left.flat[cell], self.captured_s[cell] = False, self.time_s[agent]


def _distances(grid: Grid, here: int) -> tuple[NDArray[np.int64], Values]:
    """Moves and their energy from a cell to every cell, [rows, columns]."""
    energy_j, _ = move_costs(grid)
    row, column = grid.position(here)
    down, across = np.arange(grid.rows)[:, None] - row, np.arange(grid.columns)[None, :] - column
    up_j, down_j, along_j = energy_j[0, 1], energy_j[2, 1], energy_j[1, 0]
    return np.abs(down) + np.abs(across), np.where(down < 0, -down * up_j, down * down_j) + np.abs(across) * along_j


def _along_legs(grid: Grid, values: Values, here: int) -> Values:
    """Sums of values over both ways of two legs from a cell to every cell, the first cell left out.

    Args:
        values: float64 [K, rows, columns].
    Returns:
        float64 [2, K, rows, columns]: along the column first, along the row first.
    """
    row, column = grid.position(here)
    values = values.copy()
    values[:, row, column] = 0.0
    down, across = _outwards(values, row, 1), _outwards(values, column, 2)
    column_first = down[:, :, column, None] + across - values[:, :, column, None]
    row_first = across[:, row, None, :] + down - values[:, row, None, :]
    return np.stack((column_first, row_first))


def _outwards(values: Values, start: int, axis: int) -> Values:
    """Sums from a row or column outwards, both ends included."""
    before, after = np.split(values, [start], axis=axis)
    first = np.take(values, [start], axis=axis)
    back = np.flip(np.cumsum(np.flip(before, axis), axis), axis) + first
    return np.concatenate((back, np.cumsum(after, axis)), axis=axis)
