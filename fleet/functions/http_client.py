"""The HTTP contract from the caller's side; the door to httpx for functions."""

from __future__ import annotations

import time
import weakref
from typing import Any

import httpx

from fleet.functions import wire
from fleet.functions.calls import CallError, Failure, timed_out

PATIENCE_S = 15.0
"""How long nobody may listen before a call fails: a server that hung is ended, and its supervisor starts it anew."""
_GRACE_S = 2.0
"""So much longer than the function's own timeout we wait, so that the server's answer about it comes first."""
_PAUSE_S = 0.1
_OWN_ERRORS = frozenset({"Timeout", "BadAnswer", "BadRequest", "TooLarge", "Ending"})
"""Errors of the contract itself, whose message needs no `raised ...` before it."""


class HttpFunction:
    """Map() or Eval() behind an address.

    Args:
        url: Address of the server, such as http://127.0.0.1:8081.
        timeout_s: Longest duration of a call.
    """

    def __init__(self, url: str, timeout_s: float) -> None:
        self.url = url.rstrip("/")
        self.timeout_s = timeout_s
        # The functions are on this machine or in this pod: a proxy of the environment must not come between.
        self._client = httpx.Client(trust_env=False, timeout=timeout_s + _GRACE_S)
        # Clients of functions live as long as their owner and have no `close`: connections go with the last reference.
        weakref.finalize(self, self._client.close)

    def describe(self) -> dict[str, Any]:
        """Answer of GET /describe. Raises CallError."""
        return self._call("GET", "/describe", b"", wire.MAX_SSV_BYTES)

    def post(self, path: str, message: dict[str, Any], limit_bytes: int) -> dict[str, Any]:
        """Answer of a POST. Raises CallError; an answer over `limit_bytes` is not read to its end."""
        return self._call("POST", path, wire.dump(message), limit_bytes)

    def _call(self, method: str, path: str, body: bytes, limit_bytes: int) -> dict[str, Any]:
        status, data = self._patiently(method, path, body, limit_bytes)
        if status != httpx.codes.OK:
            raise CallError(_refusal(status, data))
        try:
            return wire.load(data)
        except wire.WireError as error:
            raise CallError(Failure(f"the answer of {path} {error}; answer as docs/functions.md says")) from error

    def _patiently(self, method: str, path: str, body: bytes, limit_bytes: int) -> tuple[int, bytes]:
        """Call, and wait while nobody listens at the address or the server says that it is not ready (503)."""
        give_up = time.monotonic() + PATIENCE_S
        while True:
            try:
                status, data = self._once(method, path, body, limit_bytes)
                if status != httpx.codes.SERVICE_UNAVAILABLE or time.monotonic() >= give_up:
                    return status, data
            except (httpx.ConnectError, httpx.ConnectTimeout) as error:
                if time.monotonic() >= give_up:
                    text = f"nobody listens at {self.url} for {PATIENCE_S:g} s ({error}); start the function's server"
                    raise CallError(Failure(text, passing=False)) from error
            time.sleep(_PAUSE_S)

    def _once(self, method: str, path: str, body: bytes, limit_bytes: int) -> tuple[int, bytes]:
        deadline = time.monotonic() + self.timeout_s + _GRACE_S
        headers = {"content-type": "application/json"} if body else {}
        try:
            with self._client.stream(method, f"{self.url}{path}", content=body, headers=headers) as response:
                data = bytearray()
                for chunk in response.iter_bytes():
                    data += chunk
                    if len(data) > limit_bytes:
                        raise CallError(Failure(_too_long(path, limit_bytes)))
                    if time.monotonic() > deadline:
                        raise CallError(timed_out(self.timeout_s))
                return response.status_code, bytes(data)
        except (httpx.ConnectError, httpx.ConnectTimeout):
            raise
        except httpx.TimeoutException as error:
            raise CallError(timed_out(self.timeout_s)) from error
        except httpx.InvalidURL as error:
            raise CallError(Failure(f"{self.url!r} is not an address: {error}", passing=False)) from error
        except httpx.HTTPError as error:
            raise CallError(
                Failure(
                    f"the server at {self.url} ended the connection during the call ({error}); see the server's log"
                )
            ) from error


def _too_long(path: str, limit_bytes: int) -> str:
    what = "an SSV" if path == "/map" else "an answer"
    return f"answered more than {limit_bytes / 2**20:g} MiB; {what} may have at most that; answer numbers, not pictures"


def _refusal(status: int, data: bytes) -> Failure:
    """What a status other than 200 means: the contract's error object when there is one."""
    passing = status >= 500 or status in (408, 429)
    try:
        error = wire.load(data)["error"]
        message, kind = str(error["message"]), str(error.get("type") or "")
    except (wire.WireError, KeyError, TypeError, AttributeError):
        text = data[:200].decode(errors="replace").strip()
        return Failure(f"answered status {status}{f': {text}' if text else ''}; see the server's log", passing=passing)
    extractor, trace = str(error.get("extractor") or ""), str(error.get("traceback") or "")
    if kind and kind not in _OWN_ERRORS and not message.startswith("raised "):
        message = f"raised {kind}: {message}; correct the function"
    return Failure(message, kind, extractor, trace, passing)
