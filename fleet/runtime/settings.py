"""What a role is told by its environment, and what it opens with that."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from fleet.energy.accounting import EnergyModel
from fleet.energy.model import energy_model
from fleet.errors import MissionError, ObjectNotFound, Problem, SpecError
from fleet.missions.documents import MissionOrder
from fleet.spec.resources import Fleet, FleetSpec
from fleet.storage.layout import FleetPaths
from fleet.storage.open import open_storage
from fleet.storage.port import Storage


@dataclass(frozen=True)
class Settings:
    """The environment of a role; the names are those of the compiled objects."""

    storage_uri: str
    namespace: str
    fleet_name: str
    mission: int = 0
    agent: str = ""
    subset: str = ""
    level: int = 0
    task: str = ""
    sensor_url: str = ""
    map_url: str | None = None
    eval_url: str | None = None
    bind: str = "0.0.0.0"
    port: int = 8080
    workers: int = 1

    @staticmethod
    def from_environment(environment: Mapping[str, str]) -> Settings:
        """Read FLEET_* variables.

        Raises:
            SpecError: a variable is missing, or is not a number.
        """
        problems: list[Problem] = []

        def text(name: str, default: str | None = None) -> str:
            value = environment.get(name, default)
            if value is None:
                problems.append(Problem(name, "is not set", "roles are started from the compiled objects"))
            return value or ""

        def number(name: str, default: int) -> int:
            value = environment.get(name, str(default))
            if not value.isdigit():
                problems.append(Problem(name, f"{value!r} is not a number"))
                return default
            return int(value)

        settings = Settings(
            storage_uri=text("FLEET_STORAGE_URI"),
            namespace=text("FLEET_NAMESPACE", "default"),
            fleet_name=text("FLEET_NAME"),
            mission=number("FLEET_MISSION", 0),
            agent=text("FLEET_AGENT", ""),
            subset=text("FLEET_SUBSET", ""),
            level=number("FLEET_LEVEL", 0),
            task=text("FLEET_TASK", ""),
            sensor_url=text("FLEET_SENSOR_URL", ""),
            map_url=environment.get("FLEET_MAP_URL") or None,
            eval_url=environment.get("FLEET_EVAL_URL") or None,
            bind=text("FLEET_BIND", "0.0.0.0"),
            port=number("FLEET_PORT", 8080),
            workers=number("FLEET_WORKERS", 1),
        )
        if problems:
            raise SpecError(problems, source="the environment")
        return settings

    @property
    def paths(self) -> FleetPaths:
        """Where the fleet's objects are in storage."""
        return FleetPaths(self.namespace, self.fleet_name)

    def at_mission(self, number: int) -> Settings:
        """The same settings for another mission."""
        return replace(self, mission=number)

    @cached_property
    def storage(self) -> Storage:
        """The storage that all roles share."""
        return open_storage(self.storage_uri)

    @cached_property
    def fleet(self) -> Fleet:
        """The FleetSpec of the run, as it was written to storage before any role started."""
        return FleetSpec.model_validate(json.loads(self.storage.read(self.paths.fleet_spec))).spec

    @cached_property
    def energy(self) -> EnergyModel:
        """Energy and time of everything that the agents do."""
        return energy_model(self.fleet)

    @cached_property
    def order(self) -> MissionOrder:
        """The mission's order.

        Raises:
            MissionError: nobody has ordered this mission.
        """
        try:
            data = self.storage.read(self.paths.plan(self.mission))
        except ObjectNotFound as error:
            raise MissionError(f"mission {self.mission} has no plan in storage") from error
        return MissionOrder.model_validate_json(data)

    @cached_property
    def agent_index(self) -> int:
        """Which of the fleet's agents this role serves.

        Raises:
            MissionError: the fleet has no agent of that name.
        """
        names = [agent.name for agent in self.fleet.agents.resolved]
        if self.agent not in names:
            raise MissionError(f"FLEET_AGENT is {self.agent!r}; the fleet has {', '.join(names)}")
        return names.index(self.agent)
