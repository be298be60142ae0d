"""Agent-steps a second on one core: the simulator, its plain reference, and the same missions through PettingZoo.

    python -m bench.run simulator

An agent-step is one visited state of one agent. The policy is in the loop: the default SA model, a Q-function over the
SSV, scores every state of the field within the timed call; that is done once for all missions of a batch, as training
does. Another figure has a new policy for every 16 missions, as the search for model weights has. The field is the corn
field of examples/crop-scouting (first date), or one made up when it is not there. All fly 4 agents in groups of 3 x 3
with thresholds that leave about a third of the states out, and 20 % exploration unless said otherwise; PettingZoo's
peer flies without. Where the SSV has belief features (`bench.greedy`), nothing can be scored beforehand: each step
predicts the free cells beside the agent by kriging, and scores them with weights of the mission's own. The last figures
are of agents in real flight, which score one SSV at a time with each of their models. Compiling is warm-up and not in
any figure; each figure is the best of several runs.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.greedy.figures import with_belief
from bench.measure import Result, seconds
from fleet.contexts.grid import Grid
from fleet.contexts.load import load_cube
from fleet.learning.blend import blend
from fleet.learning.qlearning import QLearning
from fleet.learning.reward import Normaliser
from fleet.missions.flight import Flight
from fleet.missions.history import ThresholdHA
from fleet.missions.layout import MOVES, Layout, plan_layout
from fleet.simulator import reference
from fleet.simulator.batch import Batch, Flown, fly
from fleet.simulator.parallel_env import MissionEnv
from fleet.spec.learning import SASpec
from fleet.spec.swarm import Agents, StateSpace
from fleet.storage.local import LocalStorage

COMMAND = "python -m bench.run simulator"
FIELD = Path(__file__).resolve().parent.parent / "examples" / "crop-scouting" / "contexts" / "2018-06-01"
AGENTS, MISSIONS, PER_POLICY = 4, 1024, 16
UNIT = "agent-steps/s"


@dataclass(frozen=True, eq=False)
class Field:
    """What missions are flown over: a layout, and normalised SSVs [cells, features], NaN without data."""

    layout: Layout
    ssv: NDArray[np.float64]
    name: str


def load_field() -> Field:
    grid, ssv, name = _corn() if FIELD.is_dir() else _made_up()
    normalised = Normaliser.over([ssv]).apply(ssv)
    layout = plan_layout(grid, StateSpace(context="field"), Agents(count=AGENTS).resolved)
    return Field(layout, normalised, name)


def _corn() -> tuple[Grid, NDArray[np.float64], str]:
    cube = load_cube(LocalStorage(FIELD))
    cells, grid = cube.content.cells, cube.environment.grid
    today = cells.dates == cube.date
    rows = np.column_stack([values[today] for values in cells.features.values()])
    whole = np.isfinite(rows).all(axis=0)
    ssv = np.full((grid.cells, int(whole.sum())), np.nan)
    ssv[cells.rows[today] * grid.columns + cells.columns[today]] = rows[:, whole]
    return grid, ssv, f"corn field {cube.date}"


def _made_up() -> tuple[Grid, NDArray[np.float64], str]:
    generator = np.random.default_rng(0)
    valid = generator.random((56, 44)) < 0.9
    ssv = np.where(valid.ravel()[:, None], generator.random((valid.size, 8)), np.nan)
    return Grid(valid), ssv, "made-up field"


class Policies:
    """Random Q-functions, and batches of missions that fly with them."""

    def __init__(self, field: Field) -> None:
        self.field = field
        features = field.ssv.shape[1]
        self._mapped = np.isfinite(field.ssv).all(axis=1)
        names = tuple(f"feature_{i}" for i in range(features))
        self._blank = QLearning.blank(SASpec(), names, Normaliser(low=(0.0,) * features, high=(1.0,) * features), 0)
        self._rewards = np.nan_to_num(field.ssv.mean(axis=1))[None]

    def table(self, seed: int) -> NDArray[np.float64]:
        """The scores of one policy, float64 [cells, moves]."""
        scores = np.zeros((len(self.field.ssv), len(MOVES)))
        scores[self._mapped] = self.model(seed).scores(self.field.ssv[self._mapped])
        return scores

    def model(self, seed: int) -> QLearning:
        """A policy."""
        return replace(self._blank, weights=np.random.default_rng(seed).normal(size=self._blank.weights.shape))

    def batch(self, missions: int, policies: int = 1, exploration: float = 0.2) -> Batch:
        """Missions, each run of them with a policy of its own; the policies score the field anew."""
        utility = 6.0 * float(self._rewards[0, self._mapped].mean())
        return Batch(
            scores=np.stack([self.table(seed) for seed in range(policies)]),
            table=np.repeat(np.arange(missions)[:, None] * policies // missions, AGENTS, axis=1),
            rewards=self._rewards,
            reward_of=np.zeros(missions, dtype=np.int64),
            utility_thresholds=np.full(missions, utility),
            visited_thresholds=np.full(missions, 6),
            exploration=np.full(missions, exploration),
            missions=np.arange(missions),
        )


def steps_a_second(flight: Callable[[], Flown], repeats: int = 5) -> float:
    return float(flight().steps.sum()) / seconds(flight, repeats, warm_up=0)


def pettingzoo_steps_a_second(field: Field, batch: Batch) -> float:
    """The same missions, stepped with the best legal move of the score table."""
    ha = ThresholdHA(float(batch.utility_thresholds[0]), int(batch.visited_thresholds[0]))
    env = MissionEnv(field.layout, field.ssv, batch.rewards[0], ha)
    scores = batch.scores[0]
    states = 0

    def missions() -> None:
        nonlocal states
        states = 0
        for _ in range(4):
            observed, infos = env.reset()
            states += sum(info["states"] for info in infos.values())
            while env.agents:
                actions = {
                    agent: int(np.where(observed[agent]["action_mask"], scores[infos[agent]["cell"]], -np.inf).argmax())
                    for agent in env.agents
                }
                observed, _, _, _, infos = env.step(actions)
                states += sum(info["states"] for info in infos.values())

    taken = seconds(missions, repeats=3)
    return states / taken


def run() -> list[Result]:
    field = load_field()
    policies = Policies(field)
    layout = field.layout
    few = policies.batch(4, exploration=0.2)
    plain = steps_a_second(lambda: reference.fly(layout, few), repeats=3)
    stepped = pettingzoo_steps_a_second(field, policies.batch(1, exploration=0.0))
    learned = steps_a_second(lambda: fly(layout, policies.batch(MISSIONS)))
    peers = (("plain reference", plain), ("PettingZoo stepping", stepped))
    where = f"{field.name}, {AGENTS} agents"
    results = [
        Result.against(
            f"simulator, Q-function in the loop, {MISSIONS} missions ({where})", learned, UNIT, peer, COMMAND
        )
        for peer in peers
    ]
    groups = MISSIONS // PER_POLICY
    table = policies.batch(MISSIONS, exploration=0.0)
    explored = policies.batch(MISSIONS)
    others: dict[str, Callable[[], Flown]] = {
        f"a new Q-function for every {PER_POLICY} missions": lambda: fly(layout, policies.batch(MISSIONS, groups)),
        "tables of scores at hand, no exploration": lambda: fly(layout, table),
        "tables of scores at hand, 20 % exploration": lambda: fly(layout, explored),
        "tables of scores at hand, 20 % exploration, with a trace": lambda: fly(layout, explored, traced=True),
    }
    for name, flight in others.items():
        figure = steps_a_second(flight)
        results.append(Result.against(f"simulator, {name} ({where})", figure, UNIT, peers[0], COMMAND))
    for share in (0.4, 0.9):
        results += with_belief(share, COMMAND)
    return results + [decision(policies, models) for models in (1, 4, 16)]


def decision(policies: Policies, models: int) -> Result:
    """Microseconds in which SA chooses in flight by one SSV: the scores of each model, blended, and the best move."""
    own = {f"model-{seed}": policies.model(seed) for seed in range(models)}
    weights = dict.fromkeys(own, 1.0 / models)
    ssv = policies.field.ssv[np.isfinite(policies.field.ssv).all(axis=1)][:1]
    flight = Flight(policies.field.layout, 0, ThresholdHA(np.inf, 6))
    every = (1 << len(MOVES)) - 1

    def chosen() -> int:
        scores = {key: model.scores(ssv)[0] for key, model in own.items()}
        return flight.choose(every, blend(scores, weights).tolist()).move

    def plainly_chosen() -> int:
        scores = [plain_scores(model, ssv[0].tolist()) for model in own.values()]
        blended = [sum(score[move] for score in scores) / models for move in range(len(MOVES))]
        return max(range(len(MOVES)), key=lambda move: (blended[move], -move))

    assert chosen() == plainly_chosen()
    name = f"SA's decision in a state group, {models} model{'s' if models > 1 else ''}"
    plain = ("plain Python", seconds(plainly_chosen, 200) * 1e6)
    return Result.against(name, seconds(chosen, 1000) * 1e6, "us", plain, COMMAND)


def plain_scores(model: QLearning, ssv: list[float]) -> list[float]:
    """Q of each move; SSVs of the benchmark are in [0, 1]."""
    parts = [1.0, *ssv]
    for centre in model.centres.tolist():
        distance = sum((value - at) ** 2 for value, at in zip(ssv, centre, strict=True))
        parts.append(1.0 / (1.0 + distance / model.width**2))
    length, rows = math.sqrt(sum(part * part for part in parts)), model.weights.tolist()
    return [sum(part * row[move] for part, row in zip(parts, rows, strict=True)) / length for move in range(len(MOVES))]


if __name__ == "__main__":
    from bench.run import main

    sys.exit(main(["simulator"]))
