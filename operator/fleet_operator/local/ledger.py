"""run.json: what a run is, so that it can be gone on with, and what it took."""

from __future__ import annotations

import datetime
import fcntl
import os
import platform
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from pydantic import Field, ValidationError

import fleet
from fleet.errors import ExitCode, FleetError, ObjectNotFound
from fleet.spec.base import Model
from fleet.spec.resources import FleetSpec
from fleet_operator.local.application import Application, spec_identity

FILE = "run.json"
LOGS = "logs"
VOLUMES = "volumes"
STORAGE = "storage"
_LOCK = ".lock"
_PACKAGES = ("numpy", "numba", "scipy", "scikit-optimize", "opencv-python-headless", "pyarrow", "pydantic")


class RunState(StrEnum):
    """How a run stands."""

    RUNNING = "Running"
    FINISHED = "Finished"
    INTERRUPTED = "Interrupted"
    FAILED = "Failed"


class PhaseTime(Model):
    """Wall time of one phase, over all starts of the run."""

    name: str
    seconds: float


class RunDocument(Model):
    """run.json."""

    fleet: str
    storage_uri: str
    seed: int
    missions: int
    state: RunState
    identity: dict[str, str] = Field(description="Hashes of all that the results depend on.")
    contexts: dict[str, str] = Field(description="Folders that replaced the address of a context.")
    versions: dict[str, str]
    started: str = Field(description="First start of the run, UTC.")
    ended: str = Field("", description="Last end of the run, UTC; empty while it runs.")
    starts: int = Field(1, description="How often the run was started.")
    phases: tuple[PhaseTime, ...] = ()
    peak_memory_bytes: int = Field(0, description="Most memory (PSS) of all processes together.")
    message: str = Field("", description="Why it failed, when it did.")


class OtherRun(FleetError):
    """The folder or the storage has the run of something else; going on would mix the two."""

    exit_code = ExitCode.USAGE


class Ledger:
    """Keeps run.json up to date.

    Args:
        application: Whose run.
        identity: What the results depend on.
    """

    def __init__(self, application: Application, identity: dict[str, str]) -> None:
        self._file = application.out / FILE
        before = read_document(application.out)
        self._seconds = {} if before is None else {phase.name: phase.seconds for phase in before.phases}
        self.document = RunDocument(
            fleet=f"{application.spec.metadata.namespace}/{application.spec.name}",
            storage_uri=application.storage.uri,
            seed=application.fleet.missions.seed,
            missions=application.fleet.missions.count,
            state=RunState.RUNNING,
            identity=identity,
            contexts={name: str(folder.absolute()) for name, folder in sorted(application.overrides.items())},
            versions=versions(),
            started=now() if before is None else before.started,
            starts=1 if before is None else before.starts + 1,
            peak_memory_bytes=0 if before is None else before.peak_memory_bytes,
        )
        self._write()

    def add(self, phase: str, seconds: float, peak_memory_bytes: int) -> None:
        """Account for a phase, or a part of one."""
        self._seconds[phase] = self._seconds.get(phase, 0.0) + seconds
        phases = tuple(PhaseTime(name=name, seconds=round(spent, 3)) for name, spent in self._seconds.items())
        peak = max(peak_memory_bytes, self.document.peak_memory_bytes)
        self.document = self.document.model_copy(update={"phases": phases, "peak_memory_bytes": peak})
        self._write()

    def end(self, state: RunState, message: str = "") -> None:
        """The run ends for now."""
        self.document = self.document.model_copy(update={"state": state, "ended": now(), "message": message})
        self._write()

    def _write(self) -> None:
        temporary = self._file.with_suffix(".new")
        temporary.write_text(self.document.model_dump_json(by_alias=True, indent=1) + "\n")
        temporary.replace(self._file)


def read_document(out: Path) -> RunDocument | None:
    """run.json of a folder; None when there is none, or it is not readable."""
    try:
        return RunDocument.model_validate_json((out / FILE).read_bytes())
    except (OSError, ValidationError):
        return None


@contextmanager
def only_run(out: Path) -> Iterator[None]:
    """Hold a folder for one run.

    Raises:
        OtherRun: another run is in it now.
    """
    out.mkdir(parents=True, exist_ok=True)
    with (out / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OtherRun(f"another `fleet run` works in {out} now; wait for it, or choose another --out") from error
        yield


def check_same(application: Application, identity: dict[str, str]) -> None:
    """Refuse to go on with the run of something else.

    Raises:
        OtherRun: names what differs and what to do.
    """
    before = read_document(application.out)
    known = {} if before is None else dict(before.identity)
    try:
        stored = application.storage.read(application.paths.fleet_spec)
        known = {**known, **spec_identity(FleetSpec.model_validate_json(stored))}
    except (ObjectNotFound, ValidationError):  # never written, or by another version: it is written anew
        pass
    compared = known if _only_trained(application) else {**known, **identity}
    different = [name for name in compared if known and known.get(name) != identity.get(name)]
    if different:
        where = application.out if before is not None else application.storage.uri
        raise OtherRun(
            f"{where} has a run that differs in {', '.join(different)}; "
            "choose another folder with --out, or remove that run with --fresh"
        )


def forget_lessons(application: Application) -> None:
    """Remove the reward and the model that `fleet shape` and `fleet train` left: there is no word of what they are of.

    The trainer goes on from their checkpoints, which have all of it when functions and contexts are the same.
    """
    if _only_trained(application):
        for path in (application.paths.reward, application.paths.initial_model):
            application.storage.delete(path)


def _only_trained(application: Application) -> bool:
    """Whether there is neither run.json nor a mission: functions and contexts of an earlier start are not known."""
    missions = f"{application.paths.root}/missions"
    return read_document(application.out) is None and not application.storage.list(missions)


def remove_run(application: Application) -> None:
    """Remove a run and everything that it has in storage; nothing else in the folder is touched."""
    application.storage.delete(application.paths.root)
    if read_document(application.out) is None:
        return
    for folder in (LOGS, VOLUMES, STORAGE):
        shutil.rmtree(application.out / folder, ignore_errors=True)
    (application.out / FILE).unlink(missing_ok=True)


def versions() -> dict[str, str]:
    """Versions of what the results depend on."""
    found = {"fleet": fleet.__version__, "python": platform.python_version(), "system": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return {**found, "cores": str(len(os.sched_getaffinity(0)))}


def now() -> str:
    """The time in UTC, to the second."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
