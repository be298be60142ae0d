"""One `fleet run` from start to end: checks, the machine, the missions, the report, and always a clean end."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

from fleet.errors import FleetError
from fleet.missions.documents import GoalResult, MissionEvaluation
from fleet.storage.layout import FleetPaths
from fleet.storage.port import Storage
from fleet_operator.compiler.settings import Ports, Settings
from fleet_operator.compiler.target import Target
from fleet_operator.local import ledger as ledgers
from fleet_operator.local.addresses import AddressError, Addresses, free_ports
from fleet_operator.local.application import Application
from fleet_operator.local.display import Display
from fleet_operator.local.ledger import Ledger, RunDocument, RunState
from fleet_operator.local.machine import Capacity, Machine
from fleet_operator.local.memory import machine_bytes
from fleet_operator.local.observe import Observer
from fleet_operator.local.run import Run
from fleet_operator.policy.shares import Capacity as SharedCapacity

_FIRST_PORTS = (8080, 18080, 28080, 38080)


@dataclass(frozen=True)
class ModelStanding:
    """How useful a model is after the last mission, and what follows for its aggregator."""

    key: str
    usefulness: float | None
    level: int | None


@dataclass(frozen=True)
class Summary:
    """What a run came to.

    Args:
        asked: Missions that the FleetSpec asks for; more than there are evaluations when it is suspended.
        report: The page; None when it could not be written.
    """

    asked: int
    missions: tuple[MissionEvaluation, ...]
    models: tuple[ModelStanding, ...]
    document: RunDocument
    report: Path | None

    @property
    def missed(self) -> tuple[GoalResult, ...]:
        """Goals that the last mission missed."""
        return tuple(goal for goal in self.missions[-1].goals if not goal.met) if self.missions else ()


Reporter = Callable[[Storage, FleetPaths, Path], Path]
"""Writes the report of a run into a folder; the page that was written."""


def draw_report(storage: Storage, paths: FleetPaths, out: Path) -> Path:
    """The report as `fleet report` writes it."""
    from fleet.report.write import write_report  # noqa: PLC0415 - drawing is needed at the end only

    return write_report(storage, paths, out)


def run_fleet(
    application: Application,
    display: Display,
    fresh: bool = False,
    settings: Settings | None = None,
    reporter: Reporter = draw_report,
) -> Summary:
    """Fly all missions of a fleet on this machine, from wherever an earlier start of the same run has got to.

    Args:
        fresh: Remove what an earlier run left.
        settings: What the installation decides; the ports are chosen here.
        reporter: Writes the report when the run has come to an end, good or bad.

    Raises:
        OtherRun: the folder or the storage has the run of something else.
        FleetError: the run cannot go on; what it has reached is in storage.
    """
    with ledgers.only_run(application.out):
        identity = application.identity()
        if fresh:
            ledgers.remove_run(application)
        ledgers.check_same(application, identity)
        ledgers.forget_lessons(application)
        with _own_functions(application.file.parent):
            ledger = Ledger(application, identity)
            return _run(application, ledger, display, settings or Settings(), reporter)


def _run(
    application: Application, ledger: Ledger, display: Display, installed: Settings, reporter: Reporter
) -> Summary:
    report: Path | None = None
    state, message = RunState.INTERRUPTED, ""
    try:
        with _signals_as_exits(), _machine(application.out, display) as (machine, ports):
            settings = replace(installed, ports=ports)
            target = Target(application.spec, application.bundle, settings, application.storage.uri)
            evaluations = Run(application, target, machine, ledger, display).to_the_end()
            models = _standings(application, machine.capacity)
        state = RunState.FINISHED
    except FleetError as error:
        state, message = RunState.FAILED, str(error)
        raise
    finally:
        display.close()
        if state is not RunState.INTERRUPTED:
            report = _report(application, display, reporter)
        ledger.end(state, message)
    return Summary(application.fleet.missions.count, tuple(evaluations), models, ledger.document, report)


@contextmanager
def _machine(out: Path, display: Display) -> Iterator[tuple[Machine, Ports]]:
    addresses = Addresses(os.getpid())
    try:
        ports = _free_ports(addresses)
        capacity = Capacity(len(os.sched_getaffinity(0)), machine_bytes())
        machine = Machine(out, capacity, display.event, addresses)
    except BaseException:
        addresses.close()
        raise
    try:
        yield machine, ports
    finally:
        with _no_signals():
            machine.close()


def _free_ports(addresses: Addresses) -> Ports:
    """The usual ports of a pod, or others when a program of this machine has one of them on all addresses."""
    address = addresses.take()
    try:
        for first in _FIRST_PORTS:
            if free_ports(address, range(first, first + 3)):
                return Ports(first, first + 1, first + 2)
    finally:
        addresses.give_back(address)
    raise AddressError(f"no ports are free on {address}: tried those from {', '.join(map(str, _FIRST_PORTS))}")


@contextmanager
def _own_functions(folder: Path) -> Iterator[None]:
    """A user's own aggregation is asked in this process; it is a module beside the FleetSpec."""
    sys.path.insert(0, str(folder.absolute()))
    try:
        yield
    finally:
        sys.path.remove(str(folder.absolute()))


def _standings(application: Application, capacity: Capacity) -> tuple[ModelStanding, ...]:
    """The models after the last mission that was weighed."""
    observer = Observer(application, SharedCapacity(capacity.cores, capacity.memory_bytes))
    history = observer.history(application.fleet.missions.count + 1)
    if not history:
        return ()
    last = max(history)
    levels: Mapping[str, int] = {each.subset: each.level for each in observer.terms(last)}
    useful = history[last].usefulness
    return tuple(ModelStanding(key, value, levels.get(key)) for key, value in useful.items())


def _report(application: Application, display: Display, reporter: Reporter) -> Path | None:
    """Write the report; None when it cannot be written, which is said, and does not hide what the run came to."""
    display.phase("writing the report")
    try:
        return reporter(application.storage, application.paths, application.out)
    except Exception as error:  # noqa: BLE001 - missions that were flown must not be lost over a drawing
        display.note(f"the report could not be written: {type(error).__name__}: {error}; `fleet report` tries again")
        return None


_ENDING = (signal.SIGTERM, signal.SIGHUP)
_Handler = Callable[[int, FrameType | None], None]


@contextmanager
def _signals_as_exits() -> Iterator[None]:
    """SIGTERM and SIGHUP end the run as cleanly as Ctrl-C does."""

    def leave(number: int, _: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = {number: signal.signal(number, leave) for number in _ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _no_signals() -> Iterator[None]:
    """A second Ctrl-C does not break off the clean end of the first; that takes two seconds at most."""
    numbers = (signal.SIGINT, *_ENDING)
    before = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
