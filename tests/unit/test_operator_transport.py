"""Calls to an API server that is slow, throttles, breaks off, or refuses."""

from __future__ import annotations

import asyncio
import json
import math
import random
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

from fleet_operator.cluster import errors
from fleet_operator.cluster.credentials import Credentials
from fleet_operator.cluster.transport import APPLY, Call, Transport

OK: tuple[int, dict[str, Any]] = (200, {"kind": "ConfigMap"})
DROP = (0, {})


def refusal(status: int, reason: str = "", message: str = "", **details: Any) -> tuple[int, dict[str, Any]]:
    return status, {"kind": "Status", "reason": reason, "message": message, "details": details, "code": status}


@dataclass
class Script:
    """A server that gives its answers one after the other, and notes what it was asked."""

    answers: list[tuple[int, dict[str, Any]]]
    asked: list[str] = field(default_factory=list)
    tokens: list[str] = field(default_factory=list)
    bodies: list[str] = field(default_factory=list)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        lines = dict(line.split(": ", 1) for line in head.split("\r\n")[1:] if line)
        self.asked.append(head.split(" HTTP")[0])
        self.tokens.append(lines.get("Authorization", ""))
        self.bodies.append((await reader.readexactly(int(lines.get("Content-Length", "0")))).decode())
        status, content = self.answers.pop(0)
        if status:
            body = json.dumps(content).encode()
            writer.write(f"HTTP/1.1 {status} X\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n".encode())
            writer.write(body)
            await writer.drain()
        writer.close()
        await writer.wait_closed()


class Door:
    """A transport to a script, with pauses that take no time but are noted."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.counted: list[tuple[str, int]] = []
        self.pauses: list[float] = []
        self.left_s = math.inf
        self.token = "first"

    def talk(self, script: Script, scene: Callable[[Transport], Awaitable[Any]]) -> Any:
        """What comes of a scene."""

        async def play() -> Any:
            server = await asyncio.start_server(script.serve, "127.0.0.1", 0)
            credentials = Credentials({"KUBECONFIG": str(self._kubeconfig(server.sockets[0].getsockname()[1]))})
            self._kubeconfig(server.sockets[0].getsockname()[1], "second")  # what a second look at the file finds
            async with server:
                transport = Transport(credentials, 2, lambda: self.left_s, self._count, random.Random(0))
                transport.pause_s = self._pause  # type: ignore[method-assign]  # no test waits for a back-off
                async with transport:
                    return await scene(transport)

        return asyncio.run(asyncio.wait_for(play(), 60.0))

    def send(self, script: Script, call: Call) -> dict[str, Any]:
        answer: dict[str, Any] = self.talk(script, lambda transport: transport.send(call))
        return answer

    def _pause(self, attempt: int) -> float:
        self.pauses.append(attempt)
        return 0.0

    def _count(self, verb: str, status: int) -> None:
        self.counted.append((verb, status))

    def _kubeconfig(self, port: int, token: str = "first") -> Path:
        path = self.folder / "kubeconfig"
        cluster = {"name": "c", "cluster": {"server": f"http://127.0.0.1:{port}"}}
        user = {"name": "u", "user": {"token": token}}
        context = {"name": "x", "context": {"cluster": "c", "user": "u"}}
        content = {"clusters": [cluster], "users": [user], "contexts": [context], "current-context": "x"}
        path.write_text(json.dumps({"apiVersion": "v1", "kind": "Config", **content}))
        return path


@pytest.fixture
def door(tmp_path: Path) -> Door:
    return Door(tmp_path)


PATCH = Call("patch", "/api/v1/namespaces/farm/configmaps/a", {"a": 1}, {"force": "true"}, APPLY)


def test_a_call_says_who_calls_and_carries_its_body(door: Door) -> None:
    script = Script([OK])
    assert door.send(script, PATCH) == {"kind": "ConfigMap"}
    assert script.asked == ["PATCH /api/v1/namespaces/farm/configmaps/a?force=true"]
    assert (script.tokens, script.bodies) == (["Bearer first"], ['{"a":1}'])
    assert door.counted == [("patch", 200)]


@pytest.mark.parametrize(
    "passing",
    [
        refusal(429, "TooManyRequests"),
        refusal(500, "InternalError"),
        refusal(503, "ServiceUnavailable"),
        refusal(504, "Timeout"),
        DROP,
    ],
    ids=["429", "500", "503", "504", "dropped"],
)
def test_what_is_passing_is_tried_again_with_back_off(door: Door, passing: tuple[int, dict[str, Any]]) -> None:
    script = Script([passing, passing, OK])
    assert door.send(script, PATCH) == {"kind": "ConfigMap"}
    assert len(script.asked) == 3
    assert door.pauses == [1, 2]


def test_a_call_is_given_up_after_its_tries(door: Door) -> None:
    script = Script([refusal(503, "ServiceUnavailable", "etcd is away")] * 5)
    with pytest.raises(errors.Unavailable, match="etcd is away"):
        door.send(script, PATCH)
    assert len(script.asked) == 5


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (refusal(409, "Conflict"), errors.Conflict),
        (refusal(409, "AlreadyExists"), errors.Conflict),
        (refusal(403, "Forbidden"), errors.Forbidden),
        (refusal(404, "NotFound"), errors.NotFound),
        (refusal(410, "Expired"), errors.Gone),
        (refusal(400, "BadRequest"), errors.Invalid),
        (refusal(422, "Invalid"), errors.Invalid),
    ],
)
def test_a_refusal_is_an_error_of_its_kind_and_not_tried_again(
    door: Door, answer: tuple[int, dict[str, Any]], kind: type[errors.ClusterError]
) -> None:
    answer[1]["message"] = "spec.x: Required value"
    script = Script([answer])
    with pytest.raises(kind) as caught:
        door.send(script, PATCH)
    assert type(caught.value) is kind
    assert str(caught.value) == "patch /api/v1/namespaces/farm/configmaps/a: spec.x: Required value"
    assert (caught.value.reason, caught.value.status) == (answer[1]["reason"], answer[0])


def test_the_wait_that_the_server_asks_for_is_known(door: Door) -> None:
    script = Script([refusal(429, "TooManyRequests", retryAfterSeconds=7)])
    with pytest.raises(errors.Throttled) as caught:
        door.send(script, Call("get", "/api/v1/nodes", tries=1))
    assert caught.value.retry_after_s == 7.0


def test_a_token_that_is_no_longer_good_is_read_anew(door: Door) -> None:
    script = Script([refusal(401, "Unauthorized"), OK])
    assert door.send(script, PATCH) == {"kind": "ConfigMap"}
    assert script.tokens == ["Bearer first", "Bearer second"]


def test_credentials_that_stay_bad_are_an_error(door: Door) -> None:
    with pytest.raises(errors.Unauthorized):
        door.send(Script([refusal(401, "Unauthorized")] * 2), PATCH)


def test_who_may_not_write_sends_nothing_but_reads_and_urgent_calls(door: Door) -> None:
    door.left_s = 0.0
    script = Script([OK, OK])
    with pytest.raises(errors.NotLeading):
        door.send(script, PATCH)
    assert script.asked == []
    door.send(script, Call("list", "/api/v1/nodes"))
    door.send(script, Call("update", "/lease", {}, urgent=True))
    assert script.asked == ["GET /api/v1/nodes", "PUT /lease"]


def test_an_answer_that_does_not_come_in_time_is_an_error(door: Door) -> None:
    class Slow(Script):
        async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.read()  # until the other side gives up
            writer.close()

    with pytest.raises(errors.Unavailable):
        door.send(Slow([]), Call("get", "/api/v1/nodes", tries=1, timeout_s=0.2))
    assert door.counted == [("get", 0)]


def test_a_write_is_given_up_when_the_lease_is_over(door: Door) -> None:
    class Silent(Script):
        async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.read()  # until the other side gives up
            writer.close()

    door.left_s = 0.2
    with pytest.raises(errors.Unavailable):
        door.send(Silent([]), replace(PATCH, tries=1, timeout_s=3600.0))
    assert door.counted == [("patch", 0)]


def test_lines_of_a_watch_come_whole_however_they_are_cut(door: Door) -> None:
    lines = [b'{"a":1}', b'{"long":"' + b"x" * 200_000 + b'"}', b'{"b":2}']

    class Cut(Script):
        async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.readuntil(b"\r\n\r\n")
            writer.write(b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n")
            stream = b"".join(line + b"\n" for line in lines)
            for start in range(0, len(stream), 70_001):
                writer.write(stream[start : start + 70_001])
                await writer.drain()
            writer.close()

    async def follow(transport: Transport) -> list[bytes]:
        return [line async for some in transport.watch("/api/v1/nodes", {"watch": "1"}, 30.0) for line in some]

    assert door.talk(Cut([]), follow) == lines
    assert door.counted == [("watch", 200)]


def test_a_watch_without_a_sign_of_life_is_broken(door: Door) -> None:
    class Silent(Script):
        async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"HTTP/1.1 200 OK\r\n\r\n")
            await writer.drain()
            await reader.read()
            writer.close()

    async def follow(transport: Transport) -> None:
        async for _ in transport.watch("/api/v1/nodes", {"watch": "1"}, idle_s=0.2):
            pass

    with pytest.raises(errors.Unavailable, match="watch /api/v1/nodes"):
        door.talk(Silent([]), follow)


def test_without_credentials_the_error_says_how_to_give_them(tmp_path: Path) -> None:
    with pytest.raises(errors.Unauthorized, match="KUBECONFIG"):
        Credentials({"KUBECONFIG": str(tmp_path / "nowhere")})
