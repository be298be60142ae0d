"""The runs that tests of a session were chosen for, side by side."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor, wait

from tests.crash.application import ROUGH, SMOOTH
from tests.crash.campaign import NOTHING, Allowed, all_kills, check, sample
from tests.crash.scenarios import Scenario
from tests.crash.trial import Kill, Plan, Result, run_trial
from tests.crash.world import World

KILLS = 8
SEED = 0


class Runs:
    """All runs of a test session: started at once, waited for one by one.

    Args:
        scenarios, kills: Those that tests were chosen for; a kill is known by its place in the sample.
    """

    def __init__(self, place: World, scenarios: list[Scenario], kills: list[int]) -> None:
        self._world = place
        self._pool = ThreadPoolExecutor(place.slots.qsize())
        smooth = self._pool.submit(run_trial, place, Plan("smooth", SMOOTH)) if scenarios else None
        rough = self._pool.submit(run_trial, place, Plan("rough", ROUGH)) if kills else None
        self._runs: dict[str, Future[list[str]]] = {}
        self.kills: dict[int, Kill] = {}
        if rough is not None:
            sampled = sample(all_kills(rough.result().writes), KILLS, SEED)
            self.kills = {index: sampled[index] for index in kills}
            for index, kill in self.kills.items():
                self._start(rough.result(), Plan(f"kill-{index}", ROUGH, kill))
        if smooth is not None:
            self._smooth = smooth.result()
            for each in scenarios:
                if not each.alone:
                    self._start(self._smooth, each.plan, each.allowed)

    def scenario(self, scenario: Scenario) -> list[str]:
        """What went wrong with a scenario."""
        if scenario.alone:
            wait(self._runs.values())
            return check(self._world, self._smooth, scenario.plan, scenario.allowed)
        return self._runs[scenario.name].result()

    def kill(self, index: int) -> list[str]:
        """What went wrong with a kill."""
        return self._runs[f"kill-{index}"].result()

    def close(self) -> None:
        self._pool.shutdown(cancel_futures=True)

    def _start(self, expected: Result, plan: Plan, allowed: Allowed = NOTHING) -> None:
        self._runs[plan.name] = self._pool.submit(check, self._world, expected, plan, allowed)
