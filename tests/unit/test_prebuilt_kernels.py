"""What the runtime image compiles beforehand is all that roles will call, with the types that they call it with."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from fleet.contexts.grid import Grid
from fleet.functions import kriging_kernel
from fleet.functions.belief import Belief
from fleet.planning import kernel as planning
from fleet.planning import outlook_kernel as outlook
from fleet.planning.outlook import Outlook
from fleet.planning.rehearsal import rehearse
from fleet.planning.tactics import InterestWeights, Tactics
from fleet.simulator import kernel as simulator
from tests.conftest import ROOT
from tests.kernels import digests
from tests.planning import ENERGY, drawn, environment

KERNELS = ROOT / "containers/runtime/kernel"
PREBUILD = "from compile_kernel import use_once; use_once()"
USE = "from tests.unit.test_prebuilt_kernels import use; use()"


def use() -> None:
    """Fly in state groups, make maps, and fly as planned; prints the programs that were used and not found."""
    digests()
    rehearse(environment(drawn(1)), ENERGY, 2, Tactics(), 0)
    # Read-only arrays are of another type: records and models that are read from storage may be such.
    values = drawn(2)
    values.flags.writeable = False
    rehearse(environment(values), ENERGY, 1, Tactics(), 0)
    large = Belief(Grid(np.ones((90, 70), dtype=np.bool_)))
    large.observe(np.arange(20), np.arange(20.0))
    Outlook(large, 3).richest(7, InterestWeights())
    programs = {
        f"{module.__name__.removeprefix('fleet.')}.{name}": each
        for module in (simulator, kriging_kernel, planning, outlook)
        for name, each in vars(module).items()
        if hasattr(each, "stats") and each.__module__ == module.__name__
    }
    misses = {name: sum(each.stats.cache_misses.values()) for name, each in programs.items()}
    hits = {name for name, each in programs.items() if each.stats.cache_hits}
    print(sorted(hits), sorted(name for name, count in misses.items() if count))  # noqa: T201 - the test reads it


def said(program: str, cache: Path) -> str:
    path = os.pathsep.join(map(str, (ROOT, ROOT / "operator", KERNELS)))
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout.strip()


def test_all_that_flights_and_maps_call_is_found_prebuilt(tmp_path: Path) -> None:
    assert said(PREBUILD, tmp_path) == ""
    kriging = ["class_probabilities", "observe", "predict_changed", "search", "solve"]
    programs = [f"functions.kriging_kernel.{name}" for name in kriging]
    programs += ["planning.kernel.search"]
    programs += [f"planning.outlook_kernel.{name}" for name in ("look", "promising", "richest", "sureness")]
    programs += ["simulator.kernel.fly", "simulator.kernel.rank"]
    assert said(USE, tmp_path) == f"{programs} []"
