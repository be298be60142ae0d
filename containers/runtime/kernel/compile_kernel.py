"""Compiles the kernels for the image, by using each once; leaves an empty folder where that cannot be done."""

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from kernel_settings import FOLDER, SETTINGS, able

ADDRESS = re.compile(rb" at 0x([0-9a-f]+)>")
"""Of Python's objects, in comments beside the machine code; different in each process."""

DOCUMENT = {
    "agents": {"count": 1},
    "stateSpace": {"context": "field"},
    "map": {"function": "none:none"},
    "eval": {"function": "none:none"},
    "contexts": [{"name": "field", "uri": "field"}],
    "goals": [{"metric": "none", "atLeast": 0.0}],
}


def use_once() -> None:
    """Every program of every kernel on a small field; what is in the arrays does not matter, only their types."""
    import numpy as np  # noqa: PLC0415 - numba reads its settings when it is imported

    from fleet.contexts.grid import Grid  # noqa: PLC0415 - same

    grid = Grid(np.ones((6, 6), dtype=np.bool_))
    fly(grid)
    krige(grid)
    plan(grid)


def fly(grid: Any) -> None:
    """The simulator's kernel: one mission."""
    import numpy as np  # noqa: PLC0415 - same

    from fleet.missions.layout import plan_layout  # noqa: PLC0415 - same
    from fleet.simulator import batch  # noqa: PLC0415 - same
    from fleet.spec.resources import Fleet  # noqa: PLC0415 - same

    fleet = Fleet.model_validate(DOCUMENT)
    layout = plan_layout(grid, fleet.state_space, fleet.agents.resolved)
    none, one = np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64)
    missions = batch.Batch(
        scores=np.zeros((1, grid.cells, 8)),
        table=np.zeros((1, 1), dtype=np.int64),
        rewards=np.zeros((1, grid.cells)),
        reward_of=none,
        utility_thresholds=np.ones(1),
        visited_thresholds=one,
        exploration=np.zeros(1),
        missions=none,
    )
    batch.fly(layout, missions)


def krige(grid: Any) -> None:
    """The kernel of maps and beliefs: a map from scratch, and a belief that follows some captures."""
    import numpy as np  # noqa: PLC0415 - same

    from fleet.functions import compiled_kriging  # noqa: PLC0415 - same
    from fleet.functions.belief import Belief  # noqa: PLC0415 - same

    belief = Belief(grid)
    belief.observe(np.arange(0, 36, 3), np.arange(12.0))
    belief.class_probabilities()
    targets = np.flatnonzero(belief.free).astype(np.int32)
    near = compiled_kriging.nearest(belief.known, targets, grid, 8)
    compiled_kriging.solve(near, targets, belief.state.values, belief.state.places)


def plan(grid: Any) -> None:
    """The kernels of those who plan: a mission, and a look at a field that is too large to be seen whole."""
    import numpy as np  # noqa: PLC0415 - same

    from fleet.contexts.grid import Grid  # noqa: PLC0415 - same
    from fleet.energy.accounting import EnergyModel  # noqa: PLC0415 - same
    from fleet.energy.profiles import load_aircraft, load_edge  # noqa: PLC0415 - same
    from fleet.functions.belief import Belief  # noqa: PLC0415 - same
    from fleet.planning.outlook import Outlook  # noqa: PLC0415 - same
    from fleet.planning.scouting import Scout  # noqa: PLC0415 - same
    from fleet.planning.swarm import Swarm  # noqa: PLC0415 - same
    from fleet.planning.tactics import InterestWeights, Search, Tactics  # noqa: PLC0415 - same

    energy = EnergyModel(load_aircraft("spark-survey"), load_edge("laptop-i5"))
    Swarm(Belief(grid), energy, [Scout(0)], Tactics(search=Search(horizon=2, width=2))).fly(lambda cell: cell % 5.0)
    large = Belief(Grid(np.ones((80, 80), dtype=np.bool_)))
    large.observe(np.arange(12), np.arange(12.0))
    Outlook(large, 2).richest(0, InterestWeights())


def main() -> int:
    """Compile, and keep the files with addresses wiped out, in a folder for each of numba's."""
    target = Path(FOLDER)
    target.mkdir()
    if not able():
        sys.stderr.write("no kernel is compiled with the image: this processor is not of the right kind\n")
        return 0
    with tempfile.TemporaryDirectory() as cache:
        os.environ.update(SETTINGS, NUMBA_CACHE_DIR=cache)
        use_once()
        for path in sorted(Path(cache).glob("*/*kernel.*")):
            content = ADDRESS.sub(lambda found: b" at 0x" + b"0" * len(found[1]) + b">", path.read_bytes())
            kept = target / path.relative_to(cache)
            kept.parent.mkdir(exist_ok=True)
            kept.write_bytes(content)
    return 0 if any(target.iterdir()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
