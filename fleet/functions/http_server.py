"""The HTTP contract from the function's side, and how any role serves HTTP; the door to Starlette and uvicorn."""

from __future__ import annotations

import asyncio
import contextlib
import faulthandler
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from typing import Any, Literal

import uvicorn
from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from fleet.errors import ExitCode, FleetError
from fleet.functions import wire
from fleet.functions.calls import Failure, failure_of, timed_out
from fleet.functions.checks import check_evaluation, check_ssv
from fleet.functions.compose import declared
from fleet.functions.resolve import resolve, version_of

Kind = Literal["Map", "Eval"]
_WATCHDOG_S = 15.0
_MAX_TRACEBACK = 8000


def serve_function(kind: Kind, reference: str, host: str, port: int, timeout_s: float) -> None:
    """Import `module:function` and serve it until SIGTERM; what `fleet serve` does.

    Raises:
        FunctionError: the function cannot be imported.
        FleetError: the address cannot be bound.
        SystemExit: with code 75, after a call that hung.
    """
    run_server(function_app(kind, resolve(reference), timeout_s), host, port, watchdog_s=timeout_s + _WATCHDOG_S)


def function_app(kind: Kind, function: Callable[..., Any], timeout_s: float) -> Starlette:
    """The HTTP contract around a Map() or an Eval(); see docs/functions.md.

    Calls run one at a time in a thread of their own, so that /healthz answers meanwhile and user code need not be
    safe for threads. A call over `timeout_s` is answered with status 504; since Python cannot stop a thread, the
    server then ends with exit code 75, and its supervisor starts a fresh one.
    """
    served = _ServedMap(function) if kind == "Map" else _ServedEval(function)
    turn = asyncio.Semaphore(1)
    hung = False

    async def describe(_: Request) -> Response:
        return _json(200, {"kind": kind, "features": served.features, "version": served.version})

    async def answer(request: Request) -> Response:
        try:
            body = await _body(request)
        except wire.WireError as error:
            return _refuse(413, Failure(str(error), "TooLarge"))
        async with turn:
            nonlocal hung
            if hung:
                return _refuse(503, Failure("the server is ending after a call that hung; try again soon", "Ending"))
            try:
                status, data = await asyncio.wait_for(_in_thread(lambda: _answer(served, body)), timeout_s)
            except TimeoutError:
                stop = getattr(request.app.state, "stop", None)
                hung = stop is not None
                return _refuse(504, timed_out(timeout_s), BackgroundTask(stop, ExitCode.TRANSIENT) if stop else None)
        return Response(data, status, media_type="application/json")

    routes = [Route("/healthz", health), Route("/describe", describe)]
    return Starlette(routes=[*routes, Route("/map" if kind == "Map" else "/eval", answer, methods=["POST"])])


async def health(_: Request) -> Response:
    """GET /healthz: the process answers."""
    return _json(200, {"status": "ok"})


def run_server(app: Starlette, host: str, port: int, watchdog_s: float | None = None) -> None:
    """Serve an application until SIGTERM or SIGINT; open requests are finished first, for at most 5 s.

    The application may end the server with a code of its own by calling `app.state.stop(code)`.

    Args:
        port: 0 takes any free port; the address is printed on stderr either way.
        watchdog_s: When given, the process is ended if its event loop stands still for so long, because user code
            holds the interpreter's lock; every thread's stack is printed then.

    Raises:
        FleetError: the address cannot be bound.
        SystemExit: `app.state.stop` was called with a code other than 0.
    """
    sock = _listen(host, port)
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, timeout_keep_alive=75, timeout_graceful_shutdown=5
    )
    server = _Server(config)
    code = 0

    def stop(wanted: int) -> None:
        nonlocal code
        code = int(wanted)
        server.should_exit = True

    app.state.stop = stop
    address, bound = sock.getsockname()[:2]
    print(f"listening on http://{address}:{bound}", file=sys.stderr, flush=True)  # noqa: T201  # for its supervisor
    asyncio.run(_serve(server, sock, watchdog_s))
    if code:
        sys.exit(code)


class _Server(uvicorn.Server):
    """uvicorn, but a signal ends `serve` instead of being raised again: a graceful stop has exit code 0."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop on SIGTERM and SIGINT; outside of the main thread Python takes no signals."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self.handle_exit) for number in (signal.SIGTERM, signal.SIGINT)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


async def _serve(server: _Server, sock: socket.socket, watchdog_s: float | None) -> None:
    beat = asyncio.create_task(_heartbeat(watchdog_s)) if watchdog_s else None
    try:
        await server.serve(sockets=[sock])
    finally:
        if beat:
            beat.cancel()
            faulthandler.cancel_dump_traceback_later()


async def _heartbeat(watchdog_s: float) -> None:
    """Put off the end of the process once a second; faulthandler's timer needs no interpreter lock."""
    while True:
        faulthandler.dump_traceback_later(watchdog_s, exit=True)
        await asyncio.sleep(1.0)


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        sock = socket.create_server((host, port), family=family, backlog=128)
    except (OSError, OverflowError) as error:
        raise FleetError(f"cannot listen on {host} port {port}: {error}; choose another address or port") from error
    # asyncio does so only for sockets that it has opened itself; without, each answer waits 40 ms for an ACK.
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return sock


class _ServedMap:
    """Map() between the bodies of the contract."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        known = declared(function)
        self._features = None if known is None else tuple(feature.name for feature in known)
        self.version = version_of(function)

    @property
    def features(self) -> list[str]:
        return list(self._features or ())

    def answer(self, message: dict[str, Any]) -> Callable[[], dict[str, Any]]:
        observation = wire.decode_observation(message)

        def call() -> dict[str, Any]:
            self._features, values = check_ssv(self._function(observation), self._features)
            return {"ssv": dict(zip(self._features, values.tolist(), strict=True))}

        return call


class _ServedEval:
    """Eval() between the bodies of the contract."""

    features: tuple[str, ...] = ()

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self.version = version_of(function)

    def answer(self, message: dict[str, Any]) -> Callable[[], dict[str, Any]]:
        fs, metrics = wire.decode_evaluation_request(message)
        return lambda: wire.encode_evaluation(check_evaluation(self._function(fs, metrics), fs.environment.grid))


def _answer(served: _ServedMap | _ServedEval, body: bytes) -> tuple[int, bytes]:
    """Status and body for a request; runs in a thread."""
    try:
        call = served.answer(wire.load(body))
    except wire.WireError as error:
        return 400, _error(Failure(f"the request is not as docs/functions.md says: {error}", "BadRequest"))
    try:
        return 200, wire.dump(call())
    except BaseException as error:  # noqa: BLE001  # SystemExit too: user code must not end the server silently
        return 500, _error(failure_of(error, "".join(traceback.format_exception(error))[-_MAX_TRACEBACK:]))


async def _body(request: Request) -> bytes:
    """Body of a request. Raises WireError as soon as it is too long."""
    data = bytearray()
    announced = request.headers.get("content-length", "0")
    too_long = announced.isdigit() and int(announced) > wire.MAX_REQUEST_BYTES
    with contextlib.suppress(ClientDisconnect):
        async for chunk in request.stream():
            if not too_long:
                data += chunk
                too_long = len(data) > wire.MAX_REQUEST_BYTES
            if too_long:
                break
    if too_long:
        raise wire.WireError(f"the request is over {wire.MAX_REQUEST_BYTES // 2**20} MiB; send less media at once")
    return bytes(data)


def _in_thread(call: Callable[[], tuple[int, bytes]]) -> asyncio.Future[tuple[int, bytes]]:
    """Run in a daemon thread: unlike an executor's, it does not keep a process alive that wants to end."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[tuple[int, bytes]] = loop.create_future()

    def settle(result: tuple[int, bytes]) -> None:
        if not future.done():
            future.set_result(result)

    def run() -> None:
        result = call()
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody waits any more
            loop.call_soon_threadsafe(settle, result)

    threading.Thread(target=run, name="function call", daemon=True).start()
    return future


def _error(failure: Failure) -> bytes:
    error = {"message": failure.message, "type": failure.type, "extractor": failure.extractor}
    if failure.traceback:
        error["traceback"] = failure.traceback
    return wire.dump({"error": error})


def _refuse(status: int, failure: Failure, task: BackgroundTask | None = None) -> Response:
    headers = {"connection": "close"} if status >= 503 else {}
    return Response(_error(failure), status, headers, "application/json", task)


def _json(status: int, message: dict[str, Any]) -> Response:
    return Response(wire.dump(message), status, media_type="application/json")
