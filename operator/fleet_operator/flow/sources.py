"""Reads the small files beside a FleetSpec that its pods need: the modules of the functions, profiles, a model."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

from fleet.errors import Problem, SpecError
from fleet.spec.resources import Fleet
from fleet_operator.compiler.bundle import Bundle


def read_bundle(fleet: Fleet, folder: Path) -> Bundle:
    """Everything that the FleetSpec names by a path or a module beside it.

    A module brings the modules beside it that it imports; a package brings all its modules. Modules that are
    installed are taken from the image.

    Args:
        folder: Where the FleetSpec is.

    Raises:
        SpecError: a module or file is not there, cannot be parsed, or all together are too large.
    """
    files: dict[str, bytes] = {}
    problems: list[Problem] = []
    for place, module in _modules(fleet):
        problems += _add_module(folder, module, place, files)
    for place, path in _files(fleet):
        problems += _add_file(folder, path, place, files)
    if problems:
        raise SpecError(problems)
    return Bundle(files)


def _modules(fleet: Fleet) -> Iterator[tuple[str, str]]:
    """Where the FleetSpec names functions, and their modules."""
    named = {
        "spec.map.function": fleet.map.function,
        "spec.eval.function": fleet.eval.function,
        "spec.aggregation.function": fleet.aggregation.function,
    }
    for place, reference in named.items():
        if reference is not None:
            yield place, reference.partition(":")[0]


def _files(fleet: Fleet) -> Iterator[tuple[str, str]]:
    """Where the FleetSpec names files beside it, and these."""
    for place, reference in (
        ("spec.agents.energyProfile", fleet.agents.energy_profile),
        ("spec.workflow.edgeProfile", fleet.workflow.edge_profile),
    ):
        path, mark, _ = reference.partition("#")
        if mark:
            yield place, path
    pretrained = fleet.sa.pretrained
    if pretrained is not None and "://" not in pretrained:
        yield "spec.sa.pretrained", pretrained


def _add_module(folder: Path, module: str, place: str, files: dict[str, bytes]) -> list[Problem]:
    top = module.partition(".")[0]
    if not _is_beside(folder, top):
        if _is_installed(top):
            return []
        hint = f"put {top}.py beside the FleetSpec"
        return [Problem(place, f"there is no module {top!r} beside the FleetSpec in {folder}", hint)]
    problems: list[Problem] = []
    waiting = [top]
    while waiting:
        for file in _files_of(folder, waiting.pop()):
            path = file.relative_to(folder).as_posix()
            if path in files:
                continue
            files[path] = file.read_bytes()
            try:
                waiting += [each for each in _imports(files[path], path) if _is_beside(folder, each)]
            except SyntaxError as error:
                problems.append(Problem(place, f"{path}, line {error.lineno}: {error.msg}", "mend the module"))
            except (ValueError, RecursionError, MemoryError) as error:
                problems.append(Problem(place, f"{path} cannot be read as Python: {error}", "mend the module"))
    return problems


def _is_installed(module: str) -> bool:
    """Whether an import finds it; what this process once imported from the folder of another fleet does not count."""
    return any(finder.find_spec(module, None) is not None for finder in sys.meta_path)


def _is_beside(folder: Path, module: str) -> bool:
    return (folder / f"{module}.py").is_file() or (folder / module / "__init__.py").is_file()


def _files_of(folder: Path, module: str) -> list[Path]:
    """The file of a module, or all modules of a package, which goes first as in an import."""
    package = folder / module
    if (package / "__init__.py").is_file():
        return sorted(package.rglob("*.py"))
    return [folder / f"{module}.py"]


def _imports(source: bytes, path: str) -> Iterator[str]:
    """Top-level names of all modules that a module imports; relative imports stay in its package."""
    for node in ast.walk(ast.parse(source, path)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            yield node.module.partition(".")[0]


def _add_file(folder: Path, path: str, place: str, files: dict[str, bytes]) -> list[Problem]:
    file = folder / path
    if Path(path).is_absolute() or ".." in Path(path).parts:
        return [Problem(place, f"{path} is not below the folder of the FleetSpec", "copy it there")]
    try:
        files[Path(path).as_posix()] = file.read_bytes()
    except OSError as error:
        return [Problem(place, f"cannot read {file}: {error.strerror}", "write its path relative to the FleetSpec")]
    return []
