"""From a FleetSpec and decisions to every object that runs it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml

from fleet_operator.compiler.jobs import fleet_metadata
from fleet_operator.compiler.missions import (
    compile_flight,
    compile_retraining,
    mission_manifest,
    training_job,
    weighing_job,
)
from fleet_operator.compiler.network import network_policies
from fleet_operator.compiler.target import AggregatorTerms, Target
from fleet_operator.policy.level import priority_value
from fleet_operator.resources import names
from fleet_operator.resources.roles import LOWEST_LEVEL, REAL_TIME_LEVEL

Manifest = dict[str, Any]


def compile_fleet(target: Target, terms: Sequence[AggregatorTerms]) -> list[Manifest]:
    """Everything that runs up to the end of the first mission, in the order in which it is needed.

    Args:
        terms: One for each aggregator.
    """
    return [
        *priority_classes(),
        *function_sources(target),
        *network_policies(target),
        training_job(target),
        mission_manifest(target, mission=1),
        *compile_flight(target, mission=1),
        *compile_retraining(target, 1, terms),
        weighing_job(target, mission=1),
    ]


def priority_classes() -> list[Manifest]:
    """The PriorityClass of each level; they belong to the cluster, and all fleets share them."""
    return [_priority_class(level) for level in range(LOWEST_LEVEL, REAL_TIME_LEVEL + 1)]


def function_sources(target: Target) -> list[Manifest]:
    """The ConfigMap with the user's functions; none when they are all in images.

    Its name has a hash of its content: functions that change during a mission do not change under it.
    """
    if not target.bundle:
        return []
    return [
        {
            "apiVersion": "v1",
            "kind": "ConfigMap",
            "metadata": fleet_metadata(target, names.functions(target.spec.name, target.bundle.digest)),
            "immutable": True,
            **target.bundle.data(),
        }
    ]


def to_yaml(objects: Sequence[Manifest]) -> str:
    """Manifests as one YAML stream; the same objects give the same bytes."""
    return yaml.dump_all(objects, Dumper=_Dumper, sort_keys=False, explicit_start=True, allow_unicode=True, width=120)


def _priority_class(level: int) -> Manifest:
    what = {
        LOWEST_LEVEL: "Aggregators of models that are not useful; they are suspended.",
        REAL_TIME_LEVEL: "Sensors and AS workflows of the Fleet Computer.",
    }
    return {
        "apiVersion": "scheduling.k8s.io/v1",
        "kind": "PriorityClass",
        "metadata": {
            "name": names.priority_class(level),
            "labels": {"app.kubernetes.io/name": names.PRODUCT, "app.kubernetes.io/part-of": names.PRODUCT},
        },
        "value": priority_value(level),
        "globalDefault": False,
        "description": what.get(level, f"Retraining of models whose usefulness is level {level} of 9."),
    }


class _Dumper(yaml.SafeDumper):
    """Block style for sources, no anchors, lists indented under their key."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Dumper.add_representer(str, _text)
