"""`fleet run`: observe storage, decide the next step, compile, run the Jobs on this machine, and again.

Nothing is remembered between two steps but what has failed for good. So a run that was broken off, by Ctrl-C or by a
power cut, goes on where it was when the same command is given again.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, assert_never

from fleet.aggregation.subsets import subsets_for
from fleet.contexts.load import load_context
from fleet.errors import MissionError
from fleet.missions.documents import MissionEvaluation
from fleet.spec.platform import ClockMode
from fleet.spec.resources import Fleet
from fleet_operator.compiler.fleet import function_sources, priority_classes
from fleet_operator.compiler.missions import compile_retraining, training_job, weighing_job
from fleet_operator.compiler.target import Target
from fleet_operator.flow.orders import read_evaluation, write_order
from fleet_operator.local.application import Application
from fleet_operator.local.display import Display, Gauge
from fleet_operator.local.flight import Flight
from fleet_operator.local.ledger import LOGS, Ledger
from fleet_operator.local.machine import JobState, Machine
from fleet_operator.local.observe import Observer, trainer_gauges
from fleet_operator.policy.lifecycle import (
    Course,
    Done,
    Failed,
    Fly,
    Order,
    Prepare,
    Retrain,
    Step,
    Suspended,
    Train,
    Wait,
    Weigh,
    next_step,
)
from fleet_operator.policy.shares import Capacity
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role

Manifest = dict[str, Any]
_GAUGES_EVERY_S = 0.5


class Run:
    """Takes one fleet from where it is to the end of its missions.

    Args:
        application: What is run.
        target: The same for the compiler.
        machine: Runs the Jobs.
        ledger: Is told what took how long.
        display: Is told what happens.
    """

    def __init__(
        self, application: Application, target: Target, machine: Machine, ledger: Ledger, display: Display
    ) -> None:
        self._application = application
        self._target = target
        self._machine = machine
        self._ledger = ledger
        self._display = display
        self._course = _course(application.fleet)
        self._ended_s: dict[int, float] = {}
        self._observer = Observer(application, Capacity(machine.capacity.cores, machine.capacity.memory_bytes))
        self._given_up: dict[int, set[str]] = defaultdict(set)
        self._flights: dict[int, Flight] = {}
        self._prepared = False
        self._broken = ""

    def to_the_end(self) -> list[MissionEvaluation]:
        """Fly all missions.

        Returns:
            The evaluation of each mission; fewer than asked for when the FleetSpec is suspended.

        Raises:
            MissionError: the run can never go on; says why.
            ContextError: a context is not a good one.
        """
        while True:
            step = self._next()
            match step:
                case Done() | Suspended():
                    return self._evaluations()
                case Failed(reason=reason):
                    raise MissionError(reason)
                case _:
                    self._take(step)

    def _next(self) -> Step:
        if not self._prepared:
            return Prepare()
        progress = self._observer.progress(self._given_up, self._broken)
        missions = tuple(
            replace(mission, ended_s=self._ended_s.get(number))
            for number, mission in enumerate(progress.missions, start=1)
        )
        return next_step(self._course, replace(progress, missions=missions, now_s=time.time()))

    def _take(self, step: Step) -> None:
        match step:
            case Prepare():
                with self._phase("preparing", "copying contexts"):
                    self._prepare()
            case Train():
                with self._phase("training", "shaping the reward and training"):
                    self._train(step, [training_job(self._target)])
            case Order(number=number):
                self._order(number)
            case Wait(number=number, seconds=seconds):
                with self._phase(f"wait {number}", f"waiting {seconds:.0f} s for mission {number}"):
                    time.sleep(seconds)
            case Fly(number=number, agents=agents):
                with self._phase(f"mission {number}", _flight_text(number, agents)):
                    self._fly(number, agents)
            case Retrain(number=number, subsets=subsets):
                with self._phase(f"retraining {number}", _retraining_text(number, subsets)):
                    self._retrain(number, subsets)
            case Weigh(number=number):
                with self._phase(f"weighing {number}", f"mission {number}: weighing the models"):
                    self._train(step, [weighing_job(self._target, number)])
            case Suspended() | Failed() | Done():
                return
            case _:
                assert_never(step)

    def _prepare(self) -> None:
        """Contexts first, the FleetSpec last: its presence means that everything is there.

        Every context is opened once, so that a broken one is told at once and not by the first Job.
        """
        application = self._application
        subsets_for(application.fleet)  # the user's own aggregation: what is wrong with it is told before training
        application.copy_contexts(application.storage)
        for spec in application.fleet.contexts:
            for remark in load_context(application.storage, application.paths.context(spec.name)).remarks:
                self._display.note(f"  {remark}")
        document = application.spec.model_dump_json(by_alias=True, indent=1, exclude_none=True)
        application.storage.write(application.paths.fleet_spec, document.encode())
        self._machine.apply([*priority_classes(), *function_sources(self._target)])
        self._prepared = True

    def _order(self, number: int) -> None:
        application = self._application
        subsets = [subset.key for subset in subsets_for(application.fleet)]
        write_order(application.storage, application.paths, application.fleet, number, subsets)

    def _train(self, step: Step, jobs: Sequence[Manifest]) -> None:
        """Run a trainer; all else waits for it, so its failure is the run's."""
        name = jobs[0]["metadata"]["name"]
        log = self._application.out / LOGS / name / f"{names.main_container(Role.TRAINER)}.log"
        failures = self._run_jobs(jobs, lambda: trainer_gauges(log))
        if failures:
            self._broken = next(iter(failures.values()))
        elif self._next() == step:
            self._broken = f"the trainer ended without a result; its log is {log}"

    def _retrain(self, number: int, subsets: Sequence[str]) -> None:
        """Run the aggregators; one that failed, or that left nothing, is given up for this mission."""
        terms = [each for each in self._observer.terms(number) if each.subset in subsets]
        application = self._application
        jobs = compile_retraining(self._target, number, terms)
        self._run_jobs(jobs, lambda: self._observer.retraining_gauges(number, subsets))
        for subset in subsets:
            if not application.storage.exists(application.paths.retraining(number, subset)):
                self._given_up[number].add(subset)

    def _fly(self, number: int, agents: Sequence[str]) -> None:
        flight = self._flights.setdefault(number, Flight(self._target, self._application, self._machine, number))
        flight.run(agents, self._gauged(lambda: self._observer.flight_gauges(number, self._application.agents)))
        self._broken = flight.broken
        if self._application.storage.exists(self._application.paths.evaluation(number)):
            self._ended_s[number] = time.time()
            self._display.note(mission_line(self._evaluation(number)))

    def _run_jobs(self, jobs: Sequence[Manifest], gauges: Callable[[], list[Gauge]]) -> dict[str, str]:
        """Run Jobs to their ends; why some failed, by name."""
        job_names = [job["metadata"]["name"] for job in jobs]
        self._machine.apply(jobs)
        draw = self._gauged(gauges)
        open_states = {JobState.PENDING, JobState.RUNNING}

        def wanted() -> bool:
            draw()
            return any(self._machine.state(name) in open_states for name in job_names)

        self._machine.run_while(wanted)
        failed = [name for name in job_names if self._machine.state(name) is JobState.FAILED]
        failures = {name: self._machine.message(name) for name in failed}
        self._machine.delete(job_names)
        return failures

    def _gauged(self, gauges: Callable[[], list[Gauge]]) -> Callable[[], None]:
        """A function that shows gauges when it is called, but not too often."""
        next_s = 0.0

        def draw() -> None:
            nonlocal next_s
            if self._display.draws and self._machine.now_s() >= next_s:
                self._display.gauges(gauges())
                next_s = self._machine.now_s() + _GAUGES_EVERY_S

        return draw

    @contextmanager
    def _phase(self, name: str, text: str) -> Iterator[None]:
        self._display.phase(text)
        started_s = self._machine.now_s()
        try:
            yield
        finally:
            self._ledger.add(name, self._machine.now_s() - started_s, self._machine.meter.peak_bytes)

    def _observed(self) -> frozenset[str]:
        return frozenset(entry.path for entry in self._application.storage.list(self._application.paths.root))

    def _evaluation(self, number: int) -> MissionEvaluation:
        return read_evaluation(self._application.storage, self._application.paths, number)

    def _evaluations(self) -> list[MissionEvaluation]:
        paths = self._application.paths
        numbers = range(1, self._course.missions + 1)
        return [self._evaluation(number) for number in numbers if paths.evaluation(number) in self._observed()]


def _course(fleet: Fleet) -> Course:
    """What the FleetSpec asks for; with an accelerated clock, time between missions does not pass."""
    course = Course.of(fleet)
    return course if fleet.missions.clock is ClockMode.REAL else replace(course, interval_s=0.0, schedule="")


def mission_line(evaluation: MissionEvaluation) -> str:
    """One mission in one line."""
    goals = ", ".join(
        f"{result.goal.metric} {'?' if result.value is None else f'{result.value:.3g}'}"
        f" ({'met' if result.met else 'missed'})"
        for result in evaluation.goals
    )
    failures = "".join(f"; {agent} failed" for agent in evaluation.failures)
    return f"  mission {evaluation.number}: {goals}{failures}"


def _retraining_text(number: int, subsets: Sequence[str]) -> str:
    return f"mission {number}: {len(subsets)} aggregator{'s retrain' if len(subsets) != 1 else ' retrains'}"


def _flight_text(number: int, agents: Sequence[str]) -> str:
    return f"mission {number}: flying with {len(agents)} agent{'s' if len(agents) != 1 else ''}"
