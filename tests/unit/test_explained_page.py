"""The explanation that docs/tutorial.md shows is one: its parts are those that are printed, and its numbers agree."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ROOT

PAGE = (ROOT / "docs/tutorial.md").read_text()
(TEXT,) = re.findall(r"^```text\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
TOLD, TABLE = TEXT.split("\n\n")


def test_the_blended_scores_of_the_page_are_the_weighted_sums_of_its_models_and_the_highest_is_chosen() -> None:
    header, *rows, blended = [line.split() for line in TABLE.splitlines()]
    moves = header[2:]
    sums = dict.fromkeys(moves, 0.0)
    for _, weight, *scores in rows:
        for move, score in zip(moves, scores, strict=True):
            sums[move] += float(weight) * float(score)
    shown = dict(zip(moves, map(float, blended[1:]), strict=True))
    assert shown == pytest.approx(sums, abs=1e-5)
    assert sum(float(row[1]) for row in rows) == pytest.approx(1.0, abs=1e-5)
    assert f"choice    {max(shown, key=lambda move: shown[move])}: the highest blended score" in TOLD


def test_the_page_says_what_the_command_says_in_its_order() -> None:
    title, *lines = TOLD.splitlines()
    asked = re.search(r"--agent (\d+)\s+--step (\d+)`\s+printed", PAGE)
    assert asked is not None
    assert re.fullmatch(rf"Mission 3 over field-2018-09-16, agent-{asked[1]}, step {asked[2]} of \d+", title)
    assert [line.split()[0] for line in lines] == ["where", "when", "captured", "HA", "SA", "choice"]
    assert "legal moves: " + ", ".join(TABLE.splitlines()[0].split()[2:]) in TOLD
