"""A driver behind HTTP: the routes of the sensor role.

GET /environment, GET /telemetry, POST /act {number, command}, POST /sense {executed}, POST /release.
Status 409 says that the caller and the vehicle are out of step; 422 that a command is muted or a body is wrong.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import asdict
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from fleet.contexts.base import Environment
from fleet.drivers.port import Driver, OutOfStep
from fleet.errors import FleetError
from fleet.functions import wire
from fleet.functions.http_server import health

_Handler = Callable[[Request], Awaitable[Response]]


def driver_app(driver: Driver) -> Starlette:
    """The routes of the sensor role around a driver; commands run one at a time.

    Returns:
        An application; its `state.stop(code)` (set by `run_server`) is called when the mission releases the sensor.
    """
    limiter = anyio.CapacityLimiter(1)
    environment = _EncodedEnvironment()

    async def read_environment(_: Request) -> Response:
        return Response(environment.of(driver.environment), media_type="application/json")

    async def telemetry(_: Request) -> Response:
        return _json(200, asdict(driver.telemetry()))

    async def act(request: Request) -> Response:
        body = wire.load(await request.body())
        number, command = int(body["number"]), str(body["command"])
        return _json(200, asdict(await anyio.to_thread.run_sync(driver.act, number, command, limiter=limiter)))

    async def sense(request: Request) -> Response:
        executed = int(wire.load(await request.body())["executed"])
        observation = await anyio.to_thread.run_sync(driver.sense, executed, limiter=limiter)
        return _json(200, wire.encode_observation(observation))

    async def release(request: Request) -> Response:
        request.app.state.stop(0)
        return _json(200, {})

    routes = [
        Route("/healthz", health),
        Route("/environment", _guarded(read_environment)),
        Route("/telemetry", _guarded(telemetry)),
        Route("/act", _guarded(act), methods=["POST"]),
        Route("/sense", _guarded(sense), methods=["POST"]),
        Route("/release", _guarded(release), methods=["POST"]),
    ]
    return Starlette(routes=routes)


class _EncodedEnvironment:
    """The environment's message, encoded once: every workflow asks for the same."""

    def __init__(self) -> None:
        self._digest = ""
        self._data = b""

    def of(self, environment: Environment) -> bytes:
        if environment.digest != self._digest or not self._data:
            self._digest, self._data = environment.digest, wire.dump(wire.encode_environment(environment))
        return self._data


def _guarded(handler: _Handler) -> _Handler:
    async def guarded(request: Request) -> Response:
        try:
            return await handler(request)
        except OutOfStep as error:
            return _json(409, {"error": str(error)})
        except (FleetError, wire.WireError, KeyError, ValueError, TypeError) as error:
            return _json(422, {"error": str(error) or type(error).__name__})

    return guarded


def _json(status: int, message: dict[str, Any]) -> Response:
    return Response(wire.dump(message), status, media_type="application/json")
