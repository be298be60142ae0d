from __future__ import annotations

import base64
import csv
import io
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fleet.missions.documents import Landing
from fleet.missions.records import read_log
from fleet.report.collect import collect
from fleet.report.html import shaping_sentence, verdict
from fleet.report.write import write_report
from fleet.storage.layout import FleetPaths
from fleet.storage.local import LocalStorage

PICTURES = {
    f"missions/{number:04d}/{name}.png"
    for number in (1, 2)
    for name in ("truth", "paths", "predicted", "error", "classes")
}


class Page(HTMLParser):
    """What a browser would fetch, show and need."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.images: list[bytes] = []
        self.addresses: list[str] = []
        self.alternatives: list[str] = []
        self.text = ""
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag not in ("meta", "img", "link", "br"):
            self.open.append(tag)
        if tag == "img":
            source = given["src"] or ""
            assert source.startswith("data:image/png;base64,")
            self.images.append(base64.b64decode(source.partition(",")[2], validate=True))
            self.alternatives.append(given["alt"] or "")
        else:
            self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action")]
        assert tag not in ("script", "link", "iframe", "object")
        self.text += " "

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def page_of(file: Path) -> Page:
    return Page(file.read_text("utf-8"))


def files_in(folder: Path) -> set[str]:
    return {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}


def test_a_report_has_a_page_tables_and_pictures(report: Path) -> None:
    written = files_in(report)
    assert {name for name in written if name.startswith("missions/")} == {
        *PICTURES,
        "missions/0001/map.csv",
        "missions/0002/map.csv",
    }
    assert {"report.html", "trace.csv", "map.csv", "models.png", "reward.png", "shaping.png"} <= written
    assert (report / "map.csv").read_bytes() == (report / "missions/0002/map.csv").read_bytes()


def test_the_page_needs_nothing_from_outside_and_every_picture_decodes(report: Path) -> None:
    text = (report / "report.html").read_text("utf-8")
    page = Page(text)
    assert page.addresses == []
    assert page.open == []
    assert "url(" not in text
    assert "@import" not in text
    assert all(page.alternatives)
    assert sorted(page.images) == sorted(file.read_bytes() for file in report.rglob("*.png"))
    for png in page.images:
        Image.open(io.BytesIO(png)).verify()


def test_writing_again_gives_the_same_bytes(
    report: Path, storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    assert write_report(storage, paths, tmp_path / "again") == tmp_path / "again" / "report.html"
    for name in files_in(report):
        assert (tmp_path / "again" / name).read_bytes() == (report / name).read_bytes()


def test_the_trace_says_what_the_logs_say(report: Path, storage: LocalStorage, paths: FleetPaths) -> None:
    expected = [
        {
            "mission": str(number),
            "agent": agent,
            "step": str(record.step),
            "t_s": record.time_s,
            "row": str(record.row),
            "col": str(record.column),
            "captured": str(int(record.captured)),
            "action": record.action,
            "energy_j": round(record.uav_energy_j, 3),
        }
        for number in (1, 2)
        for agent in ("agent-1", "agent-2")
        for record in read_log(storage.read(paths.log(number, agent)))
    ]
    with (report / "trace.csv").open(newline="") as file:
        found = [{**row, "t_s": float(row["t_s"]), "energy_j": float(row["energy_j"])} for row in csv.DictReader(file)]
    assert found == expected


def test_energy_in_the_trace_grows_and_only_landing_is_missing_from_it(
    storage: LocalStorage, paths: FleetPaths
) -> None:
    for run in collect(storage, paths).missions[0].agents:
        energies = [record.uav_energy_j for record in run.records]
        assert energies == sorted(energies)
        assert run.landing is not None
        assert 0 < run.landing.metrics.uav_energy_j - energies[-1] < 2000


def test_the_page_shows_what_a_reader_looks_for(report: Path) -> None:
    text = page_of(report / "report.html").text
    for wanted in (
        "2 of 3 missions flown to the end. The last one met 1 of 2 goals.",
        "None of 48 parameter sets met all goals",
        "drawn from what was measured",
        "agent-2",
        "atLeast: 0.6",
        "seed",
        "8 of 8",
        "1-2",
    ):
        assert wanted in text


def test_a_name_cannot_smuggle_markup_into_the_page(storage: LocalStorage, paths: FleetPaths, tmp_path: Path) -> None:
    landing = storage.read(paths.landing(1, "agent-1"))
    evil = landing.replace(b'"failed":false,"message":""', b'"failed":true,"message":"<script>alert(1)</script>"')
    assert evil != landing
    storage.write(paths.landing(1, "agent-1"), evil)
    page = page_of(write_report(storage, paths, tmp_path))
    assert "<script>alert(1)</script>" in page.text


def test_a_run_that_was_broken_off_in_flight_is_reported(
    storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    storage.delete(paths.evaluation(2))
    storage.delete(paths.artefacts(2))
    storage.delete(paths.landing(2, "agent-2"))
    storage.append(paths.log(2, "agent-2"), b'{"step": 99, "torn')
    run = collect(storage, paths)
    assert verdict(run).startswith("1 of 3 missions flown to the end. Mission 2 was broken off, or is still flying.")
    text = page_of(write_report(storage, paths, tmp_path)).text
    assert "in the air" in text
    assert files_in(tmp_path / "missions/0002") == {"truth.png", "paths.png", "map.csv"}
    lines = (tmp_path / "map.csv").read_text().splitlines()
    assert len(lines) == 145
    assert {line.split(",")[3] for line in lines[1:]} == {""}


def test_an_agent_that_failed_is_named_with_its_reason(
    storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    landing = storage.read(paths.landing(2, "agent-1"))
    failed = landing.replace(b'"failed":false,"message":""', b'"failed":true,"message":"Map() hung in row 3"')
    storage.write(paths.landing(2, "agent-1"), failed)
    assert collect(storage, paths).missions[1].failures == {"agent-1": "Map() hung in row 3"}
    assert "Map() hung in row 3" in page_of(write_report(storage, paths, tmp_path)).text


def test_each_agent_that_landed_is_told_with_the_reason(
    storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    landing = storage.read(paths.landing(2, "agent-1"))
    metrics = Landing.model_validate_json(landing).metrics
    early = landing.replace(b'"groupsExplored":%d' % metrics.groups, b'"groupsExplored":%d' % (metrics.groups - 1))
    assert early != landing
    storage.write(paths.landing(2, "agent-1"), early)
    text = page_of(write_report(storage, paths, tmp_path)).text
    assert text.count("landed: Eval() said finished") == 1
    assert text.count("landed: all groups explored") == 3


def test_a_run_before_its_first_mission_is_reported(storage: LocalStorage, paths: FleetPaths, tmp_path: Path) -> None:
    storage.delete(f"{paths.root}/missions")
    storage.delete(paths.reward)
    run = collect(storage, paths)
    assert verdict(run) == "No mission has been flown."
    assert shaping_sentence(run) == "Reward shaping has not ended: 48 parameter sets were simulated so far."
    write_report(storage, paths, tmp_path)
    assert files_in(tmp_path) - {"storage"} >= {"report.html", "trace.csv"}
    assert len((tmp_path / "trace.csv").read_text().splitlines()) == 1


def test_an_empty_storage_gives_an_empty_report(paths: FleetPaths, tmp_path: Path) -> None:
    page = page_of(write_report(LocalStorage(tmp_path / "nothing"), paths, tmp_path / "out"))
    assert "No mission has been flown." in page.text
    assert page.images == []


def documents_of(paths: FleetPaths) -> list[str]:
    return [
        paths.fleet_spec,
        paths.reward,
        f"{paths.shaping}/trials.json",
        paths.plan(1),
        paths.evaluation(1),
        paths.artefacts(1),
        paths.weights(1),
        paths.landing(1, "agent-1"),
        paths.log(1, "agent-1"),
        paths.retraining(1, "1-2"),
        f"{paths.context('field')}/context.yaml",
        f"{paths.context('field')}/features.parquet",
    ]


@pytest.mark.parametrize("damage", [b"", b"{", b"[1, 2]", b"PK\x03\x04 torn", b"\xff\xfe\x00", b"null"])
def test_whatever_is_damaged_the_rest_is_reported_and_the_damage_is_named(
    damage: bytes, storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    for path in documents_of(paths):
        kept = storage.read(path)
        storage.write(path, damage)
        run = collect(storage, paths)
        assert len(run.missions) == 2
        if not path.endswith("log.jsonl"):  # readers of logs drop torn lines by design
            assert any(path in note or "the context field" in note for note in run.notes), path
        storage.write(path, kept)
    for path in documents_of(paths):
        storage.write(path, damage)
    assert "What could not be read" in page_of(write_report(storage, paths, tmp_path)).text


def test_whatever_is_missing_the_rest_is_reported(storage: LocalStorage, paths: FleetPaths) -> None:
    for path in documents_of(paths):
        kept = storage.read(path)
        storage.delete(path)
        run = collect(storage, paths)
        assert len(run.missions) == 2, path
        storage.write(path, kept)
    assert collect(storage, paths).notes == ()


def test_a_long_run_has_pictures_of_the_first_and_the_latest_missions(
    storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    for number in range(3, 15):
        shutil.copytree(storage.root / paths.mission(2), storage.root / paths.mission(number))
        evaluation = storage.read(paths.evaluation(2)).replace(b'"number":2', b'"number":%d' % number)
        storage.write(paths.evaluation(number), evaluation)
    page = page_of(write_report(storage, paths, tmp_path))
    pictured = {int(file.parent.name) for file in tmp_path.glob("missions/*/paths.png")}
    assert pictured == {1, *range(6, 15)}
    assert "4 missions between the first and the latest have no pictures here" in page.text
    assert len(list(tmp_path.glob("missions/*/map.csv"))) == 14


def test_levels_and_usefulness_are_those_of_the_documents(storage: LocalStorage, paths: FleetPaths) -> None:
    run = collect(storage, paths)
    assert run.models == ("initial", "1", "2", "1-2")
    assert {number: dict(one.usefulness) for number, one in run.weights.items()} == {
        1: {"initial": None, "1": None, "2": None, "1-2": None},
        2: {"initial": 0.1, "1": 0.2, "2": 0.3, "1-2": 0.4},
    }
    assert [[(one.subset, one.level) for one in run.retraining[number]] for number in (1, 2)] == [
        [("1-2", 3), ("1", 1), ("2", 2)],
        [("1-2", 3), ("1", 1), ("2", 2)],
    ]


def test_a_level_that_was_not_recorded_is_not_shown_as_zero(
    storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    for number in (1, 2):
        for subset in ("1", "2", "1-2"):
            report = storage.read(paths.retraining(number, subset))
            storage.write(paths.retraining(number, subset), re.sub(rb'"level":\d', b'"level":0', report))
    text = " ".join(page_of(write_report(storage, paths, tmp_path)).text.split())
    assert "1-2 0.400 – 2 80" in text  # noqa: RUF001 - the sign of an empty cell


def test_the_page_says_how_much_sa_decided(report: Path, storage: LocalStorage, paths: FleetPaths) -> None:
    runs = collect(storage, paths).missions[1].agents
    records = [record for run in runs for record in run.records]
    choices = sum(bin(record.legal).count("1") > 1 for record in records)
    text = page_of(report / "report.html").text
    assert f"SA chose {choices} of {len(records) - len(runs)} moves" in text
    assert "next to nothing" not in text


def test_a_mission_that_sa_had_no_part_in_is_not_credited_to_it(
    storage: LocalStorage, paths: FleetPaths, tmp_path: Path
) -> None:
    for agent in ("agent-1", "agent-2"):
        log = storage.read(paths.log(2, agent))
        storage.write(paths.log(2, agent), re.sub(rb'"legal":\d+', b'"legal":0', log))
    assert "says next to nothing about SA" in page_of(write_report(storage, paths, tmp_path)).text


def test_what_eval_predicted_is_in_the_map_as_it_was(report: Path, storage: LocalStorage, paths: FleetPaths) -> None:
    with np.load(io.BytesIO(storage.read(paths.artefacts(1)))) as artefacts:
        predicted, classes = artefacts["predicted"], artefacts["class"]
    with (report / "missions/0001/map.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["predicted"]) for row in rows] == predicted.reshape(-1).tolist()
    assert [float(row["class"]) for row in rows] == classes.reshape(-1).tolist()
    captured = collect(storage, paths).missions[0].captured
    assert {int(row["row"]) * 12 + int(row["col"]) for row in rows if row["visited"] == "1"} >= captured
