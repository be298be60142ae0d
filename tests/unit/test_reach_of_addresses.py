"""Which addresses of FleetSpecs the operator opens."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.errors import SpecError
from fleet_operator.flow.reach import Reach
from tests.reconciled import Reconciled

USES = ["Shaping", "Training", "Mission"]
OWN = "webhdfs://fleet@namenode.fleet-system:9870/fleet"


@pytest.mark.parametrize(
    ("uri", "hosts", "allowed"),
    [
        ("webhdfs://anybody:1/x", (), True),
        (OWN, ("elsewhere",), True),
        ("webhdfs://alice@NameNode.fleet-system/other", ("elsewhere",), True),
        ("webhdfs://namenode.fleet-system:6443/fleet", ("elsewhere",), False),
        ("webhdfs://elsewhere:9870/x", ("elsewhere",), True),
        ("webhdfs://elsewhere:50070/x", ("elsewhere",), True),
        ("webhdfs://elsewhere:50070/x", ("elsewhere:9870",), False),
        ("webhdfs://elsewhere/x", ("elsewhere:9870",), True),
        ("webhdfs://elsewhere,stranger:9870/x", ("elsewhere",), False),
        ("webhdfs://elsewhere@stranger/x", ("elsewhere",), False),
        ("webhdfs://nn1.farm.example:9870/x", ("*.farm.example",), True),
        ("webhdfs://nn1.farm.example:9870/x", ("*.farm.example:9870",), True),
        ("webhdfs://nn1.farm.example:6443/x", ("*.farm.example:9870",), False),
        ("webhdfs://farm.example.stranger:9870/x", ("*.farm.example",), False),
        ("webhdfs://xfarm.example/x", ("*.farm.example",), False),
        ("webhdfs://[fd00::1]:9870/x", ("[fd00::1]",), True),
        ("webhdfs://[fd00::2]/x", ("[fd00::1]",), False),
        ("webhdfs://[fd00::2/x", (), False),
    ],
)
def test_hosts_beside_that_of_the_installation_are_opened_when_it_says_so(
    uri: str, hosts: tuple[str, ...], allowed: bool
) -> None:
    assert opens(Reach(OWN, hosts), uri) is allowed


@pytest.mark.parametrize(
    ("own", "uri", "allowed"),
    [
        (OWN, "file:///fleet/storage", False),
        (OWN, "file:///dev", False),
        ("file:///fleet/storage", "file:///fleet/storage", True),
        ("file:///fleet/storage", "file:///fleet/storage/of-crops", True),
        ("file:///fleet/storage", "file:///fleet/storage-2", False),
        ("file:///fleet/storage", "file:///fleet/storage/../../etc", False),
        ("file:///fleet/storage", "file:///fleet/storage/%2e%2e/%2e%2e/etc", False),
        ("file:///fleet/storage", "file:////etc", False),
        ("file:///fleet/storage", "webhdfs://elsewhere/x", True),
    ],
)
def test_folders_are_opened_below_the_one_of_the_installation_only(own: str, uri: str, allowed: bool) -> None:
    assert opens(Reach(own), uri) is allowed


def opens(reach: Reach, uri: str) -> bool:
    try:
        reach.check(uri)
    except SpecError:
        return False
    return True


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            {"storage": {"uri": "webhdfs://fleet@elsewhere:9870/fleet"}},
            "spec.storage.uri: elsewhere:9870 is no host that this installation opens; it opens namenode",
        ),
        (
            {"contexts": [{"name": "field", "uri": "webhdfs://elsewhere/x", "use": USES}]},
            "spec.contexts[0].uri: elsewhere:9870 is no host that this installation opens",
        ),
        (
            {"contexts": [{"name": "field", "uri": "file:///etc", "use": USES}]},
            "spec.contexts[0].uri: no volume holds the folder /etc",
        ),
        ({"storage": {"uri": "file:///etc"}}, "spec.storage.uri: no volume holds the folder /etc"),
    ],
)
def test_a_fleetspec_that_leads_elsewhere_is_refused_and_nothing_is_opened(
    tmp_path: Path, quick_disk: None, spec: dict[str, object], message: str
) -> None:
    run = Reconciled(tmp_path)
    run.restart(hosts=("namenode",))
    run.ask(**spec)
    run.look()
    assert run.conditions()["Compiled"] == ("False", "Invalid")
    assert message in run.message("Compiled")
    assert run.storage_calls == ["read _claims/default.plots.json"]
