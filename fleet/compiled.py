"""How functions are compiled to machine code: the one door to numba.

Import it late, in what computes: numba takes a quarter of a second to load, and most roles never need it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.extending import intrinsic

_F = TypeVar("_F", bound=Callable[..., Any])


def program(function: _F) -> _F:
    """Compile an entry of a kernel; the machine code is kept in numba's cache where that can be written.

    Arrays belong to the caller, so nothing here counts references to them (`_nrt`): a count is an atomic operation and
    costs more than a step. So a program cannot make arrays, and is given all that it fills.
    """
    options: dict[str, Any] = {"nogil": True, "_nrt": False}
    try:
        return cast(_F, numba.njit(cache=True, **options)(function))
    except RuntimeError:  # neither the package's folder nor the user's cache can be written: each process compiles
        return cast(_F, numba.njit(**options)(function))


def part(function: _F) -> _F:
    """Make a function a part of the programs that call it: a real call would pass its state through memory."""
    return cast(_F, numba.njit(inline="always")(function))


def instruction(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a generator of processor instructions callable from a kernel."""
    return cast(Callable[..., Any], intrinsic(function))
