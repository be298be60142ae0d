"""What probes and Prometheus are told."""

from __future__ import annotations

import asyncio
import json
import logging

from fleet_operator.service.health import HealthServer
from fleet_operator.service.logs import JsonLines
from fleet_operator.service.metrics import API_CALLS, DUE, Metrics


def test_pages_are_served_by_path_and_nothing_else_is() -> None:
    async def ask(port: int, request: str) -> str:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(f"{request} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        answer = (await reader.read()).decode()
        writer.close()
        await writer.wait_closed()
        return answer

    async def scenario() -> list[str]:
        pages = {"/healthz": lambda: (200, "ok\n"), "/readyz": lambda: (503, "not yet\n")}
        async with HealthServer(0, pages) as server:
            requests = ("GET /healthz", "GET /readyz?verbose=1", "GET /else", "POST /healthz", "nonsense")
            return [await ask(server.port, request) for request in requests]

    answers = asyncio.run(asyncio.wait_for(scenario(), 30.0))
    assert [(answer.split("\r\n")[0], answer.split("\r\n\r\n")[1]) for answer in answers] == [
        ("HTTP/1.1 200 OK", "ok\n"),
        ("HTTP/1.1 503 Service Unavailable", "not yet\n"),
        ("HTTP/1.1 404 Not Found", "there is no such page\n"),
        ("HTTP/1.1 405 Method Not Allowed", "only GET\n"),
        ("HTTP/1.1 405 Method Not Allowed", "only GET\n"),
    ]


def test_numbers_are_in_the_format_of_prometheus() -> None:
    numbers = Metrics()
    numbers.count(API_CALLS, verb="patch", code="200")
    numbers.count(API_CALLS, 2.0, verb="patch", code="200")
    numbers.count(API_CALLS, verb="list", code="429")
    numbers.watch({DUE: lambda: 3})
    assert numbers.text().splitlines() == [
        "# HELP fleet_operator_api_calls_total Answers of the API server by verb and status code.",
        "# TYPE fleet_operator_api_calls_total counter",
        'fleet_operator_api_calls_total{code="200",verb="patch"} 3',
        'fleet_operator_api_calls_total{code="429",verb="list"} 1',
        "# HELP fleet_operator_fleets_due Fleets that wait for a pass.",
        "# TYPE fleet_operator_fleets_due gauge",
        "fleet_operator_fleets_due 3",
    ]


def test_a_line_of_the_log_for_machines_is_json_with_its_trace() -> None:
    error = ValueError("why")
    record = logging.LogRecord("x", logging.ERROR, "f", 1, "it %s", ("failed",), (ValueError, error, None))
    line = json.loads(JsonLines().format(record))
    assert (line["level"], line["logger"], line["message"]) == ("error", "x", "it failed")
    assert line["trace"].endswith("ValueError: why")
