"""The world of crash tests for pytest; runs that tests were chosen for go on side by side."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait

import pytest

from tests.crash.application import ROUGH, SMOOTH
from tests.crash.campaign import NOTHING, Allowed, all_kills, check, sample
from tests.crash.scenarios import Scenario
from tests.crash.trial import Kill, Plan, Result, run_trial
from tests.crash.world import World, cores, world
from tests.testbed.requirements import need

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


@pytest.fixture(scope="session")
def crash_runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    """Control plane, HDFS and stand-in kubelets with all runs; shared by all tests of the group `crash`."""
    need("openssl", "setpriv", "java", "etcd", "kube-apiserver", "kube-controller-manager", "kubectl")
    chosen = [getattr(item, "callspec").params for item in request.session.items if hasattr(item, "callspec")]  # noqa: B009 - pytest's items have no public type with it
    scenarios = [each["scenario"] for each in chosen if isinstance(each.get("scenario"), Scenario)]
    kills = [each["crash_kill"] for each in chosen if "crash_kill" in each]
    with world(tmp_path_factory.mktemp("crash"), slots=cores()) as place:
        runs = Runs(place, scenarios, kills)
        try:
            yield runs
        finally:
            runs.close()
