"""Which extrapolation is better, and how long does it take: neighbour mean or kriging?

    python bench/extrapolation.py [--seeds N] [--json FILE]

Fields: the corn cube's three dates and the Gartner yield on a 10 m grid, from the shared data (FLEET_DATA).
Samples: random cells, and a random 3x3-group walk: the same number of neighbouring cells in every 3x3 group, as the
platform's agents capture them. Accuracy and error are over all cells with data, captured ones too.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from bench.scouting.fields import AIMED, field  # noqa: E402  # runs from a checkout too
from fleet.contexts.base import Environment  # noqa: E402
from fleet.contexts.grid import Grid  # noqa: E402
from fleet.functions.classes import class_mean, likely_values  # noqa: E402
from fleet.functions.evaluation import truth_metrics  # noqa: E402
from fleet.functions.extrapolation import Extrapolation, extrapolate  # noqa: E402
from fleet.functions.kriging import prepare_for_many  # noqa: E402

COMMAND = "python bench/extrapolation.py"
SHARES = (0.05, 0.15, 0.25, 0.40)
NM, KR, LIKELY = "neighbour mean", "kriging", "kriging, likely class"
Values = NDArray[np.float64]
Sample = Callable[[Grid, float, np.random.Generator], NDArray[np.bool_]]


def neighbours(values: Values, environment: Environment) -> Values:
    return extrapolate(values, environment.grid, Extrapolation.NEIGHBOUR_MEAN).values


def kriging(values: Values, environment: Environment) -> Values:
    return extrapolate(values, environment.grid, Extrapolation.KRIGING).values


def likely(values: Values, environment: Environment) -> Values:
    prediction = extrapolate(values, environment.grid, Extrapolation.KRIGING)
    return likely_values(prediction, class_mean(prediction.values, environment))


METHODS: dict[str, Callable[[Values, Environment], Values]] = {NM: neighbours, KR: kriging, LIKELY: likely}


@dataclass(frozen=True)
class Row:
    """Means over the seeds."""

    field: str
    sample: str
    share: float
    accuracy: dict[str, float]
    mae: dict[str, float]
    time_ms: dict[str, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--json", type=Path, help="append the results to this file")
    arguments = parser.parse_args()
    try:
        environments = [field(name).environment for name in AIMED]
    except FileNotFoundError as error:
        sys.exit(str(error))
    prepare_for_many()
    rows = [row for environment in environments for row in compare(environment, arguments.seeds)]
    print_table(rows)
    if arguments.json:
        save(arguments.json, rows)


def compare(environment: Environment, seeds: int) -> Iterator[Row]:
    """Both extrapolations on the same samples."""
    assert environment.truth is not None
    samples: dict[str, Sample] = {"random": random_cells, "groups": group_walks}
    for name, sample in samples.items():
        for share in SHARES:
            measured: dict[str, list[tuple[float, float, float]]] = {how: [] for how in METHODS}
            for seed in range(seeds):
                captured = sample(environment.grid, share, np.random.default_rng(seed))
                values = np.where(captured, environment.truth, np.nan)
                for how, predict in METHODS.items():
                    start = time.perf_counter()
                    predicted = predict(values, environment)
                    took = time.perf_counter() - start
                    found = truth_metrics(predicted, environment)
                    measured[how].append((found["accuracy"], found["mae"], took * 1e3))
            means = {how: np.mean(figures, axis=0) for how, figures in measured.items()}
            columns = [{how: float(mean[i]) for how, mean in means.items()} for i in range(3)]
            yield Row(environment.name, name, share, *columns)


def random_cells(grid: Grid, share: float, generator: np.random.Generator) -> NDArray[np.bool_]:
    cells = np.flatnonzero(grid.valid)
    captured = np.zeros(grid.cells, dtype=bool)
    captured[generator.choice(cells, max(1, round(share * len(cells))), replace=False)] = True
    return captured.reshape(grid.valid.shape)


def group_walks(grid: Grid, share: float, generator: np.random.Generator) -> NDArray[np.bool_]:
    """In each 3x3 group a random walk over neighbouring cells, 9 x share cells long on average."""
    captured = np.zeros(grid.valid.shape, dtype=bool)
    for top in range(0, grid.rows, 3):
        for left in range(0, grid.columns, 3):
            window = grid.valid[top : top + 3, left : left + 3]
            wanted = int(9 * share + generator.random())
            walk(window, wanted, generator, captured[top : top + 3, left : left + 3])
    if not captured.any():
        captured[tuple(np.argwhere(grid.valid)[0])] = True
    return captured


def walk(window: NDArray[np.bool_], wanted: int, generator: np.random.Generator, captured: NDArray[np.bool_]) -> None:
    places = np.argwhere(window)
    if not len(places) or not wanted:
        return
    row, column = places[generator.integers(len(places))]
    captured[row, column] = True
    for _ in range(wanted - 1):
        beside = [
            place
            for place in places
            if abs(place[0] - row) + abs(place[1] - column) == 1 and not captured[tuple(place)]
        ]
        if not beside:
            return
        row, column = beside[generator.integers(len(beside))]
        captured[row, column] = True


def print_table(rows: list[Row]) -> None:
    print(f"{'':30}|    accuracy, %     |   mean abs. error   |      time, ms")
    print(f"{'field':12}{'sample':9}{'cells':>8} |" + "    nm    kr likely |" * 2 + "    nm    kr likely")
    for row in rows:
        print(f"{row.field:12}{row.sample:9}{row.share:8.0%} |" + figures(row))
    for sample in ("random", "groups"):
        for share in SHARES:
            some = [row for row in rows if row.sample == sample and row.share == share]
            print(f"{'mean':12}{sample:9}{share:8.0%} |" + figures(mean(some)))
    print(f"{'mean':12}{'':9}{'':8} |" + figures(mean(rows)))


def figures(row: Row) -> str:
    accuracy = "".join(f"{row.accuracy[how] * 100:6.1f}" for how in METHODS)
    mae = "".join(f"{row.mae[how]:6.2f}" for how in METHODS)
    return f"{accuracy}  |{mae}  |" + "".join(f"{row.time_ms[how]:6.1f}" for how in METHODS)


def mean(rows: list[Row]) -> Row:
    def over(part: Callable[[Row], dict[str, float]]) -> dict[str, float]:
        return {how: float(np.mean([part(row)[how] for row in rows])) for how in METHODS}

    return Row("mean", "", 0, over(lambda r: r.accuracy), over(lambda r: r.mae), over(lambda r: r.time_ms))


def save(path: Path, rows: list[Row]) -> None:
    """Append to a list of name, value, unit, peer, peer_value, ratio, command."""
    before = json.loads(path.read_text()) if path.exists() else []
    for sample in ("random", "groups"):
        for share in SHARES:
            some = mean([row for row in rows if row.sample == sample and row.share == share])
            for what, unit, part in (("accuracy", "1", some.accuracy), ("time", "ms", some.time_ms)):
                before.append(
                    {
                        "name": f"kriging {what}, {sample} {share:.0%} of cells, mean of 4 fields",
                        "value": part[LIKELY],
                        "unit": unit,
                        "peer": NM,
                        "peer_value": part[NM],
                        "ratio": part[LIKELY] / part[NM],
                        "command": COMMAND,
                    }
                )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(before, indent=2) + "\n")


if __name__ == "__main__":
    main()
