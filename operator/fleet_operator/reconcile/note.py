"""What is remembered of a fleet between two passes: nothing that counts, only what saves work."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from fleet.spec.base import Model
from fleet.spec.resources import FleetSpec
from fleet_operator.compiler.bundle import Bundle
from fleet_operator.policy.status import Situation, Trouble
from fleet_operator.reconcile.asked import Asked
from fleet_operator.resources.views import JobView

_DOCUMENTS = 2048


@dataclass(frozen=True)
class Looked:
    """What a look at the pods of Jobs that are not ready found.

    Args:
        at: Which Jobs these were, and which machines were not ready.
        found: Troubles.
        lost: As in a diagnosis.
        pause_s, again_s: How long that is taken for what there is; until then.
    """

    at: tuple[frozenset[str], frozenset[str]]
    found: tuple[Trouble, ...]
    lost: tuple[JobView, ...]
    pause_s: float
    again_s: float


@dataclass
class Note:
    """Of one FleetSpec object; it may be lost at any moment.

    Args:
        uid: Of the FleetSpec.

    Attributes:
        at_rest: What was seen of the cluster when nothing was left to do; "" while there is something.
        asked_for: What `asked` was made of.
        asked: What the user asks for.
        claimed: The claim that is known to be in storage: uid and policy.
        stored: The FleetSpec in storage, which nobody else writes; None when it is not known.
        functions: The functions in storage; None when they are not known.
        known: What is in the fleet's folder, as far as it counts; None when it is not known.
        known_for: As `asked_for`, when that was listed: another FleetSpec is worth a new look at everything.
        documents: Documents of missions by path: they never change.
        steps: Size and records of logs, by path.
        situation: That of the last pass.
        looked: The last look at Jobs that are not ready.
        told: What was said of a trouble when it was first seen, by its reason.
        resized: The mission, and its aggregators that were over and that ran when these were last given their share.
        refused_resize: The mission in which it was last said that an aggregator may not be resized.
        without_storage_s: Since when its storage refuses, in seconds since the Unix epoch; None while it does not.
        copies_seen: Whether it was looked how many copies its storage keeps.
    """

    uid: str
    at_rest: str = ""
    asked_for: str = ""
    asked: Asked | None = None
    claimed: str = ""
    stored: FleetSpec | None = None
    functions: Bundle | None = None
    known: dict[str, int] | None = None
    known_for: str = ""
    documents: dict[str, Model] = field(default_factory=dict)
    steps: dict[str, tuple[int, int]] = field(default_factory=dict)
    situation: Situation | None = None
    looked: Looked | None = None
    told: dict[str, str] = field(default_factory=dict)
    refused_resize: int = 0
    without_storage_s: float | None = None
    copies_seen: bool = False
    resized: tuple[int, frozenset[str], frozenset[str]] = (0, frozenset(), frozenset())

    def refusal(self, asked_for: str) -> Trouble | None:
        """Why what the user asks for now is refused, as far as that is known; whether it lasts, only storage tells."""
        if self.asked is None or self.asked.refusal is None or self.asked_for != asked_for:
            return None
        return replace(self.asked.refusal, lasting=False)

    def rest(self, seen: str) -> None:
        """Remember that nothing is left to do."""
        self.at_rest = seen
        self.ease()

    def ease(self) -> None:
        """Forget what is only of use while something is done: a thousand fleets may wait for hours."""
        self.asked, self.asked_for, self.functions, self.stored, self.known = None, "", None, None, None
        self.documents, self.steps, self.situation = {}, {}, None

    def tidy(self) -> None:
        """Keep the documents that were read last."""
        for path in list(self.documents)[:-_DOCUMENTS]:
            del self.documents[path]
