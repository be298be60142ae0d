"""A function that misbehaves gets a clear error, and takes nobody else down. Whole messages are asserted."""

from __future__ import annotations

import contextlib
import http.client
import http.server
import json
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fleet.contexts.base import Media, Observation
from fleet.errors import FleetError, FunctionError
from fleet.functions import http_client
from fleet.functions.clients import open_eval, open_map
from fleet.functions.contract import AgentMetrics, Metrics
from fleet.functions.http_server import function_app, run_server
from fleet.functions.vision import encode
from fleet.spec.functions import EvalSpec, MapSpec
from tests.contract.function_contract import feature_space
from tests.function_servers import EXAMPLE, ROOT, serve_python, started

FAULTS = """
import os, time
from pathlib import Path
from fleet.functions.compose import compose, extractor
from fleet.functions.extractors import brightness

def height(observation):
    return {"height": 1 / observation.state}

composed = compose(brightness, height)

def raises(observation):
    raise KeyError("ndvi")

def exits(observation):
    raise SystemExit("done here")

def hangs(observation):
    time.sleep(60)

def hangs_once(observation):
    marker = Path(__file__).with_name("hung")
    if not marker.exists():
        marker.touch()
        time.sleep(60)
    return {"height": 1.0}

def nan(observation):
    return {"height": float("nan")}

@extractor("height", "width")
def wrong_length(observation):
    return {"height": 1.0, "depth": 2.0}

def names_change(observation):
    return {f"f{observation.state}": 1.0}

def words(observation):
    return {"height": "tall"}

def truth(observation):
    return {"height": True}

def array(observation):
    return [1.0, 2.0]

def large(observation):
    return {"height": 1.0, "x" * 10_000_000: 2.0}

def many(observation):
    return {f"f{i}": 1.0 for i in range(500_000)}

def ends_the_process(observation):
    os._exit(9)

def fine(observation):
    return {"height": 2.0}

def shapes(fs, metrics):
    return True, {"accuracy": 1.0}, {"predicted": [[1.0, 2.0]]}

def text(fs, metrics):
    return "finished"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("faults")
    (folder / "faulty.py").write_text(FAULTS)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield folder


def observation(state: int = 0, data: bytes | None = None) -> Observation:
    picture = Media("image/png", encode_black() if data is None else data)
    return Observation(state, f"row 2, column {state}", (picture,))


def encode_black() -> bytes:
    return encode(np.zeros((2, 2, 3), dtype=np.uint8))


RAISED = {
    "composed": "faulty:composed, extractor height, agent agent-1, state row 2, column 0: raised ZeroDivisionError "
    "at faulty.py line 8: division by zero; correct the function, or what it is given (2 attempts)",
    "raises": "faulty:raises, agent agent-1, state row 2, column 0: raised KeyError at faulty.py line 13: 'ndvi'; "
    "correct the function, or what it is given (2 attempts)",
    "exits": "faulty:exits, agent agent-1, state row 2, column 0: raised SystemExit at faulty.py line 16: done here; "
    "correct the function, or what it is given (2 attempts)",
    "nan": "faulty:nan, agent agent-1, state row 2, column 0: feature height is nan; return a finite number, "
    "or a neutral value when there is nothing to measure (2 attempts)",
    "wrong_length": "faulty:wrong_length, agent agent-1, state row 2, column 0: answered 2 features instead of 2: "
    "without width and with unknown depth; every SSV of a Map() has the same features (2 attempts)",
    "words": "faulty:words, agent agent-1, state row 2, column 0: feature height is a str; return a number "
    "(2 attempts)",
    "truth": "faulty:truth, agent agent-1, state row 2, column 0: feature height is True, a truth value; "
    "return a number (1.0 or 0.0) (2 attempts)",
    "array": "faulty:array, agent agent-1, state row 2, column 0: answered a list instead of features by name; "
    "return a dict such as {'height': 1.5} (2 attempts)",
    "many": "faulty:many, agent agent-1, state row 2, column 0: answered 500000 features; an SSV has at most 1024 "
    "(2 attempts)",
}


@pytest.mark.parametrize("name", RAISED)
def test_in_process_and_over_http_the_error_is_the_same(folder: Path, name: str) -> None:
    spec = MapSpec(function=f"faulty:{name}", retries=1)
    with pytest.raises(FunctionError) as direct:
        open_map(spec).map(observation(), "agent-1")
    with serve_python("Map", f"faulty:{name}", folder) as server, pytest.raises(FunctionError) as served:
        open_map(spec, server.url).map(observation(), "agent-1")
    assert (str(direct.value), str(served.value)) == (RAISED[name], RAISED[name])


def test_a_name_of_ten_megabytes_is_refused_in_process_and_over_http(folder: Path) -> None:
    spec = MapSpec(function="faulty:large", retries=0)
    with pytest.raises(FunctionError) as direct:
        open_map(spec).map(observation(), "agent-1")
    assert str(direct.value) == (
        "faulty:large, agent agent-1, state row 2, column 0: answered a feature whose name has 10000000 characters; "
        "a name has at most 256"
    )


def test_an_answer_over_the_limit_is_not_read_to_its_end() -> None:
    body = b'{"ssv": {"' + b"x" * 10_000_000 + b'": 1}}'
    description = b'{"kind": "Map", "features": [], "version": "1"}'
    with one_answer(body, description) as url, pytest.raises(FunctionError) as caught:
        open_map(MapSpec(image="example/map", retries=0), url).map(observation(), "agent-1")
    assert str(caught.value) == (
        "example/map, agent agent-1, state row 2, column 0: answered more than 1 MiB; an SSV may have at most that; "
        "answer numbers, not pictures"
    )


def test_features_that_change_are_refused(folder: Path) -> None:
    client = open_map(MapSpec(function="faulty:names_change", retries=0))
    assert client.map(observation(1)).tolist() == [1.0]
    with pytest.raises(FunctionError) as caught:
        client.map(observation(2), "agent-3")
    assert str(caught.value) == (
        "faulty:names_change, agent agent-3, state row 2, column 2: answered 1 features instead of 1: without f1 and "
        "with unknown f2; every SSV of a Map() has the same features"
    )


def test_features_are_unknown_before_the_first_answer_of_a_plain_function(folder: Path) -> None:
    client = open_map(MapSpec(function="faulty:fine"))
    with pytest.raises(FunctionError) as caught:
        _ = client.features
    assert str(caught.value) == (
        "faulty:fine: its features are known only after its first answer; declare them with @extractor('name', ...)"
    )
    client.map(observation())
    assert client.features == ("height",)


def test_a_hang_in_this_process_is_given_up(folder: Path) -> None:
    with pytest.raises(FunctionError) as caught:
        open_map(MapSpec(function="faulty:hangs", timeout="200ms", retries=1)).map(observation(), "agent-1")
    assert str(caught.value) == (
        "faulty:hangs, agent agent-1, state row 2, column 0: did not answer within 0.2 s; make it faster, "
        "or raise `timeout` in the FleetSpec (2 attempts)"
    )


def test_a_server_that_hangs_says_so_stays_healthy_meanwhile_and_ends_with_75(folder: Path) -> None:
    with serve_python("Map", "faulty:hangs", folder, timeout_s=1.0) as server:
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        connection.request("POST", "/map", json.dumps({"state": 0}))
        assert get(server.port, "/healthz") == (200, {"status": "ok"})
        response = connection.getresponse()
        assert (response.status, json.loads(response.read())) == (
            504,
            {
                "error": {
                    "message": "did not answer within 1 s; make it faster, or raise `timeout` in the FleetSpec",
                    "type": "Timeout",
                    "extractor": "",
                }
            },
        )
        connection.close()
        assert server.process.wait(10) == 75


def test_a_call_succeeds_when_a_supervisor_starts_the_hung_server_anew(folder: Path) -> None:
    spec = MapSpec(function="faulty:hangs_once", timeout="500ms", retries=2)
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(serve_python("Map", "faulty:hangs_once", folder, timeout_s=0.5))

        def supervise() -> None:
            server.process.wait(20)
            stack.enter_context(serve_python("Map", "faulty:hangs_once", folder, port=server.port))

        supervisor = threading.Thread(target=supervise)
        supervisor.start()
        assert open_map(spec, server.url).map(observation(), "agent-1").tolist() == [1.0]
        supervisor.join()
        assert server.process.returncode == 75


def test_a_server_that_ends_during_the_call_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http_client, "PATIENCE_S", 0.3)
    with serve_python("Map", "faulty:ends_the_process", folder) as server:
        client = open_map(MapSpec(function="faulty:ends_the_process", retries=0), server.url)
        with pytest.raises(FunctionError) as during:
            client.map(observation(), "agent-1")
        assert server.process.wait(10) == 9
        with pytest.raises(FunctionError) as after:
            client.map(observation(), "agent-1")
    place = "faulty:ends_the_process, agent agent-1, state row 2, column 0: "
    assert str(during.value) == (
        f"{place}the server at {server.url} ended the connection during the call "
        "(Server disconnected without sending a response.); see the server's log"
    )
    assert str(after.value) == (
        f"{place}nobody listens at {server.url} for 0.3 s ([Errno 111] Connection refused); start the function's server"
    )


def test_one_function_that_fails_does_not_disturb_another(folder: Path) -> None:
    with (
        serve_python("Map", "faulty:hangs", folder, timeout_s=0.5) as hung,
        serve_python("Map", "faulty:fine", folder) as fine,
    ):
        bad = open_map(MapSpec(function="faulty:hangs", timeout="500ms", retries=0), hung.url)
        good = open_map(MapSpec(function="faulty:fine"), fine.url)
        with pytest.raises(FunctionError):
            bad.map(observation(), "agent-1")
        assert good.map(observation(), "agent-2").tolist() == [2.0]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "shapes",
            "faulty:shapes: artefact predicted is 1 x 2; return a grid of 2 rows x 3 columns",
        ),
        (
            "text",
            "faulty:text: answered a str instead of an Evaluation; return Evaluation(finished, metrics)",
        ),
    ],
)
def test_an_answer_that_is_no_evaluation_is_refused(folder: Path, name: str, message: str) -> None:
    spec = EvalSpec(function=f"faulty:{name}", retries=0)
    metrics = Metrics((AgentMetrics("agent-1"),))
    with pytest.raises(FunctionError) as direct:
        open_eval(spec).evaluate(feature_space(), metrics)
    with serve_python("Eval", f"faulty:{name}", folder) as server, pytest.raises(FunctionError) as served:
        open_eval(spec, server.url).evaluate(feature_space(), metrics)
    assert (str(direct.value), str(served.value)) == (message, message)


def test_garbage_instead_of_a_picture_names_the_extractor() -> None:
    with serve_python("Map", "crop_scouting:map_observation", EXAMPLE) as server:
        client = open_map(MapSpec(function="crop_scouting:map_observation", retries=0), server.url)
        with pytest.raises(FunctionError) as caught:
            client.map(observation(4, b"no picture"), "agent-1")
    assert str(caught.value) == (
        "crop_scouting:map_observation, extractor excess_green, agent agent-1, state row 2, column 4: raised "
        "ValueError: 10 bytes that start with b'no pictu' are not a picture that can be decoded; use PPM, PNG or JPEG; "
        "correct the function, or what it is given"
    )
    assert "in decode" in caught.value.__notes__[0]


def test_the_server_of_the_other_function_is_refused(folder: Path) -> None:
    with serve_python("Eval", "faulty:text", folder) as server, pytest.raises(FunctionError) as caught:
        open_map(MapSpec(function="faulty:fine"), server.url).map(observation(), "agent-1")
    assert str(caught.value) == (
        f"faulty:fine, agent agent-1, state row 2, column 0: the server at {server.url} serves 'Eval' "
        "instead of 'Map'; correct the address"
    )


def test_bad_requests_are_refused_with_what_is_wrong(folder: Path) -> None:
    with serve_python("Map", "faulty:fine", folder) as server:
        assert post(server.port, b"{") == (
            400,
            "the request is not as docs/functions.md says: is not JSON: Expecting property name enclosed in double "
            "quotes: line 1 column 2 (char 1)",
        )
        assert post(server.port, b'{"state": "3"}') == (
            400,
            "the request is not as docs/functions.md says: state: is a JSON text",
        )
        assert post(server.port, b"{}", length=65 * 2**20) == (
            413,
            "the request is over 64 MiB; send less media at once",
        )


def test_sigterm_ends_a_server_with_0_after_the_open_request(folder: Path) -> None:
    with serve_python("Map", "faulty:fine", folder) as server:
        assert post(server.port, b'{"state": 1}')[0] == 200
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(10) == 0


def test_a_function_that_holds_the_interpreter_is_ended_by_the_watchdog(folder: Path) -> None:
    program = (
        "import re; from fleet.functions.http_server import function_app, run_server; "
        "held = function_app('Map', lambda observation: re.match('(a+)+$', 'a' * 60 + 'b'), 1.0); "
        "run_server(held, '127.0.0.1', 0, watchdog_s=2.0)"
    )
    with started([sys.executable, "-c", program], {"PYTHONPATH": str(ROOT)}) as server:
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
        connection.request("POST", "/map", b'{"state": 1}')
        with pytest.raises(ConnectionError):
            connection.getresponse()
        connection.close()
        assert server.process.wait(10) == 1


def test_callers_load_neither_opencv_nor_httpx_nor_scipy() -> None:
    program = (
        "import sys, fleet.functions.clients; "
        "print([name for name in ('cv2', 'httpx', 'scipy', 'starlette', 'uvicorn', 'numba') if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout == "[]\n"


def test_an_address_in_use_is_an_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(FleetError) as caught:
            run_server(function_app("Map", lambda observation: {"a": 1.0}, 1.0), "127.0.0.1", port)
    text = re.sub(r"\[Errno \d+\].*?;", "[...];", str(caught.value))
    assert text == f"cannot listen on 127.0.0.1 port {port}: [...]; choose another address or port"


def get(port: int, path: str) -> tuple[int, object]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", path)
    response = connection.getresponse()
    try:
        return response.status, json.loads(response.read())
    finally:
        connection.close()


def post(port: int, body: bytes, length: int | None = None) -> tuple[int, str]:
    """Status and error message, "" without one."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("POST", "/map", body, {"content-length": str(len(body) if length is None else length)})
    response = connection.getresponse()
    try:
        return response.status, json.loads(response.read()).get("error", {}).get("message", "")
    finally:
        connection.close()


@contextlib.contextmanager
def one_answer(body: bytes, description: bytes) -> Iterator[str]:
    """A server in this process that gives a description and one fixed answer."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.answer(description)

        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["content-length"]))
            with contextlib.suppress(ConnectionError):  # the client has read enough
                self.answer(body)

        def answer(self, data: bytes) -> None:
            self.send_response(200)
            self.send_header("content-length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()
