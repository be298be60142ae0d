"""Compiled programs, what numba keeps of them, and their plain form."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.compiled import program
from fleet.functions import kriging_kernel
from fleet.planning import kernel as planning
from fleet.reached import stamp_of
from fleet.simulator import bits, kernel
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


PARTS = {
    "constants.py": "ROW = (1.0, {constant})\nOTHER = 5.0\n",
    "parts.py": """
from fleet.compiled import part
import constants

@part
def raised(number):
    return number + {added}
""",
    "programs.py": """
import numpy as np
import constants
from constants import ROW
from fleet.compiled import part, program
from parts import raised

@program
def total(pair):
    return scaled(pair.first[0]) + 100.0 * pair.second[0] + constants.OTHER

@part
def scaled(number):
    return raised(ROW[1] * number)
""",
    "arguments.py": """
from typing import NamedTuple
import numpy as np

class Pair(NamedTuple):
    {fields[0]}: np.ndarray
    {fields[1]}: np.ndarray
""",
    "main.py": """
import numpy as np
from arguments import Pair
from programs import total

print(total(Pair(np.ones(1), np.full(1, 3.0))), sum(total.stats.cache_hits.values()))
""",
}


def totalled(folder: Path, constant: float = 2.0, added: int = 10, fields: str = "first second", note: str = "") -> str:
    """As `said`, of a program that reaches constants, parts and fields in other files."""
    for name, text in PARTS.items():
        filled = text.format(constant=constant, added=added, fields=fields.split())
        (folder / name).write_text(filled + (note if name != "programs.py" else ""))
    path = os.pathsep.join([str(folder), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-B", str(folder / "main.py")]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_code_is_compiled_anew_when_something_in_another_file_changes_and_only_then(tmp_path: Path) -> None:
    assert totalled(tmp_path) == "317.0 0"
    assert totalled(tmp_path) == "317.0 1"
    assert totalled(tmp_path, note="# nothing that counts\nUNUSED = 3\n") == "317.0 1"
    assert totalled(tmp_path, constant=4.0) == "319.0 0"
    assert totalled(tmp_path, added=20) == "327.0 0"
    assert totalled(tmp_path, fields="second first") == "121.0 0"
    assert totalled(tmp_path, fields="second first") == "121.0 1"


@pytest.mark.parametrize(
    ("module", "program", "name", "value"),
    [
        (kriging_kernel, "solve", "NEAR_ONE", 1.5),
        (kriging_kernel, "solve", "LEAST_PIVOT", 0.1),
        (kriging_kernel, "solve", "NEIGHBOURS", 4),
        (kriging_kernel, "observe", "TILE", 8),
        (kriging_kernel, "class_probabilities", "_NORMAL", np.zeros(3)),
        (kernel, "fly", "WORD_BITS", 32),
        (kernel, "fly", "_MIX_2", np.uint64(7)),
        (kernel, "fly", "_trailing_zeros", bits.leading_zeros),
        (planning, "search", "_int", np.int32),
    ],
)
def test_what_our_programs_reach_is_in_their_stamp(
    module: Any, program: str, name: str, value: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    function = getattr(module, program).py_func
    before = stamp_of(function)
    assert stamp_of(function) == before
    monkeypatch.setattr(module, name, value)
    assert stamp_of(function) != before


def test_stamps_are_the_same_in_every_process() -> None:
    shown = (
        "from fleet.reached import stamp_of; from fleet.simulator import kernel; print(stamp_of(kernel.fly.py_func))"
    )
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", shown]
        found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()
        assert found == stamp_of(kernel.fly.py_func)  # type: ignore[attr-defined]  # of numba


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
