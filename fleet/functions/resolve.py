"""From `module:function` to the Python function, with errors that say what to mend; and its version."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import inspect
import sys
import sysconfig
from collections.abc import Callable, Set
from pathlib import Path
from types import ModuleType
from typing import Any

from fleet.errors import CallSite, FunctionError
from fleet.functions.compose import ComposedMap

EXTRACTOR_VERSION = "1"
"""Changes whenever a built-in extractor may answer another value for the same picture."""
_PYTHONS = frozenset(
    Path(path).resolve()
    for name, path in sysconfig.get_paths().items()
    if name in ("stdlib", "platstdlib", "purelib", "platlib")
)
"""Folders of Python itself and of installed packages."""
_OWN = Path(__file__).resolve().parents[1]


def resolve(reference: str) -> Callable[..., Any]:
    """Import the function that `module:function` names; the module is looked for on sys.path.

    Raises:
        FunctionError: there is no such module or function, it is not a function, or its module raises on import.
    """
    site = CallSite(reference)
    module_name, _, name = reference.partition(":")
    if not module_name or not name:
        raise FunctionError("is not a reference to a function; write `module:function`", site)
    module = _import(module_name, site)
    function = getattr(module, name, None)
    if function is None:
        raise FunctionError(f"module {module_name} has no {name!r}{_close(name, module)}", site)
    if not callable(function):
        raise FunctionError(f"{name!r} is a {type(function).__name__}, not a function", site)
    return function  # type: ignore[no-any-return]  # getattr of a module is untyped; callable() is all that is known


def version_of(function: Callable[..., Any]) -> str:
    """A hash that changes when the answers of a Python function may change.

    It covers the source of the function's module, of its extractors' modules, and of what these import from the same
    folder, and the version of the built-in extractors; 16 hexadecimal digits.
    """
    parts = _parts(function)
    digest = hashlib.sha256(f"extractors {EXTRACTOR_VERSION}\n".encode())
    names = [f"{getattr(part, '__module__', '')}.{getattr(part, '__qualname__', '')}" for part in parts]
    digest.update("\n".join(names).encode())
    files: set[Path] = set()
    for part in parts:
        _gather(inspect.getmodule(part), None, files)
    for path in sorted(files):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _parts(function: Callable[..., Any]) -> tuple[Callable[..., Any], ...]:
    """The functions that a Map() is composed of; the function itself when it is not composed."""
    if not isinstance(function, ComposedMap):
        return (function,)
    return tuple(part for extractor in function.extractors for part in _parts(extractor))


def _import(module_name: str, site: CallSite) -> ModuleType:
    try:
        return importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name and (module_name == error.name or module_name.startswith(f"{error.name}.")):
            raise FunctionError(f"there is no module {error.name!r}; looked in {_places()}", site) from error
        raise FunctionError(
            f"module {module_name} imports {error.name!r}, which is not installed; install it, "
            "or use an image that has it",
            site,
        ) from error
    except (Exception, SystemExit) as error:  # the module is the user's: its import may raise anything, and may exit
        raise FunctionError(
            f"module {module_name} raised {type(error).__name__} on import{_line(error)}: {error}", site
        ) from error


def _places() -> str:
    """The folders of sys.path that are the user's: neither Python's own nor installed packages."""
    folders = [Path(entry or ".").resolve() for entry in sys.path]
    mine = [str(folder) for folder in folders if folder.is_dir() and not _within(folder, _PYTHONS)]
    return ", ".join(dict.fromkeys(mine)) or "no folder but Python's own; set PYTHONPATH to the function's folder"


def _close(name: str, module: ModuleType) -> str:
    names = [known for known, value in vars(module).items() if callable(value) and not known.startswith("_")]
    close = difflib.get_close_matches(name, names, n=3)
    if close:
        return f"; did you mean {' or '.join(close)}?"
    own = [known for known in names if getattr(getattr(module, known), "__module__", "") == module.__name__]
    return f"; it has {', '.join(own)}" if own else "; it has no functions"


def _line(error: BaseException) -> str:
    """Where in the user's module an exception arose."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if isinstance(error, SyntaxError):
        return f" at line {error.lineno} of {Path(error.filename or '?').name}"
    if trace is None:
        return ""
    return f" at line {trace.tb_lineno} of {Path(trace.tb_frame.f_code.co_filename).name}"


def _gather(module: ModuleType | None, folder: Path | None, found: set[Path]) -> None:
    """Add the source of a module and, if they are beside or below it, of the modules that it uses."""
    file = getattr(module, "__file__", None)
    if module is None or file is None or not file.endswith(".py"):
        return
    path = Path(file).resolve()
    folder = folder or path.parent
    if path in found or folder not in path.parents or not is_users(path):
        return
    found.add(path)
    for value in list(vars(module).values()):
        used = value if isinstance(value, ModuleType) else sys.modules.get(getattr(value, "__module__", None) or "")
        _gather(used, folder, found)


def is_users(path: Path) -> bool:
    """Whether a source file is the user's: of this library, of Python and of installed packages it is not."""
    path = path.resolve()
    return path.is_file() and not _within(path, {*_PYTHONS, _OWN})


def _within(path: Path, folders: Set[Path]) -> bool:
    return any(folder == path or folder in path.parents for folder in folders)
