"""What processes flew is explained, step by step, by the mind that they flew with."""

from __future__ import annotations

from pathlib import Path

from fleet.missions.flight import LAND
from fleet.report.explain import flights_of, open_log
from fleet.runtime.settings import Settings
from fleet.storage.local import LocalStorage
from tests.scouting import PATHS


def test_every_step_of_a_flown_run_is_explained_as_it_was_recorded(undisturbed: Path) -> None:
    storage = LocalStorage(undisturbed / "out/storage")
    for agent in ("agent-1", "agent-2"):
        settings = Settings(storage.uri, PATHS.namespace, PATHS.fleet, agent=agent)
        flights = flights_of(settings)
        assert flights
        for number in flights:
            log = open_log(settings.at_mission(number))
            steps = log.explain()
            assert (log.lost, steps[-1].record.move) == (0, LAND)
            assert [step.record for step in steps] == list(log.records)
            assert [sum(1 << move for move in step.legal) for step in steps] == [one.legal for one in log.records]
            for step in steps:
                if step.legal:
                    assert step.record.move == max(step.legal, key=lambda move: (step.blended[move], -move))
