"""A mission that processes fly is, step for step and joule for joule, the mission that the simulator flies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fleet.energy.accounting import Cost
from fleet.functions.clients import open_eval, open_map
from fleet.learning.models import load_model
from fleet.learning.reward import RewardModel
from fleet.learning.score_tables import Flights, batch_of, score_table
from fleet.learning.workbench import Workbench
from fleet.missions.documents import INITIAL, Landing, MissionEvaluation
from fleet.missions.flight import LAND
from fleet.missions.layout import MOVES
from fleet.missions.records import read_log
from fleet.simulator.batch import fly
from fleet.simulator.evaluation import evaluate_missions
from fleet.spec.resources import FleetSpec
from fleet.storage.local import LocalStorage
from tests.scouting import PATHS


def test_flown_and_simulated_mission_are_the_same(undisturbed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(undisturbed / "swarm")  # where the FleetSpec's profile is
    monkeypatch.syspath_prepend(str(undisturbed / "swarm"))
    storage = LocalStorage(undisturbed / "out/storage")
    fleet = FleetSpec.model_validate(json.loads(storage.read(PATHS.fleet_spec))).spec
    bench = Workbench(fleet, storage, PATHS, open_map(fleet.map), open_eval(fleet.eval))
    terrain = bench.terrain("third")
    reward = RewardModel.model_validate_json(storage.read(PATHS.reward))
    models = {INITIAL: load_model(storage.read(PATHS.initial_model))}
    table = score_table(models, {INITIAL: 1.0}, terrain)
    names = [agent.name for agent in bench.agents]

    flown = fly(terrain.layout, batch_of(table, reward, terrain, Flights()), traced=True)
    evaluation = evaluate_missions(terrain, flown, names, bench.energy, bench.evaluator)[0]

    trace = flown.trace
    assert trace is not None
    for index, name in enumerate(names):
        records = read_log(storage.read(PATHS.log(1, name)))
        steps = int(trace.steps[0, index])
        assert [record.cell for record in records] == trace.cell[0, index, :steps].tolist()
        assert [record.move for record in records] == trace.move[0, index, :steps].tolist()
        assert [record.legal for record in records] == trace.legal[0, index, :steps].tolist()
        assert [record.captured for record in records] == trace.captured[0, index, :steps].tolist()
        for record in records:
            if record.captured:
                np.testing.assert_array_equal(record.ssv, terrain.ssv[record.cell])
        spent = bench.energy.take_off()
        for record in records:
            assert record.time_s == pytest.approx(spent.time_s), "the time of arrival"
            spent += bench.energy.capture() if record.captured else Cost()
            assert record.uav_energy_j == pytest.approx(spent.energy_j), "up to and including the capture"
            spent += bench.energy.decision() if record.legal else Cost()
            spent += bench.energy.move(MOVES[record.move]) if record.move != LAND else bench.energy.land()
        metrics = Landing.model_validate_json(storage.read(PATHS.landing(1, name))).metrics
        assert (metrics.time_s, metrics.uav_energy_j) == pytest.approx((spent.time_s, spent.energy_j))
    written = MissionEvaluation.model_validate_json(storage.read(PATHS.evaluation(1)))
    # Kriging solves with as many threads as a process may have, and sums in another order with each number of them.
    assert written.metrics == pytest.approx(dict(evaluation.metrics), rel=1e-12)
