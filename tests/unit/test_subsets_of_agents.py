from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fleet.aggregation.subsets import Subset, key_of, subsets_for
from fleet.errors import FunctionError, SpecError
from fleet.spec.resources import Fleet


def fleet_of(agents: int, **aggregation: Any) -> Fleet:
    return Fleet.model_validate(
        {
            "agents": {"count": agents},
            "stateSpace": {"context": "c"},
            "map": {"function": "a:b"},
            "eval": {"function": "a:b"},
            "contexts": [{"name": "c", "uri": "c", "use": ["Shaping", "Training", "Mission"]}],
            "goals": [{"metric": "accuracy", "atLeast": 0.7}],
            "aggregation": aggregation,
        }
    )


def keys(agents: int, **aggregation: Any) -> list[str]:
    return [subset.key for subset in subsets_for(fleet_of(agents, **aggregation))]


def test_the_powerset_has_every_subset_but_the_empty_one_the_small_ones_first() -> None:
    assert subsets_for(fleet_of(2)) == (
        Subset(("agent-1",), "1"),
        Subset(("agent-2",), "2"),
        Subset(("agent-1", "agent-2"), "1-2"),
    )
    assert keys(3) == ["1", "2", "3", "1-2", "1-3", "2-3", "1-2-3"]
    assert len(keys(8)) == 255


def test_above_eight_agents_each_and_all_is_the_default() -> None:
    assert keys(9) == ["1", "2", "3", "4", "5", "6", "7", "8", "9", "all"]


def test_a_powerset_that_is_too_large_is_refused_by_whoever_made_the_fleet() -> None:
    fleet = fleet_of(9)
    forced = fleet.model_copy(update={"aggregation": fleet_of(2, kind="Powerset").aggregation})
    with pytest.raises(SpecError, match="511 members; it goes up to 8 agents; write EachAndAll"):
        subsets_for(forced)


@pytest.mark.parametrize(
    ("agents", "expected"),
    [(1, ["1"]), (2, ["1-2"]), (3, ["1-2", "1-2-3", "2-3"]), (4, ["1-2", "1-2-3", "2-3-4", "3-4"])],
)
def test_neighbours_are_the_agents_before_and_after_in_the_order_of_visit(agents: int, expected: list[str]) -> None:
    assert keys(agents, kind="Neighbours") == expected


def test_equal_subsets_are_one() -> None:
    assert keys(1, kind="EachAndAll") == ["1"]
    assert keys(2, kind="EachAndAll") == ["1", "2", "1-2"]


@pytest.mark.parametrize("agents", [1, 8, 9, 40, 1000])
@pytest.mark.parametrize("kind", ["EachAndAll", "Neighbours"])
def test_keys_are_short_different_parts_of_dns_labels(agents: int, kind: str) -> None:
    found = keys(agents, kind=kind)
    assert len(set(found)) == len(found)
    assert all(re.fullmatch(r"[a-z0-9]([a-z0-9-]{0,18}[a-z0-9])?", key) for key in found)


def test_long_subsets_have_a_hash_that_depends_on_the_agents_alone() -> None:
    many = list(range(1, 10))
    assert key_of(many, 12) == key_of(many, 20) != key_of(range(2, 11), 12)
    assert key_of(many, 9) == "all"
    assert key_of([997, 998, 999, 1000], 1000) == "997-998-999-1000"
    assert re.fullmatch(r"h[0-9a-f]{16}", key_of([995, 996, 997, 998, 999, 1000], 1000))


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Writes the user's aggregation function, and names it."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(body: str) -> str:
        (tmp_path / "own_aggregation.py").write_text(f"def subsets(agents):\n    {body}\n")
        return "own_aggregation:subsets"

    yield write
    sys.modules.pop("own_aggregation", None)


def test_the_users_own_subsets_are_taken_in_their_order_each_once(own: Any) -> None:
    reference = own("return [agents[1:], (agents[0],), [agents[2], agents[1]]]")
    assert subsets_for(fleet_of(3, kind="Custom", function=reference)) == (
        Subset(("agent-2", "agent-3"), "2-3"),
        Subset(("agent-1",), "1"),
    )


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise KeyError('x')", "own_aggregation:subsets: raised KeyError: 'x'"),
        ("return None", "answered None; it must answer a list of lists"),
        ("return []", r"answered \[\]; it must answer a list of lists"),
        ("return 'agent-1'", "it must answer a list of lists"),
        ("return agents", "a subset is a list of at least one agent's name"),
        ("return [[]]", "a subset is a list of at least one agent's name"),
        ("return [['agent-9']]", "answered 'agent-9', which is no agent; agents: agent-1, agent-2"),
        ("return [[1]]", "answered 1, which is no agent"),
        ("return [[['agent-1']]]", "which is no agent"),
        ("return [['agent-1', 'agent-1']]", "which has an agent twice"),
        ("return [agents] * 256", "answered 256 subsets; at most 255 are aggregated"),
    ],
)
def test_a_wrong_answer_of_the_users_function_says_what_to_mend(own: Any, body: str, message: str) -> None:
    with pytest.raises(FunctionError, match=message):
        subsets_for(fleet_of(2, kind="Custom", function=own(body)))
