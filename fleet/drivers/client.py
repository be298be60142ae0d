"""The other side of a sensor role: the vehicle as the AS workflow sees it."""

from __future__ import annotations

from typing import Any

import httpx

from fleet.clock import Clock
from fleet.contexts.base import Environment, Observation
from fleet.drivers.port import OutOfStep, Telemetry
from fleet.errors import DriverError
from fleet.functions.wire import decode_environment, decode_observation

_FIRST_PAUSE_S = 0.05
_LONGEST_PAUSE_S = 2.0
_CONFLICT = 409
_OK = 200


class SensorClient:
    """Talks to one sensor role; waits while that role is started again.

    Args:
        url: Address of the sensor role.
        clock: Waits between tries.
        patience_s: How long a sensor that cannot be reached is waited for.
        timeout_s: How long one command may take; a sensor that hangs for longer counts as one that is gone.

    Raises:
        DriverError: from any method: the sensor refused, or could not be reached for `patience_s`.
    """

    def __init__(self, url: str, clock: Clock, patience_s: float = 60.0, timeout_s: float = 120.0) -> None:
        self._url = url
        self._clock = clock
        self._patience_s = patience_s
        self._client = httpx.Client(base_url=url, timeout=httpx.Timeout(timeout_s, connect=5.0), trust_env=False)

    def environment(self) -> Environment:
        """Where the mission flies."""
        return decode_environment(self._call("GET", "/environment"))

    def telemetry(self) -> Telemetry:
        """Where the vehicle is."""
        return Telemetry(**self._call("GET", "/telemetry"))

    def act(self, number: int, command: str) -> Telemetry:
        """Carry out a command; see `Driver.act`."""
        return Telemetry(**self._call("POST", "/act", {"number": number, "command": command}))

    def sense(self, executed: int) -> Observation:
        """Sense in the current state; see `Driver.sense`."""
        return decode_observation(self._call("POST", "/sense", {"executed": executed}))

    def release(self) -> None:
        """Tell the sensor role that the mission is over; one that is gone already is fine."""
        try:
            self._client.post("/release", json={}, timeout=5.0)
        except httpx.TransportError:
            return

    def _call(self, method: str, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        answer = self._reach(method, path, body)
        try:
            document: dict[str, Any] = answer.json()
        except ValueError as error:
            raise DriverError(f"the sensor at {self._url}{path} did not answer with JSON") from error
        if answer.status_code == _CONFLICT:
            raise OutOfStep(str(document.get("error", "")))
        if answer.status_code != _OK:
            raise DriverError(f"the sensor refused {path}: {document.get('error', answer.status_code)}")
        return document

    def _reach(self, method: str, path: str, body: dict[str, Any] | None) -> httpx.Response:
        deadline = self._clock.now() + self._patience_s
        pause = _FIRST_PAUSE_S
        while True:
            try:
                return self._client.request(method, path, json=body)
            except httpx.TransportError as error:
                if self._clock.now() + pause > deadline:
                    raise DriverError(f"the sensor at {self._url} cannot be reached: {error}") from error
            self._clock.sleep(pause)
            pause = min(2 * pause, _LONGEST_PAUSE_S)
