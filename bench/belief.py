"""Milliseconds for a judged mission, for a map, and for a decision's belief; each beside the plain form in numpy.

    python -m bench.run belief

A judged mission is what Eval() of examples/crop-scouting computes of one: map by kriging, likely classes, metrics. Its
field is the corn field of that example (first date), or one made up when it is not there, with random cells captured.
Other fields are made up: smooth noise on square grids. A belief's update takes some new random cells in; 20 % of the
cells are captured, and the covariance stays. The plain form makes the map from scratch. A decision's belief is an
update and the probability of every class in every cell. What decisions take in flight, with all fits, has figures too,
and so have compiled flights that keep no belief and predict a few cells a step. Compiling is warm-up, and what it costs
when the machine code is in numba's cache is the last figure.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from bench.measure import Result, seconds
from fleet.compiled import program
from fleet.contexts.base import Environment
from fleet.contexts.grid import Grid
from fleet.contexts.load import load_cube
from fleet.functions import compiled_kriging, kriging, local_kriging
from fleet.functions.belief import Belief
from fleet.functions.classes import class_mean, class_probabilities, expected_accuracy, likely_values
from fleet.functions.contract import AgentMetrics, FeatureSpace, Metrics
from fleet.functions.evaluation import evaluation_metrics
from fleet.functions.kriging import Prediction, fit, krige, places_of, predict
from fleet.functions.kriging_kernel import expect, look
from fleet.storage.local import LocalStorage

COMMAND = "python -m bench.run belief"
ROOT = Path(__file__).resolve().parent.parent
FIELD = ROOT / "examples" / "crop-scouting" / "contexts" / "2018-06-01"
PLAIN = "numpy"
SHARE = 0.2
Values = NDArray[np.float64]

FIRST_USE = """
import time
import numpy as np
from fleet.contexts.grid import Grid
from fleet.functions import kriging
values = np.where(np.random.default_rng(0).random((56, 44)) < 0.2, np.random.default_rng(1).random((56, 44)), np.nan)
grid = Grid(np.ones((56, 44), dtype=bool))
kriging.krige(values, grid)
start = time.perf_counter()
kriging.prepare_for_many()
kriging.krige(values, grid)
print(time.perf_counter() - start)
"""


def run() -> list[Result]:
    kriging.prepare_for_many()
    return [
        *(judged_mission(share) for share in (0.1, 0.2, 0.4)),
        *(whole_map(cells) for cells in (2_000, 10_000, 100_000, 1_000_000)),
        *(result for cells in (2_000, 10_000, 100_000, 1_000_000) for new in (1, 10) for result in updates(cells, new)),
        *flight(10_000),
        *(steps_that_ask(cells) for cells in (1, 4, 8)),
        first_use(),
    ]


def judged_mission(share: float) -> Result:
    environment = corn() or made_up(2_106)
    assert environment.truth is not None
    states = random_cells(environment.grid, np.random.default_rng(0))
    states = np.sort(states[: round(share * len(states))])
    fs = FeatureSpace(("exg",), states, environment.truth.reshape(-1)[states][:, None], environment)
    fast = seconds(lambda: judge(fs), repeats=50)
    with in_numpy():
        plain = seconds(lambda: judge(fs), repeats=10)
    cells = np.count_nonzero(environment.grid.valid)
    return beside(f"a judged mission, {environment.name}, {cells:,} cells, {share:.0%} captured", fast, plain)


def judge(fs: FeatureSpace) -> dict[str, float]:
    prediction = krige(fs.grid_of("exg"), fs.environment.grid)
    mean = class_mean(prediction.values, fs.environment)
    metrics = evaluation_metrics(likely_values(prediction, mean), fs, Metrics((AgentMetrics("agent-1"),)))
    return {**metrics, **expected_accuracy(prediction, mean)}


def whole_map(cells: int) -> Result:
    environment = made_up(cells)
    values = np.full(environment.grid.valid.shape, np.nan)
    captured = random_cells(environment.grid, np.random.default_rng(0))[: round(SHARE * cells)]
    values.flat[captured] = environment.truth.flat[captured]  # type: ignore[union-attr]  # it is made up
    repeats = 20 if cells <= 100_000 else 2
    fast = seconds(lambda: krige(values, environment.grid), repeats)
    with in_numpy():
        plain = seconds(lambda: krige(values, environment.grid), repeats // 2)
    return beside(f"a map of {environment.grid.cells:,} cells, {SHARE:.0%} captured", fast, plain)


def updates(cells: int, new: int) -> list[Result]:
    """Medians, as each update is another."""
    environment = made_up(cells)
    grid, truth = environment.grid, environment.truth
    assert truth is not None
    order = random_cells(grid, np.random.default_rng(0))
    start = round(SHARE * cells)
    known = np.isin(np.arange(grid.cells), order[:start]).reshape(grid.valid.shape)
    belief = Belief(grid, fit(np.where(known, truth, np.nan), known, grid))
    belief.observe(order[:start], truth.flat[order[:start]])
    belief.class_probabilities()
    gc.collect()
    taken = []
    for at in range(start, start + new * (50 if cells <= 10_000 else 10), new):
        fresh = order[at : at + new]
        begun = time.perf_counter()
        belief.observe(fresh, truth.flat[fresh])
        observed = time.perf_counter()
        belief.class_probabilities()
        taken.append((observed - begun, time.perf_counter() - begun))
    known.flat[order[: start + new]] = True
    fast = np.median(taken, axis=0)
    plain = plainly(belief, known, environment)
    name = f"belief of {grid.cells:,} cells, {new} new"
    return [beside(name, float(fast[0]), plain[0]), beside(f"{name}, with classes", float(fast[1]), plain[1])]


def plainly(belief: Belief, known: NDArray[np.bool_], environment: Environment) -> tuple[float, float]:
    """Seconds for the map from scratch in numpy, and for it and the probabilities."""
    repeats = 5 if environment.grid.cells <= 100_000 else 1
    with in_numpy():
        map_ = from_scratch(belief, known, environment)
        predicting = seconds(lambda: from_scratch(belief, known, environment), repeats, warm_up=0)
    classing = seconds(lambda: class_probabilities(map_, float(np.nanmean(map_.values))), repeats, warm_up=0)
    return predicting, predicting + classing


def from_scratch(belief: Belief, known: NDArray[np.bool_], environment: Environment) -> Prediction:
    assert environment.truth is not None
    wanted = environment.grid.valid & ~known
    map_ = Prediction(np.where(known, environment.truth, np.nan), np.where(environment.grid.valid, 0.0, np.nan))
    found = predict(map_.values, known, wanted, environment.grid, belief.variogram)
    map_.values[wanted], map_.deviation[wanted] = found
    return map_


def flight(cells: int) -> list[Result]:
    """All decisions of a flight over 40 % of a field, a new cell each, with a fit whenever there is much more.

    Each decision takes the least of three flights' times, for the computer has other things to do.
    """
    taken = np.min([decisions(made_up(cells)) for _ in range(3)], axis=0)
    name = f"belief in flight, {cells:,} cells, 1 new a decision, to 40 %"
    figures = {"mean": np.mean(taken), "99 %": np.quantile(taken, 0.99), "longest": np.max(taken)}
    return [Result(f"{name}: {of}", float(figure) * 1e3, "ms", command=COMMAND) for of, figure in figures.items()]


def decisions(environment: Environment) -> list[float]:
    """Seconds of each."""
    grid, truth = environment.grid, environment.truth
    assert truth is not None
    belief, taken = Belief(grid), []
    gc.collect()
    for cell in random_cells(grid, np.random.default_rng(0))[: round(0.4 * grid.cells)]:
        start = time.perf_counter()
        belief.observe([cell], [truth.flat[cell]])
        belief.class_probabilities()
        taken.append(time.perf_counter() - start)
    return taken


def steps_that_ask(asked: int) -> Result:
    """Steps a second of a compiled flight that captures random cells, and predicts the next few cells of each alone."""
    environment = corn() or made_up(2_106)
    grid, truth = environment.grid, environment.truth
    assert truth is not None
    order = random_cells(grid, np.random.default_rng(0))[: round(0.4 * np.count_nonzero(grid.valid))]
    known = np.zeros(grid.valid.shape, dtype=bool)
    known.flat[order] = True
    variogram = fit(np.where(known, truth, np.nan), known, grid)
    steps, places = compiled_kriging.steps_for(grid), places_of(grid, variogram)

    def flying() -> float:
        captured = compiled_kriging.with_margin(np.zeros_like(known), steps)
        room = (np.empty(8, dtype=np.int32), compiled_kriging.scratch_for(8))
        return ask(order, captured, steps, (truth.reshape(-1), places), (asked, grid.columns, room))

    some, target = np.where(known, truth, np.nan), np.zeros_like(known)
    target.flat[np.flatnonzero(grid.valid & ~known)[:asked]] = True
    with in_numpy():
        plain = 1 / seconds(lambda: predict(some, known, target, grid, variogram), repeats=20)
    name = f"compiled steps that predict {asked} cells each, {environment.name}"
    return Result.against(name, len(order) / seconds(flying), "steps/s", (PLAIN, plain), COMMAND)


@program
def ask(order: Any, captured: Any, steps: Any, known: Any, how: Any) -> Any:
    """The sum of all that was predicted."""
    asked, columns, (near, scratch) = how
    flat, width, total = captured.reshape(-1), captured.shape[1], 0.0
    for index in range(len(order)):
        for target in range(order[index], min(order[index] + asked + 1, len(known[0]))):
            corner = (target // columns + steps.margin[0]) * width + target % columns + steps.margin[1]
            if target == order[index]:
                flat[corner] = 1
            elif flat[corner] == 0:
                found, _ = look(flat, corner, target, steps, 0, near)
                expected, share = expect(near, found, target, known, scratch)
                total += expected + share
    return total


def first_use() -> Result:
    """Least of three processes; the first of all may have to compile."""
    command = [sys.executable, "-c", FIRST_USE]
    taken = [float(subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout) for _ in range(4)]
    return Result("the first map by the compiled form, its code in the cache", min(taken) * 1e3, "ms", command=COMMAND)


def beside(name: str, fast: float, plain: float) -> Result:
    return Result.against(name, fast * 1e3, "ms", (PLAIN, plain * 1e3), COMMAND)


@contextmanager
def in_numpy() -> Iterator[None]:
    """All maps by the form in numpy."""
    form: Callable[[int], object] = kriging._form
    kriging._form = lambda cells: local_kriging
    try:
        yield
    finally:
        kriging._form = form  # type: ignore[assignment]  # what it was


def corn() -> Environment | None:
    return load_cube(LocalStorage(FIELD)).environment if FIELD.is_dir() else None


def made_up(cells: int) -> Environment:
    """Smooth noise on a square grid of about so many cells."""
    side = round(cells**0.5)
    noise = np.random.default_rng(5).normal(size=(side, side))
    truth = 100.0 + 60.0 * gaussian_filter(noise, 2.0) + 3.0 * noise
    return Environment("a made-up field", "", Grid(np.ones_like(truth, dtype=bool), 11.9, 8.9), "exg", truth)


def random_cells(grid: Grid, generator: np.random.Generator) -> NDArray[np.int64]:
    """All cells with data, in random order."""
    return generator.permutation(np.flatnonzero(grid.valid))
