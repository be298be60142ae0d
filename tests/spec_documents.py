"""Documents of the three resources for tests: good ones, and random ones that are valid."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from fleet.spec.base import quantity_value
from fleet.spec.swarm import CAPABILITIES, Action, DriverName

Document = dict[str, Any]
API = "fleetcomputer.io/v1alpha1"


def fleet_document(**spec: Any) -> Document:
    """The smallest useful FleetSpec, with parts of its spec replaced, or taken out by None."""
    parts = {
        "agents": {"count": 4},
        "stateSpace": {"context": "september"},
        "map": {"function": "crops:map_observation"},
        "eval": {"function": "crops:evaluate"},
        "contexts": [
            {"name": "june", "uri": "contexts/june", "use": ["Shaping"]},
            {"name": "august", "uri": "contexts/august", "use": ["Training"]},
            {"name": "september", "uri": "contexts/september", "use": ["Mission"]},
        ],
        "goals": [{"metric": "accuracy", "atLeast": 0.7}],
    }
    kept = {name: part for name, part in (parts | spec).items() if part is not None}
    return {"apiVersion": API, "kind": "FleetSpec", "metadata": {"name": "crops"}, "spec": kept}


def mission_document(**spec: Any) -> Document:
    """A Mission."""
    parts = {"fleet": "crops", "number": 1, "context": "september"} | spec
    return {"apiVersion": API, "kind": "Mission", "metadata": {"name": "crops-1"}, "spec": parts}


def edge_node_document(**spec: Any) -> Document:
    """An EdgeNode."""
    parts = {"node": "hub-1.farm", "mac": "00:1a:2b:3c:4d:5e"} | spec
    return {"apiVersion": API, "kind": "EdgeNode", "metadata": {"name": "hub-1.farm"}, "spec": parts}


names = st.from_regex(r"[a-z0-9]([-a-z0-9]{0,20}[a-z0-9])?", fullmatch=True)
metrics = st.from_regex(r"[a-z][a-z0-9_]{0,15}", fullmatch=True)
functions = st.from_regex(r"[a-z_][a-z0-9_]{0,9}(\.[a-z_]{1,6})?:[A-Za-z_]{1,10}", fullmatch=True)
durations = st.from_regex(r"[1-9][0-9]{0,2}(ms|s|m|h)([1-9]s)?", fullmatch=True)
fractions = st.floats(0, 1)
texts = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1, max_size=20)
cpus = st.sampled_from([1, 2, "250m", "500m", "1", "2.5"])
memories = st.sampled_from(["64Mi", "256Mi", "1Gi", "2G", 268435456])


def _bigger(one: Any, other: Any) -> list[Any]:
    return sorted([one, other], key=lambda quantity: quantity_value(str(quantity)))


def _optional(**fields: st.SearchStrategy[Any]) -> st.SearchStrategy[Document]:
    return st.fixed_dictionaries({}, optional=fields)


@st.composite
def resources(draw: st.DrawFn) -> Document:
    """Requests that are within the limits."""
    cpu = _bigger(draw(cpus), draw(cpus))
    memory = _bigger(draw(memories), draw(memories))
    requests = draw(_optional(cpu=st.just(cpu[0]), memory=st.just(memory[0])))
    return {"requests": requests, "limits": draw(_optional(cpu=st.just(cpu[1]), memory=st.just(memory[1])))}


@st.composite
def agents(draw: st.DrawFn) -> Document:
    """A count, or members that differ."""
    moves = st.lists(st.sampled_from([action.value for action in Action]), min_size=1, max_size=8, unique=True)
    able = st.sampled_from(sorted(CAPABILITIES[DriverName.REPLAY]))
    document: Document = draw(_optional(actions=moves, requires=st.lists(able, max_size=5, unique=True)))
    if draw(st.booleans()):
        return document | {"count": draw(st.integers(1, 12))}
    start = st.fixed_dictionaries({"row": st.integers(0, 50), "column": st.integers(0, 50)})
    member = _optional(actions=moves, start=start, driver=st.just("Replay"))
    chosen = draw(st.lists(names, min_size=1, max_size=5, unique=True))
    return document | {"members": [draw(member) | {"name": name} for name in chosen]}


@st.composite
def goals(draw: st.DrawFn) -> list[Document]:
    """Goals of different metrics, each with a bound."""
    found = []
    for metric in draw(st.lists(metrics, min_size=1, max_size=3, unique=True)):
        low, high = sorted(draw(st.tuples(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9))))
        bounds = draw(st.sampled_from([{"atLeast": low}, {"atMost": high}, {"atLeast": low, "atMost": high}]))
        found.append({"metric": metric, **bounds, "weight": draw(st.floats(0.001, 1000))})
    return found


@st.composite
def user_function(draw: st.DrawFn) -> Document:
    """A Python function or an image."""
    given = {"function": draw(functions)} if draw(st.booleans()) else {"image": "farm/map:1.0", "command": ["serve"]}
    return given | draw(_optional(timeout=durations, retries=st.integers(0, 20), resources=resources()))


@st.composite
def fleet_documents(draw: st.DrawFn) -> Document:
    """Valid FleetSpecs."""
    first, second, third = draw(st.lists(names, min_size=3, max_size=3, unique=True))
    contexts = [
        {"name": first, "uri": draw(texts), "use": ["Shaping"]},
        {"name": second, "uri": draw(texts)},
        {"name": third, "uri": draw(texts), "use": ["Mission"]},
    ]
    spec = {
        "agents": draw(agents()),
        "stateSpace": {"context": third} | draw(_optional(captureInTransit=st.booleans())),
        "map": draw(user_function()),
        "eval": draw(user_function()) | draw(_optional(checks=st.sampled_from(["AtEnd", "AfterGroup"]))),
        "contexts": contexts,
        "goals": draw(goals()),
    }
    settings = _optional(
        ha=_optional(utilityThreshold=st.floats(0, 1e6), visitedThreshold=st.integers(0, 100)),
        sa=_optional(kind=st.sampled_from(["QLearning", "DQN"]), discount=fractions, pretrained=texts),
        rewardShaping=_optional(epochs=st.integers(1, 100), weights=st.just({"exg": 0.5, "lai": 0})),
        aggregation=_optional(resources=resources()),
        scheduling=_optional(cpu=cpus, memory=memories, usefulness=st.sampled_from(["Absolute", "Relative"])),
        storage=_optional(uri=st.just("file:///var/fleet"), replication=st.integers(1, 10)),
        missions=_optional(count=st.integers(1, 100), interval=durations, seed=st.integers(0, 2**53 - 1)),
        suspend=st.booleans(),
    )
    metadata = {"name": draw(names), "labels": draw(st.dictionaries(names, texts, max_size=2))}
    return {"apiVersion": API, "kind": "FleetSpec", "metadata": metadata, "spec": spec | draw(settings)}
