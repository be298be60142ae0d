"""The control plane without machines: users, the audit log, a restart, and several side by side."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.testbed.access import Access
from tests.testbed.audit import Request
from tests.testbed.control_plane import ControlPlane
from tests.testbed.control_plane import control_plane as run_control_plane

pytestmark = pytest.mark.xdist_group("control-plane")


def test_controllers_make_the_pods_of_a_job_and_collect_them_with_it(control_plane: ControlPlane) -> None:
    plane = control_plane
    plane.kubectl("create", "namespace", "bed-jobs")
    plane.kubectl("create", "job", "work", "--image=none", "--namespace=bed-jobs")
    plane.kubectl("wait", "pod", "--selector=job-name=work", "--for=create", "--namespace=bed-jobs", "--timeout=30s")
    plane.kubectl("delete", "job", "work", "--cascade=foreground", "--namespace=bed-jobs", "--timeout=30s")
    assert plane.get("pods", "--namespace=bed-jobs")["items"] == []
    plane.kubectl("delete", "namespace", "bed-jobs", "--wait=false")


def test_two_control_planes_side_by_side_know_nothing_of_each_other(
    control_plane: ControlPlane, tmp_path: Path
) -> None:
    with run_control_plane(tmp_path, controllers=False, audit=True) as other:
        assert other.url != control_plane.url
        other.kubectl("create", "namespace", "only-there")
        assert control_plane.try_kubectl("get", "namespace", "only-there").returncode == 1

        user = Access(other.user("anna", ["crew"]))
        other.kubectl("create", "role", "reader", "--verb=get,list", "--resource=configmaps")
        other.kubectl("create", "rolebinding", "readers", "--role=reader", "--group=crew")
        names = [one["metadata"]["name"] for one in user.get("configmaps")["items"]]
        assert names == []
        refused = user.try_kubectl("get", "secrets")
        assert 'User "anna" cannot list resource "secrets"' in refused.stderr

        url = other.url
        other.restart_api_server()
        assert other.url == url
        assert other.get("namespace", "only-there")["status"]["phase"] == "Active"
        assert [one for one in other.requests() if one.user == "anna" and one.resource] == [
            _list("configmaps", 200),
            _list("secrets", 403),
        ]


def _list(resource: str, code: int) -> Request:
    path = f"/api/v1/namespaces/default/{resource}?limit=500"
    return Request("anna", "list", "", resource, "default", "", code, path)
