"""One command runs the whole evaluation into one folder; a part that fails is told, and none is run twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.scouting.everything import PARTS, Form
from tests.conftest import ROOT


@pytest.mark.parametrize("short", [True, False])
def test_everything_names_commands_that_know_their_options(short: bool) -> None:
    for part in PARTS:
        _, module, *options = Form(Path("out"), short, 1).command(part)
        file = ROOT / (module.replace(".", "/") + ".py")
        program = (file if file.is_file() else file.with_suffix("") / "__main__.py").read_text()
        asked = [option for option in options if option.startswith("--")]
        assert [option for option in asked if f'"{option}"' not in program] == []
