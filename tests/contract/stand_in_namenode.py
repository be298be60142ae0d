"""A NameNode that answers as it is told: for what a real one cannot be made to say."""

from __future__ import annotations

import itertools
import json
import socket
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Thread
from urllib.parse import parse_qs, urlsplit


@dataclass(frozen=True)
class Answer:
    """An HTTP answer; the connection is cut when the status is 0."""

    status: int
    document: object = ""
    headers: dict[str, str] = field(default_factory=dict)


def refusal(exception: str, message: str, status: int = 403) -> Answer:
    """WebHDFS's own words for no."""
    return Answer(status, {"RemoteException": {"exception": exception, "message": message}})


FILE = Answer(200, {"FileStatus": {"pathSuffix": "", "type": "FILE", "length": 3, "modificationTime": 0}})


@dataclass
class StandIn:
    """One that runs, the query of each request that it has answered, and how many connections it was asked over."""

    address: str
    connections: int = 0
    queries: list[dict[str, str]] = field(default_factory=list)


@contextmanager
def namenode(*answers: Answer) -> Iterator[StandIn]:
    """Give these answers one after the other, and the last of them from then on."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(answers))
    stand_in = StandIn(f"127.0.0.1:{server.server_port}")
    server.stand_in = stand_in  # type: ignore[attr-defined]
    thread = Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield stand_in
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _handler(answers: Sequence[Answer]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def setup(self) -> None:
            super().setup()
            self.server.stand_in.connections += 1  # type: ignore[attr-defined]  # set above

        def do_GET(self) -> None:
            stand_in: StandIn = self.server.stand_in  # type: ignore[attr-defined]
            answer = answers[min(len(stand_in.queries), len(answers) - 1)]
            stand_in.queries.append({name: last for name, [*_, last] in parse_qs(urlsplit(self.path).query).items()})
            if answer.status == 0:
                self.close_connection = True
                return
            body = answer.document if isinstance(answer.document, str) else json.dumps(answer.document)
            self.send_response(answer.status)
            for name, value in {**answer.headers, "Content-Length": str(len(body))}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body.encode())

        def log_message(self, format: str, *args: object) -> None:
            """Nothing."""

    return Handler


ENDLESS = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", itertools.repeat(b"8000\r\n%s\r\n" % bytes(0x8000))
"""The start of an answer, and what follows for ever."""


@contextmanager
def sender(start: bytes, parts: Iterable[bytes], pause_s: float = 0.0) -> Iterator[str]:
    """Its address: a server that sends the same bytes to everybody, and goes on until nobody listens any more."""
    stop = Event()
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(0.05)

    def serve(peer: socket.socket) -> None:
        with peer:
            try:
                peer.recv(1 << 16)
                peer.sendall(start)
                for part in parts:
                    peer.sendall(part)
                    if stop.wait(pause_s):
                        return
            except OSError:
                return

    def accept() -> None:
        while not stop.is_set():
            try:
                peer, _ = listener.accept()
            except TimeoutError:
                continue
            thread = Thread(target=serve, args=(peer,))
            thread.start()
            served.append(thread)

    served: list[Thread] = []
    accepting = Thread(target=accept)
    accepting.start()
    try:
        yield f"127.0.0.1:{listener.getsockname()[1]}"
    finally:
        stop.set()
        for thread in (accepting, *served):
            thread.join()
        listener.close()
