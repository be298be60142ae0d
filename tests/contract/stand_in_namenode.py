"""A NameNode that answers as it is told: for what a real one cannot be made to say."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
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
    """One that runs, and the query of each request that it has answered."""

    address: str
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
