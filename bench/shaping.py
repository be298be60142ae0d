"""Does reward shaping find better parameters than random search and than another optimiser, and what does it cost?

    python -m bench.shaping [--seeds 20] [--cases 2018-06-01/0.8 ...] [--arms ours random ...] [--short]

Feature weights, T_u and T_v are shaped on one date of the corn field, as the example does: 48 parameter sets in batches
of 4, each judged by training SA with 256 missions and flying one. Every search has the same number of evaluations, and
for one seed the same random numbers in all trials. Rivals: uniformly random sets, and Optuna's TPE (multivariate, with
the constant liar, as its authors advise for batches), which is the optimiser most used for budgets of this size; CMA-ES
would spend 48 evaluations on five generations. Optuna comes with the extra `dev`, for this
benchmark only.

Further arms take our parts away: T_u in the paper's range, [0, number of features]; losses that jump where a goal is
missed; scikit-optimize's own optimiser in place of ours, which fits and looks for improvement with its library.

Printed: the least loss found after 24 and 48 sets, paired differences to ours with 95 % intervals (`bench.statistics`),
how many sets met the goal, and the optimiser's own share of the wall time.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bench.measure import Result
from bench.statistics import paired
from fleet.cli import inputs
from fleet.learning.bayes import Dimension, Optimiser, Point
from fleet.learning.reward import Normaliser
from fleet.learning.run import references
from fleet.learning.shaping import Problem, evaluate, optimiser_of, parameters
from fleet.randomness import named_seed
from fleet.spec.functions import ContextUse
from fleet.spec.resources import Fleet
from fleet.storage.open import open_storage

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "crop-scouting" / "in-state-groups.yaml"
WITH_JUMP = ", told losses that jump at the goal"
OUT = Path(__file__).resolve().parent / "out" / "shaping.json"
CASES = ("2018-06-01/0.8", "2018-09-16/0.8")
OURS, RANDOM, TPE, SKOPT = "ours", "random", "Optuna TPE", "scikit-optimize as it comes"


class Search(Protocol):
    """Looks for the least loss in batches."""

    def ask(self, count: int) -> list[Point]:
        """The next points."""
        ...

    def tell(self, points: Sequence[Point], guides: Sequence[float]) -> None:
        """What became of them: losses without their jump where a goal is missed."""
        ...


class RandomSearch:
    """Every parameter by chance, uniformly in the optimiser's own ranges and scales."""

    def __init__(self, dimensions: Sequence[Dimension], seed: int) -> None:
        self._optimiser = Optimiser(dimensions, seed)
        self._generator = np.random.default_rng(seed)

    def ask(self, count: int) -> list[Point]:
        free = sum(not dimension.fixed for dimension in self._optimiser.dimensions)
        return [self._optimiser.point_at(place) for place in self._generator.random((count, free))]

    def tell(self, points: Sequence[Point], guides: Sequence[float]) -> None:
        """Nothing is learned."""


class Tpe:
    """Optuna's tree-structured Parzen estimator over the same ranges and scales."""

    def __init__(self, dimensions: Sequence[Dimension], seed: int) -> None:
        import optuna  # noqa: PLC0415 - only this benchmark needs it

        optuna.logging.set_verbosity(optuna.logging.ERROR)
        sampler = optuna.samplers.TPESampler(seed=seed % 2**31, multivariate=True, constant_liar=True)
        self._dimensions = dimensions
        self._study = optuna.create_study(sampler=sampler)
        self._open: list[Any] = []

    def ask(self, count: int) -> list[Point]:
        self._open = [self._study.ask() for _ in range(count)]
        return [tuple(self._value(trial, dimension) for dimension in self._dimensions) for trial in self._open]

    def tell(self, points: Sequence[Point], guides: Sequence[float]) -> None:
        for trial, guide in zip(self._open, guides, strict=True):
            self._study.tell(trial, guide)

    @staticmethod
    def _value(trial: Any, dimension: Dimension) -> float:
        if dimension.integer:
            return int(trial.suggest_int(dimension.name, int(dimension.low), int(dimension.high)))
        return float(trial.suggest_float(dimension.name, dimension.low, dimension.high, log=dimension.logarithmic))


class Skopt:
    """scikit-optimize as it comes: ask with its own constant liar, fit at every tell."""

    def __init__(self, dimensions: Sequence[Dimension], seed: int) -> None:
        import skopt  # noqa: PLC0415 - loads for a second

        real, integer = skopt.space.Real, skopt.space.Integer
        ranges = [
            integer(int(d.low), int(d.high)) if d.integer
            else real(d.low, d.high, prior="log-uniform" if d.logarithmic else "uniform")
            for d in dimensions
        ]  # fmt: skip
        initial = 2 * len(dimensions)
        self._optimiser = skopt.Optimizer(
            ranges, "GP", acq_func="EI", n_initial_points=initial, random_state=seed % 2**31
        )

    def ask(self, count: int) -> list[Point]:
        return [tuple(point) for point in self._optimiser.ask(n_points=count, strategy="cl_min")]

    def tell(self, points: Sequence[Point], guides: Sequence[float]) -> None:
        self._optimiser.tell([list(point) for point in points], list(guides))


class PaperRange:
    """A search with T_u itself in [0, number of features], not a share of what a group can give."""

    def __init__(self, problem: Problem, make: Callable[[Sequence[Dimension]], Search]) -> None:
        *weights, _, visited = dimensions_of(problem)
        groups = problem.fleet.state_space.groups
        self._cells = groups.rows * groups.columns
        self._search = make((*weights, Dimension("T_u", 0.0, float(len(weights))), visited))
        self._open: list[Point] = []

    def ask(self, count: int) -> list[Point]:
        self._open = self._search.ask(count)
        return [self._share(point) for point in self._open]

    def tell(self, points: Sequence[Point], guides: Sequence[float]) -> None:
        self._search.tell(self._open, guides)

    def _share(self, point: Point) -> Point:
        *weights, utility, visited = point
        return (*weights, utility / max(sum(weights) * self._cells, 1e-9), visited)


def dimensions_of(problem: Problem) -> tuple[Dimension, ...]:
    """What is shaped."""
    return parameters(problem.fleet, problem.grounds.features)


Maker = Callable[[Problem, int], Search]
RIVALS: dict[str, Maker] = {
    OURS: lambda problem, seed: optimiser_of(dimensions_of(problem), problem.fleet, [], 0, seed),
    RANDOM: lambda problem, seed: RandomSearch(dimensions_of(problem), seed),
    TPE: lambda problem, seed: Tpe(dimensions_of(problem), seed),
    SKOPT: lambda problem, seed: Skopt(dimensions_of(problem), seed),
    "random, T_u in [0, F]": lambda problem, seed: PaperRange(problem, lambda ranges: RandomSearch(ranges, seed)),
    f"ours{WITH_JUMP}": lambda problem, seed: optimiser_of(dimensions_of(problem), problem.fleet, [], 0, seed),
    "ours, T_u in [0, F]": lambda problem, seed: PaperRange(problem, lambda ranges: Optimiser(ranges, seed, 16)),
}


@dataclass(frozen=True)
class Found:
    """What a search came to.

    Args:
        half, whole: Least loss after half of the evaluations, and after all.
        met: Share of the sets that met the goal.
        overhead: Share of the wall time that the search itself took.
    """

    half: float
    whole: float
    met: float
    overhead: float


def problem_of(case: str) -> Problem:
    """The example's problem of shaping on a date with a goal, written date/goal."""
    date, goal = case.split("/")
    spec = inputs.read_spec(EXAMPLE)
    document = spec.spec.model_dump(by_alias=True, mode="json", exclude_none=True)
    name = f"field-{date}"
    document["stateSpace"]["context"] = name
    for context in document["contexts"]:
        context["use"] = ["Shaping"] if context["name"] == name else ["Training"]
    document["goals"][0]["atLeast"] = float(goal)
    fleet = Fleet.model_validate(document)
    spec = spec.model_copy(update={"spec": fleet})
    bench = inputs.open_bench(spec, EXAMPLE, open_storage(inputs.cache_uri(EXAMPLE)), {}, None)
    grounds = bench.grounds(ContextUse.SHAPING)
    normaliser = Normaliser.over([terrain.ssv for terrain in grounds.terrains])
    return Problem(fleet, grounds, normaliser, references(fleet, grounds), 0, None)


def look(problem: Problem, name: str, seed: int) -> Found:
    """One search by its name; the seed fixes the search and what the trials are flown with."""
    settings = problem.fleet.reward_shaping
    problem = replace(problem, seed=named_seed(seed, "shaping/trial"))
    losses: list[float] = []
    start, own_s = time.perf_counter(), 0.0
    search = RIVALS[name](problem, seed)
    while len(losses) < settings.epochs:
        before = time.perf_counter()
        points = search.ask(min(settings.batch, settings.epochs - len(losses)))
        own_s += time.perf_counter() - before
        new = [evaluate(problem, (0, point)) for point in points]
        before = time.perf_counter()
        told = [trial.loss if name.endswith(WITH_JUMP) else trial.guide for trial in new]
        search.tell(points, told)
        own_s += time.perf_counter() - before
        losses += [trial.loss for trial in new]
    overhead = own_s / (time.perf_counter() - start)
    met = float(np.mean(np.array(losses) < 1.0))
    return Found(min(losses[: len(losses) // 2]), min(losses), met, overhead)


def report(title: str, searches: dict[str, list[Found]]) -> None:
    """Print the searches of a case, or of all of them."""
    print(f"== {title}: {len(searches[OURS])} searches each")
    for name, found in searches.items():
        whole, ours_whole = (np.array([each.whole for each in searches[key]]) for key in (name, OURS))
        half, ours_half = (np.array([each.half for each in searches[key]]) for key in (name, OURS))
        met, overhead = np.mean([each.met for each in found]), np.mean([each.overhead for each in found])
        print(
            f"{name:24} after half {half.mean():.4f}, after all {whole.mean():.4f}; more than ours: after half "
            f"{paired(half, ours_half)}, after all {paired(whole, ours_whole)}, worse for "
            f"{np.mean(whole > ours_whole):.0%}; goal met {met:.0%}; own share of the time {overhead:.0%}",
            flush=True,
        )


def measure(cases: Sequence[str], names: Sequence[str], seeds: int) -> dict[str, dict[str, list[Found]]]:
    """All searches over all cases, printed; by case, then by name."""
    results: dict[str, dict[str, list[Found]]] = {}
    for case in cases:
        problem = problem_of(case)
        evaluate(problem, (0, RIVALS[RANDOM](problem, 0).ask(1)[0]))  # compiles what is compiled once
        results[case] = {name: [] for name in names}
        for seed in range(seeds):
            for name in names:
                results[case][name].append(look(problem, name, seed))
        report(case, results[case])
    report("all", {name: [each for case in cases for each in results[case][name]] for name in names})
    return results


def run() -> list[Result]:
    """The short form: the first case, three seeds, ours against random search and TPE."""
    found = measure(CASES[:1], (OURS, RANDOM, TPE), seeds=3)[CASES[0]]
    best = {name: float(np.mean([each.whole for each in searches])) for name, searches in found.items()}
    command = f"python -m bench.shaping --seeds 3 --cases {CASES[0]} --arms"
    results = [
        Result.against("loss of shaping", best[OURS], "loss", (name, best[name]), f"{command} '{OURS}' '{name}'")
        for name in (RANDOM, TPE)
    ]
    share = float(np.mean([each.overhead for each in found[OURS]]))
    return [
        *results,
        Result("the optimiser's share of the time of shaping", share, "share", command=f"{command} {OURS}"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--cases", nargs="+", default=CASES)
    parser.add_argument("--arms", nargs="+", default=list(RIVALS), choices=list(RIVALS))
    parser.add_argument("--short", action="store_true")
    arguments = parser.parse_args()
    if arguments.short:
        run()
        return
    found = measure(arguments.cases, list(dict.fromkeys([OURS, *arguments.arms])), arguments.seeds)
    OUT.parent.mkdir(exist_ok=True)
    document = {
        case: {name: [asdict(each) for each in all_] for name, all_ in arms.items()} for case, arms in found.items()
    }
    OUT.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
