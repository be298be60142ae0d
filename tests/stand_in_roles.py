"""Stand-ins for the platform's programs, so that the runner is tested without learning or flying anything.

Run as `python stand_in_roles.py ROLE`, or with `serve map|eval FUNCTION --host H --port P`. They read the same
environment and leave the same documents as the real ones. `faults/workflow/agent-1.json` in the fleet's folder of the
storage says what goes wrong with "workflow agent-1": {"code": 65, "times": 1}; `"sleep": 60` is slept before.
"""

from __future__ import annotations

import contextlib
import http.server
import json
import os
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

from fleet.functions.contract import AgentMetrics
from fleet.learning.reward import Normaliser, RewardModel
from fleet.missions.documents import (
    Landing,
    MissionEvaluation,
    MissionOrder,
    RetrainingReport,
    WeightsDocument,
    judge,
)
from fleet.missions.records import Record
from fleet.runtime.settings import Settings

ACCURACY = 0.8


def write(settings: Settings, path: str, document: Any) -> None:
    settings.storage.write(path, document.model_dump_json(by_alias=True).encode())


def fault(settings: Settings, key: str) -> None:
    """Do what the faults of this program say, so many times; each has its own object, as programs run side by side."""
    path = f"{settings.paths.root}/faults/{key.replace(' ', '/')}.json"
    if not settings.storage.exists(path):
        return
    wanted = json.loads(settings.storage.read(path))
    if wanted.get("times", 1) < 1:
        return
    wanted["times"] = wanted.get("times", 1) - 1
    settings.storage.write(path, json.dumps(wanted).encode())
    time.sleep(wanted.get("sleep", 0))
    if "code" in wanted:
        sys.stdout.write(f"{key} was told to fail\n")
        sys.stdout.flush()
        os._exit(wanted["code"])


def serve(host: str, port: int) -> None:
    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", "2")
            self.end_headers()
            self.wfile.write(b"ok")

        def do_POST(self) -> None:
            """A sensor is released."""
            self.do_GET()
            self.wfile.flush()
            os._exit(0)

        def log_message(self, *arguments: object) -> None:
            """Quiet."""

    http.server.ThreadingHTTPServer((host, port), Handler).serve_forever()


def ask(url: str) -> None:
    """Wait until a server answers; on a busy computer a container may take half a minute to start."""
    for _ in range(1200):
        try:
            urllib.request.urlopen(f"{url}/healthz", timeout=5).read()
        except OSError:
            time.sleep(0.05)
        else:
            return
    raise SystemExit(75)


def release(url: str) -> None:
    with contextlib.suppress(OSError):
        urllib.request.urlopen(urllib.request.Request(f"{url}/release", b"{}"), timeout=5).read()


def fly(settings: Settings) -> None:
    landing = settings.paths.landing(settings.mission, settings.agent)
    if not settings.storage.exists(landing):
        for url in (settings.sensor_url, settings.map_url, settings.eval_url):
            ask(str(url))
        log = settings.paths.log(settings.mission, settings.agent)
        if not settings.storage.exists(log):  # one that is started again goes on after its last record
            record = Record(0, 0, 0, 0, True, (1.0,), 0, -1, "Land", 10.0, 1000.0)
            settings.storage.append(log, record.to_line())
        fault(settings, f"workflow {settings.agent}")
        metrics = AgentMetrics(settings.agent, 1, 1, 10.0, 1000.0, 10.0, 1, 1)
        write(settings, landing, Landing(agent=settings.agent, metrics=metrics))
    evaluate(settings)
    release(settings.sensor_url)


def evaluate(settings: Settings) -> None:
    paths, number = settings.paths, settings.mission
    found = {}
    for agent in settings.fleet.agents.resolved:
        if not settings.storage.exists(paths.landing(number, agent.name)):
            return
        found[agent.name] = Landing.model_validate_json(settings.storage.read(paths.landing(number, agent.name)))
    fault(settings, "eval")
    order = MissionOrder.model_validate_json(settings.storage.read(paths.plan(number)))
    metrics = {"accuracy": ACCURACY, "coverage": 0.5}
    document = MissionEvaluation(
        number=number,
        context=order.context,
        metrics=metrics,
        goals=judge(settings.fleet.goals, metrics),
        agents=tuple(landing.metrics for landing in found.values()),
        failures={name: landing.message for name, landing in found.items() if landing.failed},
    )
    write(settings, paths.evaluation(number), document)


def train(settings: Settings) -> None:
    fault(settings, "trainer Train")
    normaliser = Normaliser(low=(0.0,), high=(1.0,))
    reward = RewardModel(
        features=("exg",), weights=(1.0,), normaliser=normaliser, utility_threshold=1.0, visited_threshold=3,
        loss=0.1, goals_met=True,
    )  # fmt: skip
    settings.storage.write(settings.paths.initial_model, b"model")
    write(settings, settings.paths.reward, reward)


def weigh(settings: Settings) -> None:
    fault(settings, "trainer Weigh")
    agents = [agent.name for agent in settings.fleet.agents.resolved]
    order = settings.order
    share = 1 / len(order.models)
    weights = {agent: {model.key: share for model in order.models} for agent in agents}
    document = WeightsDocument(
        number=settings.mission + 1, weights=weights, usefulness={model.key: share for model in order.models}
    )
    write(settings, settings.paths.weights(settings.mission + 1), document)


def aggregate(settings: Settings) -> None:
    fault(settings, f"aggregator {settings.subset}")
    settings.storage.write(settings.paths.model(settings.mission, settings.subset), b"model")
    report = RetrainingReport(
        number=settings.mission, subset=settings.subset, transitions=1, cpu_s=0.1, wall_s=0.1, energy_j=1.0
    )
    write(settings, settings.paths.retraining(settings.mission, settings.subset), report)


def main(arguments: list[str]) -> None:
    if arguments[0] == "serve":
        marker = Path(f"{arguments[1]}.fault")
        if marker.exists():
            raise SystemExit(int(marker.read_text()))
        serve(arguments[4], int(arguments[6]))
    settings = Settings.from_environment(os.environ)
    match arguments[0]:
        case "sensor":
            fault(settings, f"sensor {settings.agent}")
            if settings.storage.exists(settings.paths.landing(settings.mission, settings.agent)):
                return
            serve(settings.bind, settings.port)
        case "workflow":
            fly(settings)
        case "trainer":
            train(settings) if settings.task == "Train" else weigh(settings)
        case "aggregator":
            aggregate(settings)


if __name__ == "__main__":
    main(sys.argv[1:])
