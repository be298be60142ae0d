"""Compiles the kernel for the image, by flying with it once; leaves an empty folder where that cannot be done."""

import os
import re
import sys
import tempfile
from pathlib import Path

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


def fly_once() -> None:
    """One mission over a small field; what is in the arrays does not matter, only their types."""
    import numpy as np  # noqa: PLC0415 - numba reads its settings when it is imported

    from fleet.contexts.grid import Grid  # noqa: PLC0415 - same
    from fleet.missions.layout import plan_layout  # noqa: PLC0415 - same
    from fleet.simulator.batch import Batch, fly  # noqa: PLC0415 - same
    from fleet.spec.resources import Fleet  # noqa: PLC0415 - same

    fleet = Fleet.model_validate(DOCUMENT)
    grid = Grid(np.ones((6, 6), dtype=np.bool_))
    layout = plan_layout(grid, fleet.state_space, fleet.agents.resolved)
    none, one = np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.int64)
    batch = Batch(
        scores=np.zeros((1, grid.cells, 8)),
        table=np.zeros((1, 1), dtype=np.int64),
        rewards=np.zeros((1, grid.cells)),
        reward_of=none,
        utility_thresholds=np.ones(1),
        visited_thresholds=one,
        exploration=np.zeros(1),
        missions=none,
    )
    fly(layout, batch)


def main() -> int:
    """Compile, and keep the files with addresses wiped out."""
    target = Path(FOLDER)
    target.mkdir()
    if not able():
        sys.stderr.write("the kernel is not compiled with the image: this processor is not of the right kind\n")
        return 0
    with tempfile.TemporaryDirectory() as cache:
        os.environ.update(SETTINGS, NUMBA_CACHE_DIR=cache)
        fly_once()
        for path in sorted(Path(cache).glob("*/kernel.*")):
            content = ADDRESS.sub(lambda found: b" at 0x" + b"0" * len(found[1]) + b">", path.read_bytes())
            (target / path.name).write_bytes(content)
    return 0 if any(target.iterdir()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
