"""What the user asks for now: the FleetSpec of the cluster with its files, examined without running any of it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fleet.energy.model import energy_model
from fleet.errors import FleetError, Problem, SpecError
from fleet.spec.check import check_files
from fleet.spec.load import parse_fleet_spec
from fleet.spec.resources import FleetSpec
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.compiler.fleet import compile_fleet
from fleet_operator.compiler.settings import Settings
from fleet_operator.compiler.target import Target
from fleet_operator.flow.files import from_config_maps, outside, place
from fleet_operator.flow.reach import Reach
from fleet_operator.flow.sources import read_bundle
from fleet_operator.flow.stored import Flown
from fleet_operator.policy.status import Trouble
from fleet_operator.resources.refs import Manifest

INVALID, FILES_MISSING, STORAGE_TAKEN, CONTEXT_BROKEN = "Invalid", "FilesMissing", "StorageTaken", "ContextBroken"
LASTING = frozenset({INVALID, STORAGE_TAKEN})
"""Refusals that end only when the user does something; files may follow, and contexts may be there again."""
_COMMAND = "fleet files fleetspec.yaml | kubectl apply --server-side -f -"


@dataclass(frozen=True)
class Asked:
    """What is asked for, or why it is refused.

    Args:
        flown: The FleetSpec with its functions; None when it is refused.
        refusal: Why; None when it is not.
    """

    flown: Flown | None = None
    refusal: Trouble | None = None


@dataclass(frozen=True)
class Shelf:
    """Where files beside a FleetSpec may be.

    Args:
        config_maps: Those of the fleet.
        library: Folder with a folder for each fleet that brings no ConfigMaps.
    """

    config_maps: Sequence[Manifest]
    library: Path

    @contextmanager
    def folder(self, fleet: str) -> Iterator[Path]:
        """The files in a folder, as they stand beside the FleetSpec.

        Raises:
            SpecError: the ConfigMaps are damaged.
        """
        if not self.config_maps and (self.library / fleet).is_dir():
            yield self.library / fleet
            return
        files = from_config_maps(self.config_maps)
        with tempfile.TemporaryDirectory(prefix="fleet-files-") as name:
            place(files, Path(name))
            yield Path(name)


def examine(body: Mapping[str, Any], shelf: Shelf, settings: Settings) -> Asked:
    """Everything that can be said of a FleetSpec of the cluster without running it and without its storage."""
    document = {key: value for key, value in body.items() if key != "status"}
    try:
        spec = parse_fleet_spec(document)
    except SpecError as error:
        return refused(INVALID, error)
    problems = outside(spec) + Reach(settings.storage_uri, settings.storage_hosts).problems(spec)
    if problems:
        return refused(INVALID, SpecError(problems))
    try:
        with shelf.folder(spec.name) as folder:
            missing = check_files(spec, folder)
            if missing:
                return refused(FILES_MISSING, SpecError(missing), f"apply the files beside it: {_COMMAND}")
            bundle = read_bundle(spec.spec, folder)
            energy_model(spec.spec, folder)
    except SpecError as error:
        return refused(FILES_MISSING, error)
    return _compiled(spec, bundle, settings)


def refused(reason: str, error: FleetError, advice: str = "") -> Asked:
    """A refusal with everything that is wrong, in one line."""
    problems: Sequence[Problem | FleetError] = error.problems if isinstance(error, SpecError) else [error]
    text = "; ".join(" ".join(str(problem).split()) for problem in problems)
    return Asked(refusal=Trouble(reason, f"{text}. {advice}" if advice else text, reason in LASTING))


def _compiled(spec: FleetSpec, bundle: Bundle, settings: Settings) -> Asked:
    """Whether it can be compiled is known when it is."""
    try:
        compile_fleet(Target(spec, bundle, settings), terms=())
    except SpecError as error:
        return refused(INVALID, error)
    return Asked(Flown(spec, bundle))
