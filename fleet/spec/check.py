"""Everything that can be said of a FleetSpec without running it: `fleet validate` in one function."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fleet.errors import Problem, SpecError
from fleet.spec.doubts import doubts
from fleet.spec.files import missing_files
from fleet.spec.findings import Finding
from fleet.spec.load import Reading, read, read_file
from fleet.spec.repair import empty_fields
from fleet.spec.resources import EdgeNode, FleetSpec, Mission
from fleet.spec.rules import broken_rules
from fleet.spec.yaml_text import Document


@dataclass(frozen=True)
class Examination:
    """What was found in a file.

    Args:
        spec: The FleetSpec; None when there is a problem with it. Files that are missing are problems too, but leave
            the spec.
        problems: What must be changed, in the order of the file.
        warnings: What is allowed and yet probably not meant.
    """

    spec: FleetSpec | None
    problems: tuple[Problem, ...] = ()
    warnings: tuple[Problem, ...] = ()


def check(spec: FleetSpec | Mission | EdgeNode) -> list[Problem]:
    """What is wrong between the parts of a resource; nothing when it was loaded, as loading checks it too."""
    return _problems(broken_rules(spec))


def warnings_of(spec: FleetSpec) -> list[Problem]:
    """What is allowed in a FleetSpec and yet probably not meant."""
    return _problems(doubts(spec))


def check_files(spec: FleetSpec, folder: Path) -> list[Problem]:
    """What a FleetSpec names and is not on the disk: contexts, functions, models, profiles.

    Args:
        folder: The folder of the FleetSpec; relative names start here.
    """
    return _problems(missing_files(spec, folder))


def examine(path: Path) -> Examination:
    """Reads a FleetSpec, and finds everything that is wrong or doubtful. Never raises for what the file says."""
    try:
        document = read_file(path)
    except SpecError as error:
        return Examination(None, error.problems)
    reading = read(FleetSpec, document)
    problems = [*reading.problems]
    warned = [Finding(place, "has no value", "write one, or remove the line") for place in empty_fields(document.value)]
    warned = [finding for finding in warned if not finding.rests_on(reading.broken)]
    if reading.sound is not None:
        problems += _told(missing_files(reading.sound, path.parent), reading)
        warned += [finding for finding in doubts(reading.sound) if not finding.rests_on(reading.broken)]
    found = {problem.path for problem in problems}
    warnings = [problem for problem in _placed(warned, document) if problem.path not in found]
    return Examination(reading.resource, tuple(_in_order(problems)), tuple(_in_order(warnings)))


def _told(findings: list[Finding], reading: Reading[FleetSpec]) -> list[Problem]:
    return _placed([finding for finding in findings if not finding.rests_on(reading.broken)], reading.document)


def _placed(findings: list[Finding], document: Document) -> list[Problem]:
    return [finding.problem(document) for finding in findings]


def _problems(findings: list[Finding]) -> list[Problem]:
    return _placed(findings, Document(None))


def _in_order(problems: list[Problem]) -> list[Problem]:
    return sorted(problems, key=lambda problem: (problem.line, problem))
