"""What a compiled function is made from: the code of all that it calls, and the constants that it uses.

Machine code has these inside, so it is stale when one of them changes, in whatever file that is written.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from types import CodeType, ModuleType
from typing import Any

import numpy as np


def stamp_of(function: Callable[..., Any]) -> str:
    """A digest of a function and all that it reaches by names: the same in every process, wherever its file is."""
    digest = hashlib.blake2b(digest_size=16)
    for said in _function(function, set()):
        digest.update(said.encode())
        digest.update(b"\0")
    return digest.hexdigest()


def fields_in(signature: Any) -> tuple[tuple[str, ...], ...]:
    """The fields of all named tuples among the types of arguments: code that reads a field knows only its number."""
    found: list[tuple[str, ...]] = []
    for kind in signature if isinstance(signature, tuple) else (signature,):
        if hasattr(kind, "fields"):
            found.append(tuple(kind.fields))
        found += fields_in(tuple(getattr(kind, "types", ())))
    return tuple(found)


def _function(function: Callable[..., Any], seen: set[int]) -> Iterator[str]:
    """Its code, the values of its names, and those of the functions among these."""
    if id(function) in seen:
        return
    seen.add(id(function))
    yield from _code(function.__code__)
    yield from _values(function.__defaults__, seen)
    yield from _values(tuple(cell.cell_contents for cell in function.__closure__ or ()), seen)
    names = sorted(_names(function.__code__))
    known = [(name, function.__globals__[name]) for name in names if name in function.__globals__]
    # numpy has no constants of ours, and warns when it is asked for some names.
    modules = [value for _, value in known if isinstance(value, ModuleType) and value is not np]
    known += [(name, getattr(module, name)) for module in modules for name in names if hasattr(module, name)]
    for name, value in known:
        yield name
        yield from _values(value, seen)


def _code(code: CodeType) -> Iterator[str]:
    yield code.co_code.hex()
    yield from code.co_names
    for constant in code.co_consts:
        yield from _code(constant) if isinstance(constant, CodeType) else _values(constant, set())


def _names(code: CodeType) -> set[str]:
    inner = (constant for constant in code.co_consts if isinstance(constant, CodeType))
    return set(code.co_names).union(*(_names(each) for each in inner))


def _values(value: Any, seen: set[int]) -> Iterator[str]:
    """What tells a value from others, or a class of tuples, or a compiled function; modules are looked into by name."""
    compiled = getattr(value, "py_func", None) or getattr(value, "_defn", None)
    if compiled is not None:
        yield from _function(compiled, seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, tuple | list):
        for each in value:
            yield from _values(each, seen)
        yield f"{len(value)} in all"
    elif isinstance(value, frozenset | set):
        yield repr(sorted(map(repr, value)))
    elif isinstance(value, type):
        yield f"{value.__qualname__} {getattr(value, '_fields', ())}"
    elif isinstance(value, int | float | complex | str | bytes | np.generic | None):
        yield repr(value)
