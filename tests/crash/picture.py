"""What a run leaves behind, without what differs from run to run: times, uids, versions, names of the trial."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from fleet.storage.port import Storage
from tests.crash.cluster import Cluster, Manifest
from tests.testbed.ports import FIRST, LAST

_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)")
_UID = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}")
_POD = re.compile(r"(?<=pod NAMESPACE/)([a-z0-9-]+)-[a-z0-9]{5}\b")
_ADDRESS = re.compile(r"127\.0\.0\.1:\d+")
_OF_THE_SERVER = {"resourceVersion", "managedFields", "creationTimestamp", "uid", "generation", "selfLink"}
# Hashes over what has the uid of the owner or the names of the run in it.
_HASHES = {"fleetcomputer.io/applied", "fleetcomputer.io/order"}
_PORTS = range(FIRST, LAST + 1)
# How far a step was when it was told; when it is told depends on who was faster.
_PROGRESS = re.compile(r"\b\d+ of (?=\d+ )")
# Steps that come and go: one that went by while no operator looked is not told.
_PASSING = {"Training", "Retraining", "Weighing", "Flying"}
# Troubles of a step are told together; one that came and went while no operator looked is not told.
_TROUBLES = {"AgentFailed"}
_MEASURED = {"cpuS", "wallS", "energyJ"}
_COMPARED = ("FleetSpec", "Mission", "Job", "Service", "ConfigMap", "NetworkPolicy")
_SERVERS_OWN = "kube-root-ca.crt"
_FAULTS = "/faults/"


@dataclass(frozen=True)
class Picture:
    """A run's results.

    Args:
        objects: Normalised manifests by `Kind/name`.
        storage: Normalised content of every object, or its hash, by path.
        events: Type, reason, object and message of every Event.
    """

    objects: Mapping[str, Any]
    storage: Mapping[str, Any]
    events: frozenset[tuple[str, str, str, str]]


def take_picture(cluster: Cluster, storage: Storage, namespace: str) -> Picture:
    """What is there now."""
    objects = {}
    for kind in _COMPARED:
        for found in cluster.list(kind, namespace):
            name = found["metadata"]["name"]
            if name != _SERVERS_OWN:
                objects[f"{kind}/{name}"] = _normal(_stripped(kind, found), namespace)
    entries = [entry.path for entry in storage.list("") if _FAULTS not in entry.path]
    content = {_text(path, namespace): _content(storage.read(path), namespace) for path in entries}
    return Picture(objects, content, _events(cluster.list("Event", namespace), namespace))


def differences(
    expected: Picture, found: Picture, may_tell: Collection[str] = (), *, lost_events: bool = False
) -> list[str]:
    """In words, where two runs differ.

    Args:
        may_tell: Reasons of events that only the second may have.
        lost_events: The second may lack events.
    """
    told = {each[1] for each in found.events} & _TROUBLES
    missing = set() if lost_events else expected.events - found.events
    missing = {each for each in missing if each[1] not in _PASSING | told}
    return [
        *_differ("objects", expected.objects, found.objects),
        *_differ("storage", expected.storage, found.storage),
        *(f"event is missing: {each}" for each in sorted(missing)),
        *(f"event is new: {each}" for each in sorted(found.events - expected.events) if each[1] not in may_tell),
    ]


def _events(events: Iterable[Manifest], namespace: str) -> frozenset[tuple[str, str, str, str]]:
    """Events that the operator wrote; those of controllers tell of pods, whose names are by chance."""
    ours = [each for each in events if each["involvedObject"]["kind"] in {"FleetSpec", "Mission"}]
    return frozenset(
        (
            each["type"],
            each["reason"],
            f"{each['involvedObject']['kind']}/{each['involvedObject']['name']}",
            _PROGRESS.sub("some of ", _text(each["message"], namespace)),
        )
        for each in ours
    )


def _stripped(kind: str, found: Manifest) -> Manifest:
    """An object without what the server and the controllers add."""
    result: Manifest = json.loads(json.dumps(found))
    metadata = result["metadata"]
    for name in _OF_THE_SERVER:
        metadata.pop(name, None)
    for owner in metadata.get("ownerReferences", ()):
        owner.pop("uid", None)
    for name in _HASHES & set(metadata.get("annotations", {})):
        metadata["annotations"][name] = "HASH"
    if kind == "Job":
        _strip_job(result)
    return result


def _strip_job(job: Manifest) -> None:
    job["spec"].pop("selector", None)
    labels = job["spec"]["template"]["metadata"].get("labels", {})
    for name in [name for name in labels if "controller-uid" in name]:
        del labels[name]
    status = job.get("status", {})
    conditions = sorted((each["type"], each["status"], each.get("reason", "")) for each in status.get("conditions", ()))
    job["status"] = {
        "conditions": [list(each) for each in conditions],
        **{name: status.get(name, 0) for name in ("succeeded", "failed", "active")},
    }


def _normal(value: Any, namespace: str) -> Any:
    match value:
        case dict():
            return {key: 0 if key in _MEASURED else _normal(inner, namespace) for key, inner in sorted(value.items())}
        case list():
            return [_normal(inner, namespace) for inner in value]
        case str():
            return _text(value, namespace)
        case int() if value in _PORTS:
            return "PORT"
        case _:
            return value


def _text(text: str, namespace: str) -> str:
    text = text.replace(namespace, "NAMESPACE")
    for pattern, name in ((_TIME, "TIME"), (_UID, "UID"), (_ADDRESS, "ADDRESS"), (_POD, r"\1-POD")):
        text = pattern.sub(name, text)
    return text


def _content(data: bytes, namespace: str) -> Any:
    """A document, the lines of a log, or the hash of anything else."""
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return hashlib.sha256(data).hexdigest()
    try:
        return _normal(json.loads(text), namespace)
    except ValueError:
        return [_text(line, namespace) for line in text.splitlines()]


def _differ(place: str, expected: Any, found: Any) -> list[str]:
    """Paths at which two values differ, with both values."""
    if isinstance(expected, Mapping) and isinstance(found, Mapping):
        lines = []
        for key in sorted({*expected, *found}):
            if key not in found:
                lines.append(f"{place}: {key} is missing: {_short(expected[key])}")
            elif key not in expected:
                lines.append(f"{place}: {key} is new: {_short(found[key])}")
            else:
                lines += _differ(f"{place} > {key}", expected[key], found[key])
        return lines
    if isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        pairs = zip(expected, found, strict=True)
        return [line for index, pair in enumerate(pairs) for line in _differ(f"{place}[{index}]", *pair)]
    return [] if expected == found else [f"{place}: {_short(expected)} became {_short(found)}"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) < 400 else f"{text[:400]}..."
