"""The world of crash tests for pytest; runs that tests were chosen for go on side by side."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait

import pytest

from tests.crash.campaign import all_kills, check, sample
from tests.crash.scenarios import Scenario
from tests.crash.trial import Plan, run_trial
from tests.crash.world import World, cores, world
from tests.testbed.requirements import need

KILLS = 8
SEED = 0
MISSIONS = 1


class Runs:
    """All runs of a test session: started at once, waited for one by one.

    Args:
        scenarios, kills: Those that tests were chosen for; a kill is known by its place in the sample.
    """

    def __init__(self, place: World, scenarios: list[Scenario], kills: list[int]) -> None:
        self._world = place
        self._expected = run_trial(place, Plan("undisturbed", missions=MISSIONS))
        self._pool = ThreadPoolExecutor(place.slots.qsize())
        chosen = sample(all_kills(self._expected.writes), KILLS, SEED)
        plans = {each.name: each.plan(MISSIONS) for each in scenarios if not each.alone}
        self._scenarios = {each.name: each for each in scenarios}
        self._runs = {name: self._start(plan) for name, plan in plans.items()}
        self._kills = {index: self._start(Plan(f"kill-{index}", chosen[index], missions=MISSIONS)) for index in kills}
        self.names = {index: str(chosen[index]) for index in kills}

    def scenario(self, scenario: Scenario) -> list[str]:
        """What went wrong with a scenario."""
        if scenario.alone:
            wait([*self._runs.values(), *self._kills.values()])
            return check(self._world, self._expected, scenario.plan(MISSIONS), scenario.allowed)
        return self._runs[scenario.name].result()

    def kill(self, index: int) -> list[str]:
        """What went wrong with a kill."""
        return self._kills[index].result()

    def close(self) -> None:
        self._pool.shutdown(cancel_futures=True)

    def _start(self, plan: Plan) -> Future[list[str]]:
        scenario = self._scenarios.get(plan.name)
        allowed = () if scenario is None else (scenario.allowed,)
        return self._pool.submit(check, self._world, self._expected, plan, *allowed)


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
