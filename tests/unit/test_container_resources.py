"""Requests and limits: the FleetSpec's go before defaults, and a request is never above its limit."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.errors import SpecError
from fleet.spec.base import Amounts, Resources, quantity_value
from fleet_operator.compiler.defaults import SMALLEST_AGGREGATOR
from fleet_operator.compiler.quantities import cpu_text, memory_text, of_share, settled, whole_cores
from fleet_operator.policy.shares import Capacity, Share

DEFAULT = Resources(requests=Amounts(cpu="100m", memory="128Mi"), limits=Amounts(cpu="1", memory="512Mi"))
CPU = st.none() | st.sampled_from(["10m", "100m", "500m", "1", "1.5", "4"])
MEMORY = st.none() | st.sampled_from(["1Mi", "128Mi", "1Gi", "512M", "100000"])
AMOUNTS = st.builds(Amounts, cpu=CPU, memory=MEMORY)


def test_what_is_left_out_is_the_default() -> None:
    assert settled(Resources(), DEFAULT, "spec.map.resources") == DEFAULT


def test_a_default_request_gives_way_to_a_small_limit() -> None:
    given_limits = Resources(limits=Amounts(cpu="50m", memory="64Mi"))
    assert settled(given_limits, DEFAULT, "x") == Resources(
        requests=Amounts(cpu="50m", memory="64Mi"), limits=Amounts(cpu="50m", memory="64Mi")
    )


def test_a_default_limit_gives_way_to_a_large_request() -> None:
    given_requests = Resources(requests=Amounts(cpu="2", memory="1Gi"))
    assert settled(given_requests, DEFAULT, "x") == Resources(
        requests=Amounts(cpu="2", memory="1Gi"), limits=Amounts(cpu="2", memory="1Gi")
    )


def test_a_request_above_its_limit_is_refused_with_its_place() -> None:
    wrong = Resources(requests=Amounts(cpu="2"), limits=Amounts(cpu="1"))
    with pytest.raises(SpecError) as caught:
        settled(wrong, DEFAULT, "spec.map.resources")
    assert str(caught.value) == (
        "spec.map.resources.requests.cpu: the request 2 is above the limit 1; lower the request or raise the limit"
    )


@given(AMOUNTS, AMOUNTS)
@settings(max_examples=150)
def test_no_request_is_ever_above_its_limit_and_what_is_given_is_kept(requests: Amounts, limits: Amounts) -> None:
    given_resources = Resources(requests=requests, limits=limits)
    try:
        result = settled(given_resources, DEFAULT, "x")
    except SpecError:
        return
    for kind in ("cpu", "memory"):
        request, limit = getattr(result.requests, kind), getattr(result.limits, kind)
        assert quantity_value(request) <= quantity_value(limit)
        assert getattr(requests, kind) in {None, request}
        assert getattr(limits, kind) in {None, limit}


@given(st.floats(0, 64), st.integers(0, 2**36))
@settings(max_examples=100)
def test_a_share_is_never_below_what_an_aggregator_needs(cores: float, memory_bytes: int) -> None:
    capacity = Capacity(cores, memory_bytes)
    share = Share(capacity, Capacity(cores / 10, memory_bytes / 10))
    resources = of_share(share, SMALLEST_AGGREGATOR)
    assert quantity_value(str(resources.limits.cpu)) >= max(0.05, cores - 0.0011)
    assert quantity_value(str(resources.limits.memory)) >= max(160 * 2**20, memory_bytes - 2**20)
    assert quantity_value(str(resources.requests.memory)) < quantity_value(str(resources.limits.memory))


def test_quantities_are_written_as_kubernetes_writes_them() -> None:
    assert [cpu_text(cores) for cores in (0.1 + 0.2, 2.0, 0.1333333)] == ["300m", "2", "133m"]
    assert memory_text(3 * 2**20 + 5) == "3Mi"
    assert [whole_cores(Resources(limits=Amounts(cpu=cpu))) for cpu in ("500m", "1900m", "4")] == [1, 1, 4]
