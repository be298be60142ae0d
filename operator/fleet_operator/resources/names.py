"""Names of everything in the cluster: the one module that makes them.

Names are deterministic, valid DNS labels of at most 63 characters, and different for different things: a name that
had to be changed to fit, or that could be read as another thing's name, ends in a hash of what it names.
"""

from __future__ import annotations

import hashlib
import re

from fleet.spec.base import GROUP
from fleet_operator.resources.roles import Role

MANAGER = "fleet-operator"
PRODUCT = "fleet-computer"
LONGEST = 63
_HASH_DIGITS = 8

FLEET_LABEL = f"{GROUP}/fleet"
MISSION_LABEL = f"{GROUP}/mission"
ROLE_LABEL = f"{GROUP}/role"
AGENT_LABEL = f"{GROUP}/agent"
SUBSET_LABEL = f"{GROUP}/subset"
LEVEL_LABEL = f"{GROUP}/level"
TASK_LABEL = f"{GROUP}/task"
"""Tells Jobs of one role, mission and agent apart: Fly or Evaluate, Train or Weigh."""
FILES_LABEL = f"{GROUP}/files"
"""On a ConfigMap with files that stand beside a FleetSpec: the name of the fleet."""
AGENT_ANNOTATION = AGENT_LABEL
SUBSET_ANNOTATION = SUBSET_LABEL
"""Names as they are; the labels of these names may be hashed."""
ORDER_ANNOTATION = f"{GROUP}/order"
"""On a Job: hash of the FleetSpec, functions and images that it was made for."""
PATHS_ANNOTATION = f"{GROUP}/paths"
"""On a ConfigMap with files: JSON from its keys to paths relative to the FleetSpec."""

FUNCTIONS_FOLDER = "/fleet/functions"
"""Where the user's functions are in a container."""
FUNCTIONS_VOLUME = "functions"
SCRATCH_FOLDER = "/tmp"
STORAGE_VOLUME = "storage"
HEALTH_PATH = "/healthz"

_MISSION_PARTS = {Role.SENSOR: "sensor", Role.WORKFLOW: "workflow", Role.AGGREGATOR: "aggregator"}
_AMBIGUOUS = re.compile(r"-(m\d{4,}-(sensor|workflow|aggregator|weigh|evaluate)|train|functions|files|network)(-|$)")


def priority_class(level: int) -> str:
    """The PriorityClass of a level; shared by all fleets of the cluster."""
    return f"fleet-level-{level}"


def functions(fleet: str, digest: str) -> str:
    """The ConfigMap with the user's functions; another content has another name."""
    return _name(fleet, "functions", digest[:_HASH_DIGITS])


def files(fleet: str, part: int) -> str:
    """A ConfigMap with files that stand beside the FleetSpec; they are split where one would be too large."""
    return _name(fleet, "files", str(part))


def network_policy(fleet: str, what: str) -> str:
    """A NetworkPolicy of a fleet."""
    return _name(fleet, "network", what)


def mission(fleet: str, number: int) -> str:
    """The Mission object of a mission."""
    return _name(fleet, mission_part(number))


def training_job(fleet: str) -> str:
    """The Job that shapes the reward and trains the first SA."""
    return _name(fleet, "train")


def weighing_job(fleet: str, mission: int) -> str:
    """The Job that finds weights and usefulness after a mission."""
    return _name(fleet, mission_part(mission), "weigh")


def evaluate_job(fleet: str, mission: int, agent: str) -> str:
    """The Job that evaluates a mission in the place of an agent's workflow, when all have landed and none did."""
    return _name(fleet, mission_part(mission), "evaluate", agent)


def mission_job(role: Role, fleet: str, mission: int, member: str) -> str:
    """The Job of a sensor or workflow (member: the agent) or of an aggregator (member: the subset's key)."""
    return _name(fleet, mission_part(mission), _MISSION_PARTS[role], member)


def sensor_service(fleet: str, mission: int, agent: str) -> str:
    """The headless Service in front of an agent's sensor; the same name as its Job."""
    return mission_job(Role.SENSOR, fleet, mission, agent)


def mission_part(mission: int) -> str:
    """How a mission appears in names."""
    return f"m{mission:04d}"


def main_container(role: Role) -> str:
    """The container whose end is the end of the pod."""
    return role.value.lower()


def scratch_volume(container: str) -> str:
    """The scratch volume of a container; no other container has it."""
    return f"tmp-{container}"


def label_value(text: str) -> str:
    """A text as the value of a label: at most 63 letters, digits, `-`, `_`, `.`, alphanumeric at both ends."""
    cleaned = re.sub(r"[^A-Za-z0-9._-]", "-", text)
    fits = cleaned == text and len(text) <= LONGEST and re.fullmatch(r"([A-Za-z0-9](.*[A-Za-z0-9])?)?", text)
    return text if fits else _hashed(cleaned, (text,))


def _name(*parts: str) -> str:
    plain = "-".join(parts)
    cleaned = re.sub(r"[^a-z0-9-]", "-", plain.lower())
    fits = cleaned == plain and len(plain) <= LONGEST and plain[0].isalpha() and plain[-1] != "-"
    if fits and not _AMBIGUOUS.search(parts[0]):
        return plain
    return _hashed(cleaned if cleaned[0].isalpha() else f"f-{cleaned}", parts)


def _hashed(text: str, parts: tuple[str, ...]) -> str:
    digest = hashlib.blake2b("\0".join(parts).encode(), digest_size=_HASH_DIGITS // 2).hexdigest()
    start = text[: LONGEST - _HASH_DIGITS - 1].strip("-._")
    return f"{start}-{digest}" if start else digest
