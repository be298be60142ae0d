"""What docs/functions.md shows works."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from fleet.contexts.base import Media, Observation
from fleet.functions import wire
from tests.pictures import observe, plain

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "functions.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_the_python_of_the_page_runs() -> None:
    (source,) = blocks("python")
    names: dict[str, object] = {}
    exec(source, names)  # the page's own text
    map_observation = names["map_observation"]
    assert callable(map_observation)
    assert map_observation(observe(plain(10, 20, 4))) == {"exg": 26.0, "height": 0.0}


def test_the_observation_of_the_page_is_one() -> None:
    message = json.loads(blocks("json")[0])
    png = Media("image/png", bytes.fromhex("89504e470d0a1a0a"))
    wanted = Observation(887, "row 20, column 7", (png,), {"lat": 39.6483, "lon": -82.8146}, 61.5)
    assert wire.decode_observation(message) == wanted
    assert wire.encode_observation(wanted) == message


def test_the_evaluation_request_of_the_page_is_one() -> None:
    message = json.loads(blocks("json")[1])
    fs, metrics = wire.decode_evaluation_request(message)
    assert (fs.feature("exg").tolist(), fs.states.tolist(), metrics.explored) == ([24.9, 26.1], [0, 3], True)
    assert fs.environment.truth is not None
    np.testing.assert_array_equal(fs.environment.truth, [[25.0, np.nan], [25.5, 26.0]])
    assert wire.encode_evaluation_request(fs, metrics) == message
