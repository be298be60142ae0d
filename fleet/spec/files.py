"""Whether what a FleetSpec names is on the disk: folders of contexts, Python functions, models, profiles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from urllib.parse import unquote, urlsplit

from fleet.spec.findings import Finding, did_you_mean, listed
from fleet.spec.functions import FunctionSpec
from fleet.spec.resources import Fleet, FleetSpec
from fleet.spec.rules import SPEC
from fleet.spec.source import Parameters, SourceError, find_module, read_source
from fleet.spec.yaml_text import Path

MAP_TAKES = "the observation"
EVAL_TAKES = "the feature space and the metrics"
SUBSETS_TAKES = "the agents' names"


def missing_files(spec: FleetSpec, folder: FilePath) -> list[Finding]:
    """Everything that a FleetSpec names and that is not there.

    Args:
        folder: The folder of the FleetSpec; relative names start here.
    """
    fleet = spec.spec
    return [*_contexts(fleet, folder), *_functions(fleet, folder), *_named_files(fleet, folder)]


def local_path(uri: str, folder: FilePath) -> FilePath | None:
    """The file or folder that an address means; None when it is not on this machine's disk."""
    parts = urlsplit(uri)
    if parts.scheme == "file" and parts.netloc in {"", "localhost"}:
        return FilePath(unquote(parts.path))
    return None if parts.scheme else folder / uri


def _contexts(fleet: Fleet, folder: FilePath) -> Iterator[Finding]:
    importing = "`fleet context import` makes a context of a CSV file"
    for index, context in enumerate(fleet.contexts):
        here = (*SPEC, "contexts", index, "uri")
        path = local_path(context.uri, folder)
        if path is None or (path / "context.yaml").is_file():
            continue
        if path.is_dir():
            yield Finding(here, f"the folder {context.uri} has no context.yaml, so it is not a context", importing)
        elif path.exists():
            yield Finding(here, f"{context.uri} is a file, and a context is a folder", importing)
        else:
            yield Finding(here, f"there is no folder {context.uri}", _neighbours(path))


def _neighbours(path: FilePath) -> str:
    """What is there instead, in the folder where it should be."""
    around = path.parent
    names = []
    if around.is_dir():
        names = sorted(entry.name for entry in around.iterdir() if (entry / "context.yaml").is_file())
    start = "names are relative to the folder of the FleetSpec"
    return did_you_mean(path.name, names, f"there is {listed(names[:8], 'and')}; {start}" if names else start)


def _functions(fleet: Fleet, folder: FilePath) -> Iterator[Finding]:
    yield from _user_function(fleet.map, (*SPEC, "map", "function"), folder, (1, MAP_TAKES))
    yield from _user_function(fleet.eval, (*SPEC, "eval", "function"), folder, (2, EVAL_TAKES))
    if fleet.aggregation.function:
        here = (*SPEC, "aggregation", "function")
        yield from _reference(fleet.aggregation.function, here, folder, (1, SUBSETS_TAKES))


def _user_function(spec: FunctionSpec, here: Path, folder: FilePath, takes: tuple[int, str]) -> Iterator[Finding]:
    if spec.function:
        yield from _reference(spec.function, here, folder, takes)


def _reference(reference: str, here: Path, folder: FilePath, takes: tuple[int, str]) -> Iterator[Finding]:
    """What is wrong with the Python function that `module:function` means; the module is read, not run."""
    module, _, name = reference.partition(":")
    path = find_module(module, folder)
    if path is None:
        wanted = f"{module.replace('.', '/')}.py"
        there = [entry.stem for entry in sorted(folder.glob("*.py"))]
        hint = did_you_mean(module, there, f"write {wanted}, or correct the name")
        yield Finding(here, f"there is no module {module}: {wanted} is not beside the FleetSpec", hint)
        return
    try:
        source = read_source(path)
    except SourceError as error:
        yield Finding(here, str(error), "correct the module")
        return
    if name not in source.names:
        if not source.complete:
            return
        defined = [defined for defined in source.names if not defined.startswith("_")]
        hint = did_you_mean(
            name, defined, f"it defines {listed(defined[:8], 'and')}" if defined else "it defines nothing"
        )
        yield Finding(here, f"{path.name} does not define {name}", hint)
        return
    yield from _signature(source.names[name], here, f"{name} in {path.name}", takes)


def _signature(parameters: Parameters | None, here: Path, what: str, takes: tuple[int, str]) -> Iterator[Finding]:
    count, meaning = takes
    if parameters is None:
        return
    if parameters.asynchronous:
        yield Finding(here, f"{what} is asynchronous, and is called as a plain function", "remove `async`")
    elif not parameters.accepts(count):
        wanted = "one argument" if count == 1 else f"{count} arguments"
        yield Finding(here, f"{what} cannot be called with {wanted}", f"it is called with {meaning}")


def _named_files(fleet: Fleet, folder: FilePath) -> Iterator[Finding]:
    if fleet.sa.pretrained:
        path = local_path(fleet.sa.pretrained, folder)
        if path is not None and not path.is_file():
            hint = "write the address of a saved model, or remove the line to train one"
            yield Finding((*SPEC, "sa", "pretrained"), f"there is no file {fleet.sa.pretrained}", hint)
    profiles = (
        ((*SPEC, "agents", "energyProfile"), fleet.agents.energy_profile),
        ((*SPEC, "workflow", "edgeProfile"), fleet.workflow.edge_profile),
    )
    for here, reference in profiles:
        name, hash_sign, _ = reference.partition("#")
        if hash_sign and not (folder / name).is_file():
            yield Finding(here, f"there is no file {name}", "write path/to/profiles.yaml#name, or a built-in profile")
