"""Compiled programs and what numba keeps of them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT

ARGUMENTS = """
from typing import NamedTuple
import numpy as np

class {name}(NamedTuple):
    values: np.ndarray
"""
PROGRAM = """
from fleet.compiled import program

@program
def total(numbers):
    return numbers.values.sum()
"""
MAIN = """
import numpy as np
from arguments import {name}
from programs import total

print(total({name}(np.ones(3))), sum(total.stats.cache_hits.values()))
"""


def said(folder: Path, name: str) -> str:
    """Sum, and how often code was found in the cache, of a process whose tuple has a name."""
    (folder / "arguments.py").write_text(ARGUMENTS.format(name=name))
    path = os.pathsep.join([str(folder), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-B", "-c", MAIN.format(name=name)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_code_is_kept_and_compiled_anew_when_the_class_of_an_argument_has_another_name(tmp_path: Path) -> None:
    (tmp_path / "programs.py").write_text(PROGRAM)
    assert said(tmp_path, "First") == "3.0 0"
    assert said(tmp_path, "First") == "3.0 1"
    assert said(tmp_path, "Second") == "3.0 0"
    assert said(tmp_path, "Second") == "3.0 1"
