"""`fleet simulate`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fleet.cli import console, inputs
from fleet.errors import ObjectNotFound, Problem, SpecError
from fleet.spec.learning import SAKind

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fleet.learning.reward import RewardModel
    from fleet.learning.workbench import Workbench
    from fleet.simulator.batch import Batch
    from fleet.simulator.terrain import Terrain
    from fleet.spec.resources import FleetSpec

Metrics = Mapping[str, float]


@dataclass(frozen=True)
class Policy:
    """What the simulated agents fly with.

    Args:
        text: What it is, for the user.
        table: Score of each move in each cell, float64 [cells, 8].
        reward: With the thresholds of HA.
        exploration: Share of random moves.
    """

    text: str
    table: NDArray[np.float64]
    reward: RewardModel
    exploration: float


@dataclass(frozen=True)
class Wanted:
    """What the user wants to have simulated."""

    spec: FleetSpec
    missions: int
    seed: int
    exploration: float | None
    storage: str | None
    model: Path | None


@dataclass(frozen=True)
class Flights:
    """What many missions came to.

    Args:
        metrics: Of each mission.
        steps: States visited by all agents of all missions.
        decisions: Those of them in which SA was asked.
        speed: States a second of the flights alone.
    """

    metrics: Sequence[Metrics]
    steps: int
    decisions: int
    speed: float

    @property
    def asked_share(self) -> float:
        """Share of the states in which SA was asked: with a small share, the policy hardly matters."""
        return self.decisions / max(1, self.steps)


@dataclass(frozen=True)
class Simulated:
    """Missions, and what they were flown with.

    Args:
        policy: What the agents flew with, for the user.
        facts: The same in numbers, for machines.
    """

    policy: str
    facts: Mapping[str, float]
    flights: Flights


def simulate(  # noqa: PLR0913, PLR0917 - the options of a command
    spec: Annotated[Path, typer.Argument(metavar="SPEC", help="The FleetSpec, a YAML file.")],
    missions: Annotated[int, typer.Option(min=1, max=100_000, help="How many missions.")] = 32,
    exploration: Annotated[
        float | None, typer.Option(min=0, max=1, help="Share of random moves, in place of the policy's own.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed, in place of the FleetSpec's.")] = None,
    storage: Annotated[
        str | None, typer.Option(help="Folder or address of storage with a trained policy: fly with that.")
    ] = None,
    model: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="A saved SA model, in place of the storage's.")
    ] = None,
    context: Annotated[
        list[str] | None, typer.Option(metavar="NAME=DIR", help="Take another folder for a context.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False,
) -> None:
    """Fly many missions in the simulator and show what Eval() says of them: mean, least and greatest.

    Without --storage or --model the agents fly at random within each state group, and leave it after a third of it:
    what a learned policy has to beat. A Planner flies with its defaults then.

    Example: [bold]fleet simulate my-swarm/fleetspec.yaml --missions 100[/bold]
    """
    from fleet.storage.open import open_storage

    fleet_spec = inputs.read_spec(spec)
    overrides = inputs.read_overrides(context or [])
    cache = open_storage(inputs.cache_uri(spec))
    with console.progress("mapping states") as advance:
        bench = inputs.open_bench(fleet_spec, spec, cache, overrides, advance)
        terrain = bench.terrain(fleet_spec.spec.state_space.context)
    chosen_seed = fleet_spec.spec.missions.seed if seed is None else seed
    wanted = Wanted(fleet_spec, missions, chosen_seed, exploration, storage, model)
    if fleet_spec.spec.sa.kind is SAKind.PLANNER:
        from fleet.cli.simulate_planner import fly_planner

        simulated = fly_planner(bench, terrain, wanted)
    else:
        simulated = _fly_groups(bench, terrain, wanted)
    if as_json:
        console.say_json(_document(fleet_spec, simulated))
    else:
        _show(fleet_spec, simulated)


def _fly_groups(bench: Workbench, terrain: Terrain, wanted: Wanted) -> Simulated:
    policy = _policy(wanted.spec, terrain, wanted.storage, wanted.model)
    share = policy.exploration if wanted.exploration is None else wanted.exploration
    flown_by = Policy(policy.text, policy.table, policy.reward, share)
    facts = {
        "exploration": share,
        "utility_threshold": policy.reward.utility_threshold,
        "visited_threshold": policy.reward.visited_threshold,
        "seed": wanted.seed,
    }
    return Simulated(policy.text, facts, _fly(bench, terrain, flown_by, wanted.missions, wanted.seed))


def _policy(spec: FleetSpec, terrain: Terrain, storage: str | None, model: Path | None) -> Policy:
    from fleet.learning.models import load_model
    from fleet.learning.reward import RewardModel
    from fleet.learning.score_tables import ALONE, score_table
    from fleet.missions.documents import INITIAL
    from fleet.storage.open import open_storage

    quick = _quick_policy(spec, terrain)
    if storage is None and model is None:
        return quick
    reward, data = quick.reward, model.read_bytes() if model else b""
    if storage is not None:
        place, paths = open_storage(inputs.as_uri(storage)), inputs.paths_of(spec)
        try:
            reward = RewardModel.model_validate_json(place.read(paths.reward)).of_groups
            data = data or place.read(paths.initial_model)
        except ObjectNotFound as error:
            hint = "run fleet train SPEC --out DIR first, and name its storage: DIR/storage"
            raise SpecError([Problem("--storage", str(error), hint)], "the command line") from error
    sa = load_model(data, features=terrain.features)
    table = score_table({INITIAL: sa}, ALONE, terrain)
    return Policy(f"{sa.kind.value}, trained", table, reward, spec.spec.sa.flight_exploration)


def _quick_policy(spec: FleetSpec, terrain: Terrain) -> Policy:
    """Random moves; a group is left after a third of its cells, or as the FleetSpec's thresholds say."""
    import numpy as np

    from fleet.learning.reward import Normaliser, RewardModel
    from fleet.learning.score_tables import NEVER
    from fleet.missions.layout import MOVES

    count, ha, groups = len(terrain.features), spec.spec.ha, spec.spec.state_space.groups
    visited = groups.rows * groups.columns // 3 if ha.visited_threshold is None else ha.visited_threshold
    blank = RewardModel(
        features=terrain.features,
        weights=(0.0,) * count,
        normaliser=Normaliser(low=(0.0,) * count, high=(1.0,) * count),
        utility_threshold=0.0,
        visited_threshold=visited,
        loss=0.0,
        goals_met=False,
    )
    # A document has finite numbers only; this one stays in memory.
    utility = NEVER[0] if ha.utility_threshold is None else ha.utility_threshold
    reward = blank.model_copy(update={"utility_threshold": utility})
    return Policy("random moves", np.zeros((len(terrain.ssv), len(MOVES))), reward, exploration=1.0)


def _fly(bench: Workbench, terrain: Terrain, policy: Policy, missions: int, seed: int) -> Flights:
    import numpy as np

    from fleet.learning import score_tables
    from fleet.simulator.batch import fly
    from fleet.simulator.evaluation import evaluate_missions

    def batch_from(first: int, count: int) -> Batch:
        draws = score_tables.Flights(first, count, policy.exploration, seed)
        return score_tables.batch_of(policy.table, policy.reward, terrain, draws)

    names = [agent.name for agent in bench.agents]
    fly(terrain.layout, batch_from(1, 1))  # compiles, or loads what was compiled
    metrics: list[Metrics] = []
    steps, decisions, spent_s = 0, 0, 0.0
    with console.progress("missions") as advance:
        for first in range(1, missions + 1, _CHUNK):
            batch = batch_from(first, min(_CHUNK, missions + 1 - first))
            started = time.perf_counter()
            flown = fly(terrain.layout, batch)
            spent_s += time.perf_counter() - started
            steps, decisions = steps + int(np.sum(flown.steps)), decisions + int(np.sum(flown.decisions))
            metrics += [one.metrics for one in evaluate_missions(terrain, flown, names, bench.energy, bench.evaluator)]
            advance(len(metrics), missions)
    return Flights(metrics, steps, decisions, steps / max(spent_s, 1e-9))


_CHUNK = 16
"""Missions between two moves of the bar; Eval() is what takes time."""


def _summary(metrics: Sequence[Metrics]) -> dict[str, dict[str, float]]:
    import numpy as np

    from fleet.report.measures import ordered

    table = {}
    for name in ordered(key for one in metrics for key in one):
        values = [one[name] for one in metrics if name in one]
        table[name] = {"mean": float(np.mean(values)), "min": min(values), "max": max(values)}
    return table


def _goals_met(spec: FleetSpec, metrics: Sequence[Metrics]) -> int:
    from fleet.missions.documents import judge

    return sum(all(result.met for result in judge(spec.spec.goals, dict(one))) for one in metrics)


def _show(spec: FleetSpec, simulated: Simulated) -> None:
    from fleet.report import measures

    flights, metrics = simulated.flights, simulated.flights.metrics
    console.say(f"{len(metrics)} missions over {spec.spec.state_space.context}, policy: {simulated.policy}")
    rows = [
        (measures.label(name), *(measures.text(name, row[column]) for column in ("mean", "min", "max")))
        for name, row in _summary(metrics).items()
    ]
    console.table(("metric", "mean", "least", "greatest"), rows)
    console.say(f"all goals met in {_goals_met(spec, metrics)} of {len(metrics)} missions")
    plans = spec.spec.sa.kind is SAKind.PLANNER
    elsewhere = "agents went on with their plans" if plans else "HA or the order of groups decided"
    console.say(f"SA was asked in {flights.asked_share:.1%} of the states; elsewhere {elsewhere}")
    console.say(f"{flights.speed:,.0f} agent steps a second, without Eval()")


def _document(spec: FleetSpec, simulated: Simulated) -> dict[str, object]:
    flights = simulated.flights
    return {
        "context": spec.spec.state_space.context,
        "policy": simulated.policy,
        **simulated.facts,
        "missions": len(flights.metrics),
        "goals_met": _goals_met(spec, flights.metrics),
        "metrics": _summary(flights.metrics),
        "asked_share": flights.asked_share,
        "steps_per_second": flights.speed,
    }
