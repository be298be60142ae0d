"""An HTTP GET that never waits: asked again and again until the answer is there."""

from __future__ import annotations

import contextlib
import errno
import socket

_LONGEST_ANSWER = 4096


class HttpProbe:
    """Asks one address whether it is healthy.

    Args:
        host, port, path: What is asked.
        timeout_s: How long one question may take.
    """

    def __init__(self, host: str, port: int, path: str, timeout_s: float) -> None:
        self._address = (host, port)
        self._request = f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: close\r\n\r\n".encode()
        self._timeout_s = timeout_s
        self._socket: socket.socket | None = None
        self._asked_s = 0.0
        self._sent = False
        self._answer = b""

    def passed(self, now_s: float) -> bool:
        """Go on with the question; True once an answer with a status of 200..399 has come (Kubernetes' rule)."""
        try:
            if self._socket is None:
                self._ask(now_s)
            elif now_s - self._asked_s > self._timeout_s:
                self.close()
            return self._has_good_answer()
        except OSError:  # refused or reset: ask anew next time
            self.close()
            return False

    def close(self) -> None:
        """Give the question up."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()
        self._socket = None

    def _ask(self, now_s: float) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._asked_s, self._sent, self._answer = now_s, False, b""
        problem = self._socket.connect_ex(self._address)
        if problem not in {0, errno.EINPROGRESS}:
            raise OSError(problem, "cannot connect")

    def _has_good_answer(self) -> bool:
        if self._socket is None:
            return False
        try:
            if not self._sent:
                self._socket.send(self._request)
                self._sent = True
            part = self._socket.recv(_LONGEST_ANSWER)
        except BlockingIOError:
            return False
        except OSError as error:
            if error.errno == errno.ENOTCONN:
                return False
            raise
        self._answer += part
        words = self._answer.split(b"\r\n", 1)[0].split()
        complete = b"\r\n" in self._answer
        if complete or not part:
            self.close()
        return complete and len(words) > 1 and words[1].isdigit() and 200 <= int(words[1]) < 400
