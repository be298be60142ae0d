"""What is to be done for the agents of a mission, from what their Jobs have come to."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from fleet_operator.resources import names
from fleet_operator.resources.roles import Role
from fleet_operator.resources.views import JobState, JobView


@dataclass(frozen=True)
class FlightPlan:
    """What a mission that is not evaluated needs.

    Args:
        flying: Agents that need a sensor and a workflow.
        stopped: Jobs that must go: workflows without a sensor, sensors without a workflow.
        fallen: Why agents have failed whose landing nobody will write but the operator, by name.
        evaluator: The agent in whose place the mission is evaluated; "" when nobody has to, or nobody is left.
        broken: Why it can never be evaluated; "" as long as it can.
    """

    flying: tuple[str, ...] = ()
    stopped: tuple[JobView, ...] = ()
    fallen: Mapping[str, str] = field(default_factory=dict)
    evaluator: str = ""
    broken: str = ""


@dataclass(frozen=True)
class Flight:
    """A mission that is not evaluated, as it was seen.

    Args:
        fleet: Name of the fleet.
        number: The mission.
        agents: All agents.
        landed: Those that have landed.
        jobs: Jobs of the fleet by name.
    """

    fleet: str
    number: int
    agents: Sequence[str]
    landed: Collection[str]
    jobs: Mapping[str, JobView]

    def plan(self, failed: Collection[str]) -> FlightPlan:
        """What is to be done.

        Args:
            failed: Agents that have landed as failed; they evaluate last.
        """
        if set(self.agents) <= set(self.landed):
            return self._evaluation(failed)
        flying: list[str] = []
        stopped: list[JobView] = []
        fallen: dict[str, str] = {}
        for agent in self.agents:
            sensor, workflow = self._job(Role.SENSOR, agent), self._job(Role.WORKFLOW, agent)
            if workflow is not None and workflow.state is JobState.FAILED and sensor is not None:
                stopped += [] if sensor.state.over else [sensor]
            if agent in self.landed:
                continue
            reason = _reason(agent, sensor, workflow)
            if not reason:
                flying.append(agent)
            elif workflow is None or workflow.state.over:
                fallen[agent] = reason
            else:
                stopped.append(workflow)
        return FlightPlan(tuple(flying), tuple(stopped), fallen)

    def _evaluation(self, failed: Collection[str]) -> FlightPlan:
        """One after another evaluates, when all that could have done it have ended without."""
        workflows = [self._job(Role.WORKFLOW, agent) for agent in self.agents]
        if any(job is not None and not job.state.over for job in workflows):
            return FlightPlan()
        reason = "no workflow evaluated it"
        for agent in sorted(self.agents, key=lambda agent: agent in failed):
            job = self.jobs.get(names.evaluate_job(self.fleet, self.number, agent))
            if job is None or not job.state.over:
                return FlightPlan(evaluator=agent)
            reason = job.message or reason
        return FlightPlan(broken=f"mission {self.number} cannot be evaluated: {reason}")

    def _job(self, role: Role, agent: str) -> JobView | None:
        return self.jobs.get(names.mission_job(role, self.fleet, self.number, agent))


def _reason(agent: str, sensor: JobView | None, workflow: JobView | None) -> str:
    """Why an agent that has not landed never will; "" when it may."""
    if workflow is not None and workflow.state is JobState.FAILED:
        return f"the workflow of {agent} failed: {workflow.message}"
    if workflow is not None and workflow.state is JobState.SUCCEEDED:
        return f"the workflow of {agent} ended without a landing"
    if sensor is not None and sensor.state is JobState.FAILED:
        return f"the sensor of {agent} failed: {sensor.message}"
    return ""
