"""Compiled programs, what numba keeps of them, and their plain form."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fleet.compiled import program
from fleet.simulator import bits
from tests.conftest import ROOT
from tests.kernels import digests

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


def test_every_kernel_gives_the_same_bits_as_plain_python() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "operator")])}
    command = [sys.executable, "-W", "error", "-m", "tests.kernels"]
    plain = subprocess.run(
        command, env={**environment, "NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert plain.stdout.strip() == str(digests())


@program
def counted(word: Any, found: Any) -> None:
    found[0], found[1] = bits.trailing_zeros(word), bits.leading_zeros(word)


@given(st.integers(0, 63).flatmap(lambda size: st.integers(0, 2**size)) | st.just(2**64 - 1))
def test_bits_are_counted_by_the_processor_as_in_python(word: int) -> None:
    found = np.zeros(2, dtype=np.int64)
    counted(np.uint64(word), found)
    assert found.tolist() == [bits.zeros_below(word), bits.zeros_above(word)]
