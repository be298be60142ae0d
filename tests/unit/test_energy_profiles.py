from __future__ import annotations

from pathlib import Path

import pytest

from fleet.energy.profiles import AircraftProfile, EdgeProfile, built_in, load_aircraft, load_edge
from fleet.errors import SpecError

TASKS = ["forward", "backward", "left", "right", "takeoff", "land", "capture", "hover"]


def test_every_built_in_profile_is_a_good_one() -> None:
    assert built_in("aircraft") == ("spark-survey",)
    assert built_in("edge") == ("laptop-i5", "hub")
    for name in built_in("aircraft"):
        assert isinstance(load_aircraft(name), AircraftProfile)
    for name in built_in("edge"):
        assert isinstance(load_edge(name), EdgeProfile)


def test_the_survey_aircraft_costs_what_its_source_says() -> None:
    profile = load_aircraft("spark-survey")
    assert {name: (getattr(profile, name).power_w, getattr(profile, name).time_s) for name in TASKS} == {
        "forward": (127.2, 5.0),
        "backward": (130.3, 5.0),
        "left": (112.9, 5.0),
        "right": (112.9, 5.0),
        "takeoff": (52.8, 14.0),
        "land": (52.8, 14.0),
        "capture": (84.5, 1.0),
        "hover": (57.28, 1.0),
    }
    assert profile.battery.energy_j == pytest.approx(54_665.28)


def test_a_profile_is_read_from_a_file_beside_the_spec(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(
        "edge:\n  box:\n"
        "    send_image: {power_w: 10, time_s: 1, sd: 0.1}\n"
        "    extract_features: {power_w: 30, time_s: 2}\n"
        "    knn: {power_w: 20, time_s: 0.5}\n"
        "    idle: {power_w: 5}\n"
    )
    profile = load_edge("mine.yaml#box", tmp_path)
    assert (profile.name, profile.decide.power_w, profile.busy_w, profile.state_s) == ("box", 20.0, 30.0, 3.5)


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("laptop-i6", "edge: built-in profiles has no edge profile 'laptop-i6'; did you mean laptop-i5?"),
        ("mine.yaml", "'mine.yaml' names a file but no profile in it; write mine.yaml#name"),
        ("#box", "'#box' is not a profile; write path/to/file.yaml#name"),
        ("mine.yaml#", "'mine.yaml#' is not a profile; write path/to/file.yaml#name"),
        (
            "none.yaml#box",
            "none.yaml: cannot be read: No such file or directory; "
            "give the path of a YAML file with `aircraft` and `edge` profiles",
        ),
        ("list.yaml#box", "edge: list.yaml has no edge profiles; write `edge:` and under it a profile by name"),
        ("mine.yaml#x", "edge: mine.yaml has no edge profile 'x'; it has box, number"),
        ("mine.yaml#number", "number: is not a profile; give it fields such as `idle: {power_w: 2.5}`"),
        (
            "mine.yaml#box",
            "box.extract_features: is missing; tasks are written {power_w: 12.5, time_s: 1.0}\n"
            "box.idel: is not a field of a profile; remove it, or correct its name\n"
            "box.idle: is missing; tasks are written {power_w: 12.5, time_s: 1.0}\n"
            "box.knn.power_w: input should be a finite number, not inf\n"
            "box.send_image.power_w: input should be a valid number, unable to parse string as a number, not 'x'\n"
            "box.send_image.time_s: input should be greater than or equal to 0, not -1",
        ),
    ],
)
def test_a_wrong_profile_is_refused_with_what_to_write(tmp_path: Path, reference: str, message: str) -> None:
    (tmp_path / "list.yaml").write_text("[1, 2]\n")
    (tmp_path / "mine.yaml").write_text(
        "edge:\n  box: {send_image: {power_w: x, time_s: -1}, knn: {power_w: .inf, time_s: 1}, idel: {power_w: 1}}\n"
        "  number: 3\n"
    )
    with pytest.raises(SpecError) as caught:
        load_edge(reference, tmp_path)
    assert str(caught.value) == message


@pytest.mark.parametrize("content", ["{", "\x00", "edge: [\n"])
def test_a_file_that_is_not_yaml_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "bad.yaml").write_text(content)
    with pytest.raises(SpecError, match=r"bad.yaml: is not YAML"):
        load_aircraft("bad.yaml#x", tmp_path)


BOMB = "\n".join([
    "a0: &a0 [x, x, x, x, x, x, x, x, x, x]",
    *(f"a{n}: &a{n} [{', '.join(['*a' + str(n - 1)] * 10)}]" for n in range(1, 9)),
    "edge: {box: {idle: *a8}}",
])  # fmt: skip


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (BOMB, "bad.yaml: is not YAML: write it out in place of an alias"),
        ("[" * 100_000, "bad.yaml: is not YAML: maximum recursion depth"),
        ("#" * 300_000, "bad.yaml: is larger than 256 KiB"),
        ("edge: {box: {idle: {power_w: " + "9" * 200_000 + "x}}}", "valid number, unable to parse string as a number"),
    ],
    ids=["aliases", "deep", "large", "a long value"],
)
def test_a_small_file_that_means_much_is_refused_in_few_words(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "bad.yaml").write_text(content)
    with pytest.raises(SpecError) as caught:
        load_edge("bad.yaml#box", tmp_path)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_a_file_without_an_end_is_not_read_to_its_end() -> None:
    with pytest.raises(SpecError, match="/dev/zero: is larger than 256 KiB"):
        load_edge("/dev/zero#box")


def test_every_profile_of_the_shared_file_is_read(shared_data: Path) -> None:
    file = shared_data / "energy" / "profiles.yaml"
    assert load_aircraft(f"{file}#dji-mavic").forward.energy_j == pytest.approx(394.6)
    assert load_edge(f"{file}#laptop-i7").state_s == pytest.approx(4.674)
    assert load_edge(f"{file}#server-gpu").busy_w == 92.0
