"""The contract of Map() and Eval(): in this process, served by Python, and in other hands."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fleet.functions.clients import open_eval, open_map
from fleet.functions.contract import EvalClient, MapClient
from fleet.spec.functions import EvalSpec, MapSpec
from tests.contract.function_contract import EvalContract, MapContract
from tests.function_servers import NODE, serve_python, started

FUNCTIONS = """
import numpy as np
from fleet.functions.contract import Evaluation

def map_observation(observation):
    if observation.attributes["fail"] == 1.0:
        raise ValueError("told to fail")
    return {"bytes": len(observation.media[0].data), "state": observation.state}

def evaluate(fs, metrics):
    numbers = {"captured": len(fs), "time_s": metrics.time_s}
    return Evaluation(metrics.explored, numbers, {"twice": 2 * fs.environment.truth})
"""

PLAIN_PYTHON = """
import base64, http.server, json, sys

def map_observation(message):
    if message["attributes"]["fail"] == 1.0:
        raise ValueError("told to fail")
    return {"ssv": {"bytes": len(base64.b64decode(message["media"][0]["data"])), "state": message["state"]}}

def evaluate(message):
    twice = [[None if v is None else 2 * v for v in row] for row in message["featureSpace"]["environment"]["truth"]]
    finished = all(agent["groupsExplored"] >= agent["groups"] for agent in message["metrics"]["agents"])
    numbers = {"captured": len(message["featureSpace"]["states"]), "time_s": message["metrics"]["timeS"]}
    return {"finished": finished, "metrics": numbers, "artefacts": {"twice": twice}}

class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        kind = sys.argv[1]
        features = ["bytes", "state"] if kind == "Map" else []
        self.answer(200, {"kind": kind, "features": features, "version": "1"})

    def do_POST(self):
        message = json.loads(self.rfile.read(int(self.headers["content-length"])))
        try:
            self.answer(200, (map_observation if self.path == "/map" else evaluate)(message))
        except Exception as error:
            self.answer(500, {"error": {"message": str(error), "type": type(error).__name__}})

    def answer(self, status, message):
        body = json.dumps(message).encode()
        self.send_response(status)
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments):
        pass

server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
print(f"listening on http://127.0.0.1:{server.server_port}", file=sys.stderr, flush=True)
server.serve_forever()
"""

NODE_JS = """
const kind = process.argv[2];
const map = (m) => {
  if (m.attributes.fail === 1) { const e = new Error("told to fail"); e.name = "ValueError"; throw e; }
  return {ssv: {state: m.state, bytes: Buffer.from(m.media[0].data, "base64").length}};
};
const evaluate = (m) => ({
  finished: m.metrics.agents.every((a) => a.groupsExplored >= a.groups),
  metrics: {captured: m.featureSpace.states.length, time_s: m.metrics.timeS},
  artefacts: {twice: m.featureSpace.environment.truth.map((row) => row.map((v) => v === null ? null : 2 * v))},
});
const server = require("http").createServer((request, response) => {
  const parts = [];
  request.on("data", (part) => parts.push(part));
  request.on("end", () => {
    let status = 200, answer;
    try {
      if (request.url === "/map") answer = map(JSON.parse(Buffer.concat(parts)));
      else if (request.url === "/eval") answer = evaluate(JSON.parse(Buffer.concat(parts)));
      else answer = {kind, features: kind === "Map" ? ["bytes", "state"] : [], version: "1"};
    } catch (error) {
      status = 500;
      answer = {error: {message: error.message, type: error.name}};
    }
    response.writeHead(status, {"content-type": "application/json"});
    response.end(JSON.stringify(answer));
  });
});
server.listen(0, "127.0.0.1", () => console.error(`listening on http://127.0.0.1:${server.address().port}`));
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("functions")
    (folder / "contract_functions.py").write_text(FUNCTIONS)
    (folder / "plain.py").write_text(PLAIN_PYTHON)
    (folder / "server.js").write_text(NODE_JS)
    return folder


def commands(folder: Path, language: str, kind: str) -> list[str]:
    if language == "python":
        return [sys.executable, str(folder / "plain.py"), kind]
    if NODE is None:
        pytest.skip("node is not on this machine")
    return [NODE, str(folder / "server.js"), kind]


@pytest.fixture(scope="module", params=["in process", "fleet server", "python", "node"])
def map_client(request: pytest.FixtureRequest, folder: Path) -> Iterator[MapClient]:
    spec = MapSpec(function="contract_functions:map_observation", retries=1)
    image = MapSpec(image="example/map", retries=1)
    if request.param == "in process":
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(folder))
            yield open_map(spec)
    elif request.param == "fleet server":
        assert spec.function
        with serve_python("Map", spec.function, folder) as server:
            yield open_map(spec, server.url)
    else:
        with started(commands(folder, request.param, "Map")) as server:
            yield open_map(image, server.url)


@pytest.fixture(scope="module", params=["in process", "fleet server", "python", "node"])
def eval_client(request: pytest.FixtureRequest, folder: Path) -> Iterator[EvalClient]:
    spec = EvalSpec(function="contract_functions:evaluate", retries=1)
    if request.param == "in process":
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(folder))
            yield open_eval(spec)
    elif request.param == "fleet server":
        assert spec.function
        with serve_python("Eval", spec.function, folder) as server:
            yield open_eval(spec, server.url)
    else:
        with started(commands(folder, request.param, "Eval")) as server:
            yield open_eval(EvalSpec(image="example/eval"), server.url)


class TestMap(MapContract):
    @pytest.fixture
    def client(self, map_client: MapClient) -> MapClient:
        return map_client


class TestEval(EvalContract):
    @pytest.fixture
    def client(self, eval_client: EvalClient) -> EvalClient:
        return eval_client
