"""`fleet simulate` for agents that plan."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from fleet.cli import console, inputs
from fleet.cli.simulate import Flights, Simulated, Wanted
from fleet.errors import ObjectNotFound, Problem, SpecError

if TYPE_CHECKING:
    from fleet.learning.planned_missions import PlannedMission
    from fleet.learning.workbench import Workbench
    from fleet.simulator.terrain import Terrain


def fly_planner(bench: Workbench, terrain: Terrain, wanted: Wanted) -> Simulated:
    """Agents without a start take off somewhere else in their parts in each mission."""
    from fleet.learning.planned_missions import evaluated, spent
    from fleet.planning.scouting import Scout
    from fleet.planning.swarm import scattered
    from fleet.randomness import named_seed

    if wanted.exploration is not None:
        problem = Problem("--exploration", "a Planner makes no random moves", "leave it out")
        raise SpecError([problem], "the command line")
    text, mission = _planner(bench, terrain, wanted)
    names, metrics, spent_s = [agent.name for agent in bench.agents], [], 0.0
    steps = decisions = 0
    with console.progress("missions") as advance:
        for number in range(wanted.missions):
            scouts = scattered(terrain.environment.grid, len(names), named_seed(wanted.seed, f"simulate/{number}"))
            starts = zip(scouts, bench.agents, terrain.layout.starts, strict=True)
            scouts = [scout if agent.start is None else Scout(start) for scout, agent, start in starts]
            started = time.perf_counter()
            swarm = mission.fly(terrain, scouts)
            spent_s += time.perf_counter() - started
            counts = [trace.odometer.counts for trace in swarm.traces]
            steps, decisions = steps + sum(c.steps for c in counts), decisions + sum(c.decisions for c in counts)
            metrics.append(evaluated(bench.evaluator, terrain, swarm.captured, spent(swarm, names)).metrics)
            advance(number + 1, wanted.missions)
    facts = {**mission.interest.model_dump(), "caution": mission.planner.caution, "seed": wanted.seed}
    return Simulated(text, facts, Flights(metrics, steps, decisions, steps / max(spent_s, 1e-9)))


def _planner(bench: Workbench, terrain: Terrain, wanted: Wanted) -> tuple[str, PlannedMission]:
    """What agents that plan fly with, and what that is for the user."""
    from fleet.learning.planned_missions import PlannedMission
    from fleet.learning.planner import load_planner
    from fleet.learning.rehearsals import planner_reward
    from fleet.learning.reward import RewardModel
    from fleet.storage.open import open_storage

    planner = planner_reward(wanted.spec.spec, terrain.features, terrain.environment.truth_name)
    text, data = "Planner, not trained", wanted.model.read_bytes() if wanted.model else b""
    if wanted.storage is not None:
        place, paths = open_storage(inputs.as_uri(wanted.storage)), inputs.paths_of(wanted.spec)
        try:
            shaped = RewardModel.model_validate_json(place.read(paths.reward)).of_planner
            planner = shaped.model_copy(update={"goal": planner.goal})
            data = data or place.read(paths.initial_model)
        except ObjectNotFound as error:
            hint = "run fleet train SPEC --out DIR first, and name its storage: DIR/storage"
            raise SpecError([Problem("--storage", str(error), hint)], "the command line") from error
    if not data:
        return text, PlannedMission(planner, planner.weights, bench.energy)
    return "Planner, trained", PlannedMission(planner, load_planner(data, terrain.features).interest, bench.energy)
