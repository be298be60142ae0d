"""What `helm test` runs: the operator is ready, the resources are served, storage keeps what it is given.

Environment: OPERATOR (http://host:port), STORAGE (address), TIMEOUT_S, ACCOUNT (folder of a service account) and what
Kubernetes tells every pod.
"""

from __future__ import annotations

import json
import os
import ssl
import sys
import time
import urllib.request
import uuid
from collections.abc import Callable
from pathlib import Path

from fleet.errors import FleetError
from fleet.storage.open import open_storage

KINDS = {"fleetspecs", "missions", "edgenodes"}
PAUSE_S = 2.0
NO_PROXY = urllib.request.ProxyHandler({})  # between two pods, whatever the environment says
DIRECT = urllib.request.build_opener(NO_PROXY)


class CheckError(Exception):
    """The installation is not, or not yet, as it should be."""


def say(text: str) -> None:
    """One line for `kubectl logs`, at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def operator_is_ready() -> str:
    """The operator says that it works, or waits for its lease."""
    with DIRECT.open(f"{os.environ['OPERATOR']}/readyz", timeout=5) as answer:
        return f"the operator is ready (HTTP {answer.status})"


def resources_are_served() -> str:
    """The API server has our group and its three kinds."""
    address = f"https://{os.environ['KUBERNETES_SERVICE_HOST']}:{os.environ['KUBERNETES_SERVICE_PORT']}"
    account = Path(os.environ["ACCOUNT"])
    token = (account / "token").read_text()
    request = urllib.request.Request(
        f"{address}/apis/fleetcomputer.io/v1alpha1", headers={"Authorization": f"Bearer {token}"}
    )
    context = ssl.create_default_context(cafile=str(account / "ca.crt"))
    api = urllib.request.build_opener(NO_PROXY, urllib.request.HTTPSHandler(context=context))
    with api.open(request, timeout=5) as answer:
        found = {resource["name"] for resource in json.load(answer)["resources"]}
    if not found >= KINDS:
        raise CheckError(f"the API server does not serve {', '.join(sorted(KINDS - found))}")
    return f"the API server serves {', '.join(sorted(KINDS))}"


def storage_keeps() -> str:
    """An object can be written, read back and deleted, as the roles of a fleet do it."""
    storage = open_storage(os.environ["STORAGE"])
    folder = f"_test/{uuid.uuid4()}"
    content = os.urandom(100_000)
    storage.write(f"{folder}/object", content)
    try:
        if storage.read(f"{folder}/object") != content:
            raise CheckError("storage gave back something else than was written")
    finally:
        storage.delete(folder)
    if storage.list(folder):
        raise CheckError("storage still lists what was deleted")
    return f"storage at {os.environ['STORAGE']} wrote, read and deleted"


def passes(check: Callable[[], str], deadline_s: float) -> bool:
    """Whether a check passes before the deadline; says how it ended."""
    while True:
        try:
            say(f"ok    {check()}")
        except (OSError, ValueError, FleetError, CheckError) as error:
            if time.monotonic() < deadline_s:
                time.sleep(PAUSE_S)
                continue
            say(f"FAIL  {check.__doc__} {type(error).__name__}: {error}")
            return False
        return True


def main() -> int:
    """Runs every check; 1 when one fails."""
    deadline_s = time.monotonic() + float(os.environ["TIMEOUT_S"])
    results = [passes(check, deadline_s) for check in (operator_is_ready, resources_are_served, storage_keeps)]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
