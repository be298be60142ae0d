from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT

HEAVY = ("skopt", "sklearn", "scipy", "torch", "stable_baselines3", "numba", "gymnasium", "matplotlib")


@pytest.mark.parametrize("module", ["models", "blend", "history", "experience", "reward", "goals"])
def test_what_an_agent_flies_with_loads_nothing_heavy(module: str) -> None:
    program = f"import sys, fleet.learning.{module}; print([name for name in {HEAVY} if name in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
