"""How functions are compiled to machine code: the one door to numba.

Import it late, in what computes: numba takes a quarter of a second to load, and most roles never need it.

With NUMBA_DISABLE_JIT=1 in the environment everything here runs as plain Python, a few hundred times slower: for
debuggers, and to see which lines of a kernel the tests reach.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.extending import intrinsic

from fleet.reached import fields_in, stamp_of

_F = TypeVar("_F", bound=Callable[..., Any])
_PLAIN = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]  # set from the environment


def program(function: _F) -> _F:
    """Compile an entry of a kernel; the machine code is kept in numba's cache where that can be written.

    Arrays belong to the caller, so nothing here counts references to them (`_nrt`): a count is an atomic operation and
    costs more than a step. So a program cannot make arrays, and is given all that it fills.
    """
    if _PLAIN:
        return _as_machine_code_counts(function)
    options: dict[str, Any] = {"nogil": True, "_nrt": False}
    try:
        compiled = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # neither the package's folder nor the user's cache can be written: each process compiles
        return cast(_F, numba.njit(**options)(function))
    _know_what_is_reached(compiled._cache, function)
    return cast(_F, compiled)


def part(function: _F) -> _F:
    """Make a function a part of the programs that call it: a real call would pass its state through memory."""
    return cast(_F, numba.njit(inline="always")(function))


def instruction(plain: _F) -> Callable[[Callable[..., Any]], _F]:
    """Make a generator of processor instructions callable from a kernel.

    Args:
        plain: What the instructions do, in Python.
    """
    return lambda function: plain if _PLAIN else cast(_F, intrinsic(function))


def _as_machine_code_counts(function: _F) -> _F:
    """Whole numbers that grow too large begin anew, without a word, as those of machine code do."""

    @functools.wraps(function)
    def counting(*arguments: Any) -> Any:
        with np.errstate(over="ignore"):
            return function(*arguments)

    return cast(_F, counting)


def _know_what_is_reached(cache: Any, function: Callable[..., Any]) -> None:
    """Let the machine code that is kept be good only for the parts and the constants that it was made from.

    numba itself looks at the program's own file alone, and takes named tuples with the same types for the same. It also
    reads the types of arguments, tuples' classes among them by name, before it looks whether the code is of this source
    at all: a list that cannot be read, because a class has another name by now, is an empty one.
    """
    file, read, key_of = cache._cache_file, cache._cache_file._load_index, cache._index_key
    own = file._source_stamp

    def read_or_none() -> Any:
        file._source_stamp = (own, stamp_of(function))  # at the first call: parts may stand below their program
        try:
            return read()
        except (AttributeError, ImportError):
            return {}

    file._load_index = read_or_none
    cache._index_key = lambda signature, codegen: (*key_of(signature, codegen), fields_in(signature))
