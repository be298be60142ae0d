from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT

HEAVY = ("skopt", "sklearn", "scipy", "torch", "stable_baselines3", "numba", "gymnasium", "matplotlib")


@pytest.mark.parametrize("module", ["models", "blend", "experience", "reward", "goals"])
def test_what_an_agent_flies_with_loads_nothing_heavy(module: str) -> None:
    program = f"import sys, fleet.learning.{module}; print([name for name in {HEAVY} if name in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("role", "heavy"),
    [
        ("sensor", (*HEAVY, "cv2", "typer", "fleet.learning", "fleet.simulator")),
        ("workflow", (*HEAVY, "cv2", "pyarrow", "uvicorn")),
        ("aggregator", (*HEAVY, "cv2", "pyarrow", "uvicorn", "httpx")),
        ("trainer", ("torch", "stable_baselines3", "gymnasium", "matplotlib", "uvicorn")),
    ],
)
def test_a_role_loads_only_what_it_needs(role: str, heavy: tuple[str, ...]) -> None:
    program = f"import sys, fleet.runtime.{role}; print([name for name in {heavy} if name in sys.modules])"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
