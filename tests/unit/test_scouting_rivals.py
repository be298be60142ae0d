"""Rivals that look at the map win where looking helps, and nowhere else."""

from __future__ import annotations

from functools import cache
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bench.scouting import __main__ as program
from bench.scouting.aims import against_best, at_equal_cells, at_share, best_rival
from bench.scouting.baselines import published
from bench.scouting.campaign import Curves, Job, jobs, read
from bench.scouting.campaign import flown as run
from bench.scouting.fields import Field, noise, planted
from bench.scouting.flight import ENERGY, thorough_j
from bench.scouting.judge import CHECKPOINTS, Curve, How, judged
from bench.scouting.ours import ours
from bench.scouting.paths import between
from bench.scouting.plots import draw
from bench.scouting.registry import plans
from bench.scouting.rivals.greedy import _along_legs, _distances, doubt, mistakes
from bench.scouting.rivals.groups import ClassicRL, Groups, others
from bench.scouting.rivals.lines import Transects
from bench.scouting.rivals.tours import RandomTour
from bench.scouting.tables import at_energy
from bench.statistics import paired
from fleet.contexts.grid import Grid

SMALL = (24, 30)
PLANTED, WHITE = Field(planted(2, *SMALL)), Field(noise(2, *SMALL))


@cache
def flown(name: str, white: bool, seed: int = 0) -> Curve:
    return judged(plans()[name], WHITE if white else PLANTED, 2, seed, [How.KR])


@pytest.mark.parametrize("name", list(plans()))
def test_every_plan_captures_each_cell_once_or_ends_when_that_is_too_dear(name: str) -> None:
    flights = plans()[name].fly(PLANTED, 3, 1, None)
    own = [flight.cells[flight.captured] for flight in flights]
    captured = np.unique(np.concatenate(own))
    assert len(flights) == 3
    assert all(len(cells) == len(np.unique(cells)) for cells in own)
    if name not in {ours.name for ours in ours()}:  # agents of ours may not have heard of each other yet
        assert len(captured) == sum(len(cells) for cells in own)
    spent = sum(flight.total_j for flight in flights) / thorough_j(PLANTED, 3)
    assert np.array_equal(np.sort(captured), PLANTED.cells) or 1.3 <= spent < 1.36


@pytest.mark.parametrize("name", list(plans()))
def test_plans_fly_the_same_with_the_same_seed(name: str) -> None:
    plan = plans()[name]
    budget = plan.budgets(PLANTED)[4] if plan.budgets(PLANTED) else None
    one, other = (plan.fly(PLANTED, 2, 7, budget) for _ in range(2))
    assert [flight.cells.tolist() for flight in one] == [flight.cells.tolist() for flight in other]


def test_sums_along_legs_are_those_of_the_cells_on_the_way() -> None:
    grid = Grid(np.ones((7, 9), dtype=np.bool_))
    values = np.random.default_rng(1).random((2, 7, 9))
    for here in (0, 31, 62):
        found = _along_legs(grid, values, here)
        moves, energy_j = _distances(grid, here)
        for target in range(63):
            at = grid.position(target)
            for leg, rows_first in enumerate((True, False)):
                path = between(grid, here, target, rows_first)[1:]
                slow = values.reshape(2, -1)[:, path].sum(axis=1)
                np.testing.assert_allclose(found[leg, :, at[0], at[1]], slow)
            assert moves[at] == len(between(grid, here, target)) - 1
            assert energy_j[at] <= moves[at] * ENERGY.aircraft.backward.energy_j + 1e-9


def test_doubt_is_small_inside_the_zones_and_large_between_them() -> None:
    captured = np.zeros(PLANTED.grid.cells, dtype=np.bool_)
    captured[::5] = True
    found = doubt(PLANTED, captured, np.zeros_like(captured))
    truth = PLANTED.truth.reshape(SMALL)
    unsure = np.abs(truth - 90) < 20
    unseen = ~captured.reshape(SMALL)
    assert found[unsure & unseen].mean() > 2 * found[~unsure & unseen].mean()


def test_doubt_knows_where_others_are_on_their_way() -> None:
    captured, awaited = np.zeros((2, PLANTED.grid.cells), dtype=np.bool_)
    captured[::7] = True
    awaited[3::7] = True
    assert doubt(PLANTED, captured, awaited).reshape(-1)[awaited].max() == 0.0
    assert doubt(PLANTED, captured, ~awaited & awaited).reshape(-1)[awaited].max() > 0.0


def test_doubt_never_looks_at_what_was_not_captured() -> None:
    captured, awaited = np.zeros((2, PLANTED.grid.cells), dtype=np.bool_)
    captured[::7] = True
    awaited[3::7] = True
    other = Field(planted(2, *SMALL))
    other.truth[~captured] = np.random.default_rng(0).normal(500, 100, int((~captured).sum()))
    np.testing.assert_array_equal(doubt(PLANTED, captured, awaited), doubt(other, captured, awaited))


def test_mistakes_are_where_the_class_is_wrong() -> None:
    every = np.ones(PLANTED.grid.cells, dtype=np.bool_)
    assert mistakes(PLANTED, every, ~every).sum() == 0
    one = np.zeros(PLANTED.grid.cells, dtype=np.bool_)
    one[int(np.argmax(PLANTED.truth))] = True
    assert 0.3 < mistakes(PLANTED, one, ~one).mean() < 1.0


@pytest.mark.parametrize("rival", ["transects, rows", "transects, columns", "random + tour", "k-NN Classic RL"])
def test_on_the_planted_field_looking_at_the_map_wins(rival: str) -> None:
    ours = flown("GP over its path", white=False)
    theirs = flown(rival, white=False)
    assert ours.reached(0.95, How.KR)[0] < 0.85 * theirs.reached(0.95, How.KR)[0]


@pytest.mark.parametrize("how", list(How))
def test_on_white_noise_looking_at_the_map_wins_nothing_at_equal_cells(how: How) -> None:
    names = ("GP over its path", "transects, rows")
    ours, theirs = (
        np.array(
            [judged(plans()[name], Field(noise(seed, *SMALL)), 2, seed, [how]).at_cells(0.5, how) for seed in range(6)]
        )
        for name in names
    )
    found = paired(ours, theirs)
    assert not found.certain
    assert abs(found.mean) < 0.015


def test_who_knows_the_truth_needs_less_than_who_does_not() -> None:
    guessed = flown("GP over its path", white=False).reached(0.95, How.KR)
    assert flown("greedy oracle", white=False).reached(0.95, How.KR)[0] < guessed[0]
    assert flown("oracle + tour", white=False).reached(0.95, How.KR)[1] < 0.9 * guessed[1]


@pytest.mark.parametrize("budget", [1 / 18, 1 / 9, 4 / 9])
def test_groups_capture_as_many_cells_as_they_may(budget: float) -> None:
    flights = Groups().fly(WHITE, 2, 0, budget)
    captured = np.concatenate([flight.cells[flight.captured] for flight in flights])
    assert len(captured) == pytest.approx(budget * len(WHITE.cells), rel=0.02)


def test_moves_in_groups_are_random() -> None:
    one, other = (Groups().fly(WHITE, 2, seed, 3 / 9)[0].cells.tolist() for seed in (0, 1))
    assert one != other


def test_the_flown_field_is_never_among_those_that_are_known() -> None:
    for place in (PLANTED, WHITE, Field(noise(0)), Field(planted(0))):
        assert place.name not in [other.name for other in others(place.name)]


def test_neighbours_choose_the_move_that_led_to_most() -> None:
    """Where values rise to the east only, the largest change is an east or west move, whatever the cell."""
    place = Field(noise(0, 10, 12))
    place.truth[:] = np.tile(np.arange(12.0) ** 2, 10)
    known = ClassicRL()._scores(place)
    assert known.shape == (120, 8)
    assert np.isfinite(known).all()
    assert (known[:, 4:] == 0).all()


def test_tables_and_pictures_hold_what_was_reached(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    curves: Curves = {
        Job(name, "planted", 2, seed): judged(plan, PLANTED, 2, seed, tuple(How))
        for name, plan in (("transects, rows", Transects(True)), ("random + tour", RandomTour()))
        for seed in (0, 1)
    }
    program.show(curves, Console(width=200), "transects, rows")
    text = capsys.readouterr().out
    assert text.count("planted, ") == text.count("minus transects, rows") == len(program.TOLD)
    for suffix in ("png", "svg"):
        draw(curves, How.KR, tmp_path / f"curves.{suffix}")
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    drawn = (tmp_path / "curves.svg").read_text()
    assert all(f"<!-- {text} -->" in drawn for text in ("transects, rows", "random + tour", "planted"))
    expected = np.mean([curve.accuracy[How.NM][38] for job, curve in curves.items() if job.plan == "random + tour"])
    assert at_energy(curves, "random + tour", ["planted"], 0.4, How.NM).mean() == pytest.approx(expected)


def flat(accuracy: float) -> Curve:
    """A plan that has an accuracy at once, and a cell for each share of energy."""
    return Curve(CHECKPOINTS.copy(), {How.KR: np.full(len(CHECKPOINTS), accuracy)}, 1.0, 1.0, 1.0)


def test_the_best_rival_is_the_one_that_needs_the_least_energy() -> None:
    slow = Curve(CHECKPOINTS.copy(), {How.KR: np.linspace(0.4, 1.0, len(CHECKPOINTS))}, 1.0, 1.0, 1.0)
    curves: Curves = {
        Job(name, "planted", 2, seed): curve
        for name, curve in (
            ("transects, rows", slow),
            ("transects, columns", flat(0.75)),
            ("lattice + tour", flat(0.6)),
        )
        for seed in (0, 1)
    }
    assert best_rival(curves, "planted", 0, How.KR) == ("transects, columns", CHECKPOINTS[0])
    assert best_rival(curves, "planted", 1, How.KR)[0] == "transects, rows"
    assert at_share(curves, "transects, columns", 0.4, How.KR).tolist() == [0.75, 0.75]
    console = Console(width=200, record=True, file=StringIO())
    console.print(against_best(curves, How.KR), at_equal_cells(curves, How.KR))
    text = console.export_text()
    assert "-15.0 [-15.0, -15.0]" in text  # lattice at the energy of the columns
    assert "+15.0 [+15.0, +15.0]" in text  # columns at the cells of the lattice


def test_published_figures_are_found_by_plan_and_field() -> None:
    assert published("random + tour", "2018-08-02") == ("6/22/53", "25/47/75")
    assert published("lawnmower", "gartner") == ("47/64/80", "47/64/79")
    assert published("greedy oracle", "gartner") == published("lawnmower", "lasrosas") == ("", "")


def test_the_program_writes_every_curve_and_a_picture_for_each_way_to_judge(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "out" / "scouting.json"
    command = "scouting --fields noise --plans lawnmower --seeds 2 --agents 2 --workers 1 --out"
    monkeypatch.setattr("sys.argv", [*command.split(), str(out)])
    program.main()
    assert list(read(out)) == [Job("lawnmower", "noise", 2, seed) for seed in (0, 1)]
    drawn = [path.name for path in out.parent.glob("*.png")]
    assert sorted(drawn) == [f"scouting-{how}.png" for how in sorted(program.TOLD)]
    assert "2 of 2" in capsys.readouterr().err
    monkeypatch.setattr("sys.argv", ["scouting", "--read", str(out), "--hows", "kr"])
    program.main()
    text = capsys.readouterr().out
    assert text.count("noise, kr") == 1
    assert "lawnmower" in text
    monkeypatch.setattr("sys.argv", ["scouting", "--read", str(out), "--hows", "kr", "--fields", "planted"])
    program.main()
    assert "lawnmower" not in capsys.readouterr().out


def test_several_processes_find_what_one_finds() -> None:
    wanted = jobs(["lawnmower"], ["noise"], 2, 2)
    one, two = (run(wanted, workers, lambda done, job: None) for workers in (1, 2))
    assert list(one) == list(two) == wanted
    for job in wanted:
        np.testing.assert_array_equal(one[job].accuracy[How.KR], two[job].accuracy[How.KR])
