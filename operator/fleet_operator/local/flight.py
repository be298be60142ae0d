"""One mission on this machine: sensors and workflows of the agents, until every agent's part is over."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fleet.energy.model import energy_model
from fleet_operator.compiler.missions import compile_flight
from fleet_operator.compiler.target import Target
from fleet_operator.flow.landings import has_failed, write_failed_landing
from fleet_operator.local.application import Application
from fleet_operator.local.machine import JobState, Machine
from fleet_operator.resources import names
from fleet_operator.resources.roles import Role

_ENDED = {JobState.SUCCEEDED, JobState.FAILED}


class Flight:
    """Runs the Jobs of one mission.

    An agent whose sensor or workflow has failed for good gets a failed landing, so that the mission ends and is
    evaluated without it. The workflow of the last to land evaluates; when that was an agent with a failed landing,
    another agent's workflow is started again to evaluate.

    Args:
        target, application, machine: What is flown, and where.
        number: The mission.

    Attributes:
        broken: Why the mission can never be evaluated; "" as long as it can.
    """

    def __init__(self, target: Target, application: Application, machine: Machine, number: int) -> None:
        self._target = target
        self._application = application
        self._machine = machine
        self._number = number
        self._evaluators: list[str] = []
        self.broken = ""

    def run(self, agents: Sequence[str], tick: Callable[[], None]) -> None:
        """Have these agents fly until each has landed; when all have landed before, have one of them evaluate.

        Args:
            tick: Called again and again meanwhile.
        """
        storage, paths = self._application.storage, self._application.paths
        landed = [agent for agent in self._application.agents if storage.exists(paths.landing(self._number, agent))]
        if len(landed) < len(self._application.agents):
            failures = self._run_jobs(agents, tick)
            energy = energy_model(self._application.fleet, self._application.file.parent)
            for agent in agents:
                message = failures.get(agent, "its workflow ended without a landing")
                write_failed_landing(storage, paths, self._number, agent, message, energy)
            return
        self._evaluate(tick)

    def _evaluate(self, tick: Callable[[], None]) -> None:
        storage, paths = self._application.storage, self._application.paths
        failed = {agent for agent in self._application.agents if has_failed(storage, paths, self._number, agent)}
        candidates = sorted(self._application.agents, key=lambda agent: agent in failed)
        left = [agent for agent in candidates if agent not in self._evaluators]
        agent = left[0]
        self._evaluators.append(agent)
        failures = self._run_jobs([agent], tick)
        if len(left) == 1 and not storage.exists(paths.evaluation(self._number)):
            reason = failures.get(agent, "no workflow evaluated it")
            self.broken = f"mission {self._number} cannot be evaluated: {reason}"

    def _run_jobs(self, agents: Sequence[str], tick: Callable[[], None]) -> dict[str, str]:
        """Run sensors and workflows; why agents failed, by name."""
        sensors = {agent: self._job(Role.SENSOR, agent) for agent in agents}
        workflows = {agent: self._job(Role.WORKFLOW, agent) for agent in agents}
        failures: dict[str, str] = {}
        self._machine.apply(compile_flight(self._target, self._number, agents))

        def wanted() -> bool:
            tick()
            for agent in agents:
                self._look_after(agent, sensors[agent], workflows[agent], failures)
            return any(self._machine.state(name) not in {*_ENDED, None} for name in workflows.values())

        self._machine.run_while(wanted)
        self._machine.delete([*sensors.values(), *workflows.values()])
        return failures

    def _look_after(self, agent: str, sensor: str, workflow: str, failures: dict[str, str]) -> None:
        """An agent without a sensor cannot fly; a sensor without a workflow has nothing to do."""
        state = self._machine.state(workflow)
        if state is JobState.FAILED:
            failures.setdefault(agent, self._machine.message(workflow))
        if state in _ENDED:
            self._machine.delete([sensor])
        elif self._machine.state(sensor) is JobState.FAILED:
            failures.setdefault(agent, self._machine.message(sensor))
            self._machine.delete([workflow])

    def _job(self, role: Role, agent: str) -> str:
        return names.mission_job(role, self._target.spec.name, self._number, agent)
