"""What a Python module defines, read from its text: the module is never run."""

from __future__ import annotations

import ast
import importlib.util
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path


class SourceError(ValueError):
    """A module cannot be read as Python."""


@dataclass(frozen=True)
class Parameters:
    """How a function may be called.

    Args:
        least: Positional arguments that it must have.
        most: Positional arguments that it may have; None for any number.
        named: Whether there are arguments without default that can only be given by name.
        asynchronous: Whether it is an `async def`.
    """

    least: int
    most: int | None
    named: bool
    asynchronous: bool

    def accepts(self, count: int) -> bool:
        """Whether a call with so many positional arguments is possible."""
        return not self.named and self.least <= count and (self.most is None or count <= self.most)


@dataclass(frozen=True)
class Source:
    """Names of a module.

    Args:
        names: What it defines; with parameters where they are known: for functions without decorators.
        complete: Whether these are all names (`from x import *` may bring more).
    """

    names: Mapping[str, Parameters | None]
    complete: bool


def find_module(name: str, folder: Path) -> Path | None:
    """The file of a module beside a FleetSpec, or of an installed package; None when there is none."""
    parts = name.split(".")
    local = _module_file(folder, parts)
    if local is not None:
        return local
    try:
        # Only the first part is looked up: to look up `a.b`, Python would run `a`.
        package = importlib.util.find_spec(parts[0])
    except (ImportError, ValueError):
        return None
    if package is None:
        return None
    if len(parts) == 1:
        return Path(package.origin) if package.has_location and package.origin else None
    places = (_module_file(Path(place), parts[1:]) for place in package.submodule_search_locations or ())
    return next((place for place in places if place is not None), None)


def _module_file(folder: Path, parts: list[str]) -> Path | None:
    stem = folder.joinpath(*parts)
    candidates = (stem.with_name(f"{stem.name}.py"), stem / "__init__.py")
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def read_source(path: Path) -> Source:
    """The names that a module defines.

    Raises:
        SourceError: it is not Python; names the line.
    """
    try:
        tree = ast.parse(path.read_bytes(), filename=path.name)
    except SyntaxError as error:
        raise SourceError(f"{path.name}, line {error.lineno}: {error.msg}") from error
    except (ValueError, OSError, RecursionError) as error:
        raise SourceError(f"{path.name} cannot be read as Python: {error}") from error
    names: dict[str, Parameters | None] = {}
    for statement in _statements(tree.body):
        names.update(_defined(statement))
    return Source({name: names[name] for name in names if name != "*"}, "*" not in names)


def _statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements of a module, also those inside of `if`, `try`, `with`, `for`; not those inside of functions."""
    for statement in body:
        yield statement
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        for inner in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(statement, inner, []))
        for handler in getattr(statement, "handlers", []):
            yield from _statements(handler.body)


def _defined(statement: ast.stmt) -> dict[str, Parameters | None]:
    match statement:
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            return {statement.name: None if statement.decorator_list else _parameters(statement)}
        case ast.ClassDef():
            return {statement.name: None}
        case ast.Import():
            return {(alias.asname or alias.name.partition(".")[0]): None for alias in statement.names}
        case ast.ImportFrom():
            return {(alias.asname or alias.name): None for alias in statement.names}
        case ast.Assign() | ast.AnnAssign() | ast.For() | ast.With():
            stored = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
            return {node.id: None for node in stored if isinstance(node.ctx, ast.Store)}
        case _:
            return {}


def _parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Parameters:
    arguments = function.args
    positional = len(arguments.posonlyargs) + len(arguments.args)
    return Parameters(
        least=positional - len(arguments.defaults),
        most=None if arguments.vararg else positional,
        named=any(default is None for default in arguments.kw_defaults),
        asynchronous=isinstance(function, ast.AsyncFunctionDef),
    )
