"""The programs of the platform and the scheduling level of each (DESIGN, "What runs where")."""

from __future__ import annotations

from enum import StrEnum


class Role(StrEnum):
    """What a Job of the platform does."""

    SENSOR = "Sensor"
    WORKFLOW = "Workflow"
    TRAINER = "Trainer"
    AGGREGATOR = "Aggregator"


class TrainerTask(StrEnum):
    """What a trainer does: reward shaping and the first SA before the missions, or weights after one."""

    TRAIN = "Train"
    WEIGH = "Weigh"


class NodeRole(StrEnum):
    """What a machine is for: value of the label `fleetcomputer.io/role` of a node."""

    GATEWAY = "gateway"
    HUB = "hub"


EVALUATE = "Evaluate"
"""Task of a workflow that only evaluates a mission whose agents have all landed."""
REAL_TIME_LEVEL = 10
"""Sensors and AS workflows: movement of vehicles waits for nothing."""
TRAINER_LEVEL = 9
"""Nothing flies before the trainer is done."""
LOWEST_LEVEL = 0
"""Aggregators of this level are not scheduled."""
