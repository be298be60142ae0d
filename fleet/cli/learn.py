"""`fleet shape` and `fleet train`."""

# ruff: noqa: PLC0415 - imports wait until a command runs, so that --help is quick

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fleet.cli import console, inputs
from fleet.errors import Problem, SpecError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from fleet.learning.lessons import Lessons
    from fleet.learning.model import SAModel
    from fleet.learning.planner import PlannerModel
    from fleet.learning.progress import Progress
    from fleet.learning.reward import RewardModel
    from fleet.learning.workbench import Workbench

_Spec = Annotated[Path, typer.Argument(metavar="SPEC", help="The FleetSpec, a YAML file.")]
_Out = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Folder of the run; fleet-out/NAME when left out, as in fleet run.")
]
_Seed = Annotated[int | None, typer.Option(min=0, help="Seed, in place of the FleetSpec's.")]
_Workers = Annotated[int | None, typer.Option(min=1, help="Worker processes; one a core when left out.")]
_Context = Annotated[list[str] | None, typer.Option(metavar="NAME=DIR", help="Take another folder for a context.")]
_AsJson = Annotated[bool, typer.Option("--json", help="For machines.")]


def shape(
    spec: _Spec,
    out: _Out = None,
    seed: _Seed = None,
    workers: _Workers = None,
    context: _Context = None,
    as_json: _AsJson = False,
) -> None:
    """Find the reward and the thresholds of HA over the shaping contexts, and nothing else.

    Interrupted and called again, it goes on where it was (with a Planner it starts anew); the result is the same for
    the same seed.

    Example: [bold]fleet shape my-swarm/fleetspec.yaml --out out/my-swarm[/bold]
    """
    school = _school(spec, out, seed, workers, context or [])
    reward = school.shape()
    if as_json:
        console.say_json({"storage": school.bench.storage.uri, "reward": reward.model_dump(mode="json")})
        return
    _show_reward(reward)
    console.say(f"storage: {school.bench.storage.uri}")


def train(
    spec: _Spec,
    out: _Out = None,
    seed: _Seed = None,
    workers: _Workers = None,
    context: _Context = None,
    as_json: _AsJson = False,
) -> None:
    """Train SA over the training contexts, after shaping the reward if that is not done.

    Interrupted and called again, it goes on where it was; the result is the same for the same seed. Fly with it in
    the simulator: [bold]fleet simulate SPEC --storage DIR/storage[/bold]

    Example: [bold]fleet train my-swarm/fleetspec.yaml --out out/my-swarm[/bold]
    """
    school = _school(spec, out, seed, workers, context or [])
    reward = school.shape()
    last = school.train(reward)
    if as_json:
        trained = {"loss": last and last.best_loss, "goals_met": last and last.goals_met}
        rewarded = reward.model_dump(mode="json")
        console.say_json({"storage": school.bench.storage.uri, "reward": rewarded, "training": trained})
        return
    _show_reward(reward)
    console.say(_trained_sentence(last))
    console.say(f"storage: {school.bench.storage.uri}")


@dataclass(frozen=True)
class _School:
    """Where shaping and training happen; results go where the roles look for them."""

    bench: Workbench
    pretrained: SAModel | PlannerModel | None
    workers: int

    def shape(self) -> RewardModel:
        with self._lessons("shaping the reward") as (lessons, _):
            return lessons.shape()

    def train(self, reward: RewardModel) -> Progress | None:
        with self._lessons("training SA") as (lessons, news):
            lessons.train(reward)
        return news[-1] if news else None

    @contextmanager
    def _lessons(self, text: str) -> Iterator[tuple[Lessons, list[Progress]]]:
        """Lessons that show their progress, and all their news."""
        from fleet.learning.lessons import Lessons

        news: list[Progress] = []
        with console.progress(text) as advance:

            def listen(progress: Progress) -> None:
                news.append(progress)
                advance(progress.done, progress.total)

            yield Lessons(self.bench, self.pretrained, self.workers, listen), news
        for message in dict.fromkeys(progress.message for progress in news if progress.message):
            console.note(message)


def _school(spec: Path, out: Path | None, seed: int | None, workers: int | None, context: Sequence[str]) -> _School:
    from fleet.learning.models import load_model
    from fleet.learning.planner import load_planner
    from fleet.spec.functions import ContextUse
    from fleet.spec.learning import SAKind
    from fleet.storage.open import open_storage

    fleet_spec = inputs.read_spec(spec)
    if seed is not None:
        missions = fleet_spec.spec.missions.model_copy(update={"seed": seed})
        fleet_spec = fleet_spec.model_copy(update={"spec": fleet_spec.spec.model_copy(update={"missions": missions})})
    folder = out or Path("fleet-out") / fleet_spec.name
    storage = open_storage(inputs.storage_uri(fleet_spec, folder))
    if storage.list(f"{inputs.paths_of(fleet_spec).root}/missions"):
        message = f"{folder} has missions that were flown with its reward and model"
        raise SpecError([Problem("--out", message, "name another folder")], source="the command line")
    with console.progress("mapping states") as advance:
        bench = inputs.open_bench(fleet_spec, spec, storage, inputs.read_overrides(context), advance)
        for use in (ContextUse.SHAPING, ContextUse.TRAINING):
            bench.terrains(use)  # now, while the bar is there; both steps find them in the bench
    document = fleet_spec.model_dump_json(by_alias=True, indent=1, exclude_none=True)
    storage.write(bench.paths.fleet_spec, document.encode())
    pretrained = fleet_spec.spec.sa.pretrained
    load = load_planner if fleet_spec.spec.sa.kind is SAKind.PLANNER else load_model
    model = load(inputs.read_beside(spec, pretrained)) if pretrained else None
    return _School(bench, model, workers or len(os.sched_getaffinity(0)))


def _show_reward(reward: RewardModel) -> None:
    from fleet.report.html import shaping_sentence_of

    if reward.planner is not None:
        rows = [(f"weight of {name}", f"{weight:.3f}") for name, weight in reward.planner.weights.model_dump().items()]
        rows += [("mapped", reward.planner.feature), ("caution", f"{reward.planner.caution:.2f}")]
    else:
        weights = zip(reward.features, reward.weights, strict=True)
        rows = [(f"weight of {name}", f"{weight:.3f}") for name, weight in weights]
        rows += [("utility threshold T_u", f"{reward.utility_threshold:.4g}")]
        rows += [("visited threshold T_v", str(reward.visited_threshold))]
    rows += [("loss", f"{reward.loss:.4g}")]
    console.table(("reward", "value"), rows)
    console.say(shaping_sentence_of(reward))


def _trained_sentence(last: Progress | None) -> str:
    if last is None:
        return "no context is for training: SA is what it was before"
    if last.best_loss is None:
        return f"SA is trained by {last.total} missions over the training contexts"
    met = "meets every goal" if last.goals_met else "does not meet every goal"
    loss = f"its loss is {last.best_loss:.4g}"
    return f"SA is trained: {last.total} candidates; the best {met} on the training contexts, {loss}"
