"""What is watched, and how much of it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fleet_operator.resources import names
from fleet_operator.resources.refs import (
    CONFIG_MAP,
    FLEET_SPEC,
    JOB,
    MISSION,
    NETWORK_POLICY,
    NODE,
    SERVICE,
    Kind,
    Manifest,
)


@dataclass(frozen=True, slots=True)
class Shelf:
    """Objects of one kind that are kept together.

    Args:
        label: Only objects with this label; "" for all.
        heads: Only their metadata is asked for (Kubernetes, "API Concepts", Metadata-only fetches).
        page: Objects in one part of a list.
        optional: Whether the operator can do without it where RBAC refuses it.
    """

    kind: Kind
    label: str = ""
    heads: bool = False
    page: int = 200
    optional: bool = False

    def holds(self, kind: Kind, body: Mapping[str, Any]) -> bool:
        """Whether an object of this kind belongs here."""
        return kind == self.kind and (not self.label or self.label in body["metadata"].get("labels", {}))


FLEETS = Shelf(FLEET_SPEC)
MISSIONS = Shelf(MISSION)
JOBS = Shelf(JOB, names.FLEET_LABEL)
# A ConfigMap with files is up to 1 MiB, so few of them make a page of a reasonable size.
FILES = Shelf(CONFIG_MAP, names.FILES_LABEL, page=4)
NODES = Shelf(NODE, optional=True)
MADE = tuple(Shelf(kind, names.FLEET_LABEL, heads=True) for kind in (CONFIG_MAP, SERVICE, NETWORK_POLICY))
"""What the operator makes and never reads: it only has to know that it is there, as it was applied."""
SHELVES = (FLEETS, MISSIONS, JOBS, FILES, NODES, *MADE)


def shelf_of(kind: Kind, body: Manifest) -> Shelf | None:
    """The shelf of an object; None when nothing like it is watched."""
    return next((shelf for shelf in SHELVES if shelf.holds(kind, body)), None)
