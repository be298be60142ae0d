"""CPU and memory of containers for which the FleetSpec gives none, and how Jobs are tried again.

Requests are small, so that the bin packing stays feasible on edge machines; limits leave room for a burst.
"""

from __future__ import annotations

from fleet.errors import ExitCode
from fleet.spec.base import Amounts, Resources


def _resources(cpu: tuple[str, str], memory: tuple[str, str]) -> Resources:
    return Resources(
        requests=Amounts(cpu=cpu[0], memory=memory[0]),
        limits=Amounts(cpu=cpu[1], memory=memory[1]),
    )


SENSOR = _resources(cpu=("50m", "500m"), memory=("96Mi", "512Mi"))
WORKFLOW = _resources(cpu=("100m", "1"), memory=("128Mi", "512Mi"))
PLANNING_WORKFLOW = _resources(cpu=("100m", "1"), memory=("256Mi", "1Gi"))
"""The same with a belief of the whole field: 200 MiB for 2,000 cells, 450 MiB for 1,000,000."""
FUNCTION = _resources(cpu=("100m", "1"), memory=("128Mi", "512Mi"))
TRAINER = _resources(cpu=("1", "2"), memory=("512Mi", "1536Mi"))
AGGREGATOR = _resources(cpu=("250m", "1"), memory=("160Mi", "512Mi"))
SMALLEST_AGGREGATOR = _resources(cpu=("50m", "50m"), memory=("160Mi", "192Mi"))
"""What a share is raised to: an interpreter with numpy and the records of one mission.

Never are all requests the limits: such a pod is of another quality of service, which no resize may change.
"""
SMALLEST_PLANNING_AGGREGATOR = _resources(cpu=("50m", "50m"), memory=("224Mi", "320Mi"))
"""The same for the model of a Planner, which is learned with the compiled belief: 200 MiB when nothing is compiled."""

PERMANENT_EXIT_CODES = (int(ExitCode.USAGE), int(ExitCode.PERMANENT))
"""The same input fails again, so the Job fails at once."""
GRACE_PERIOD_S = 10
"""Between SIGTERM and SIGKILL. No preStop is needed: what a role has said is durable, and it goes on from there."""
AGGREGATOR_GRACE_PERIOD_S = 1
"""An aggregator has nothing to say at its end, and one of a higher level waits for its place."""
PROBE_PERIOD_S = 1
PROBE_TIMEOUT_S = 2
PROBE_FAILURES = 120
"""Seconds that a server may take to load: a user's function, a sensor with a large context."""

LIVENESS_PERIOD_S = 10
LIVENESS_TIMEOUT_S = 5
HANGS_S = 60.0
"""A server that has not answered for so long, and for the time of its longest call, hangs."""

LEARNING_RETRIES = 6
"""How often a trainer or an aggregator is started again; Kubernetes' own default of backoffLimit."""
