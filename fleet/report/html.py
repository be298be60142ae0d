"""report.html: one page with everything in it, for people."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources

import jinja2
import numpy as np
import yaml

import fleet
from fleet.functions.contract import AgentMetrics
from fleet.learning.reward import RewardModel
from fleet.missions.documents import Expense, GoalResult, RetrainingReport
from fleet.report import measures
from fleet.report.collect import AgentRun, MissionRun, RunData
from fleet.report.pictures import Picture
from fleet.spec.swarm import Goal


@dataclass(frozen=True)
class Table:
    """Texts in rows; the first column names the row, the others are set to the right."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class MissionSection:
    """What the page says of one mission."""

    number: int
    title: str
    rendered: bool
    choices: str
    goals: tuple[tuple[bool, str], ...]
    agents: Table
    failures: Mapping[str, str]
    pictures: tuple[Picture, ...]


def render(run: RunData, pictures: Mapping[str, Sequence[Picture]]) -> str:
    """The page.

    Args:
        pictures: By place: `metrics`, `models`, `reward`, and `mission N` for the missions that have some.
    """
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["data_uri"] = _data_uri
    template = environment.from_string(resources.files("fleet.report").joinpath("report.html").read_text("utf-8"))
    shown = [mission for mission in run.missions if f"mission {mission.number}" in pictures]
    return template.render(
        name=run.spec.name if run.spec else run.paths.fleet,
        namespace=run.paths.namespace,
        verdict=verdict(run),
        good=_succeeded(run),
        cards=_cards(run),
        missions=missions_table(run),
        sections=[_section(mission, run, pictures[f"mission {mission.number}"]) for mission in reversed(shown)],
        left_out=len(run.missions) - len(shown),
        metric_pictures=pictures.get("metrics", ()),
        models=_models_table(run),
        models_pictures=pictures.get("models", ()),
        learning=_learning_table(run),
        shaping=shaping_sentence(run),
        thresholds=_thresholds(run),
        reward_pictures=pictures.get("reward", ()),
        notes=run.notes,
        facts=_facts(run),
        spec=_spec_yaml(run),
    )


def verdict(run: RunData) -> str:
    """One or two sentences: how many missions were flown, whether all of the run is there, and the goals."""
    planned = run.spec.spec.missions.count if run.spec else None
    over = [mission.evaluation for mission in run.missions if mission.evaluation]
    if not run.missions:
        return "No mission has been flown."
    counted = f"{len(over)} of {planned} missions" if planned else f"{len(over)} missions"
    text = f"{counted} flown to the end."
    if len(run.missions) > len(over):
        text += f" Mission {run.missions[-1].number} was broken off, or is still flying."
    if over:
        met = sum(result.met for result in over[-1].goals)
        text += f" The last one met {met} of {len(over[-1].goals)} goals."
    return text


def shaping_sentence(run: RunData) -> str:
    """What became of reward shaping, in plain words."""
    if run.reward is None:
        return f"Reward shaping has not ended: {len(run.trials)} parameter sets were simulated so far."
    return shaping_sentence_of(run.reward)


def shaping_sentence_of(reward: RewardModel) -> str:
    """Whether the goals were met in simulation, and by how many parameter sets."""
    if not reward.evaluations:
        if reward.planner is not None:
            return "Nothing was rehearsed: the caution is given, or what is usual for the goal."
        return "Nothing was shaped: the FleetSpec gives every weight and threshold."
    if reward.planner is not None:
        return f"{reward.successes} of {reward.evaluations} rehearsed missions met every goal with this caution" + (
            "." if reward.goals_met else ", fewer than ha.confidence asks for. Missions may miss their goals."
        )
    if reward.goals_met:
        found = f"{reward.successes} of {reward.evaluations} parameter sets"
        return f"{found} met every goal on every shaping context in simulation; the one of least cost is used."
    return (
        f"None of {reward.evaluations} parameter sets met all goals on all shaping contexts in simulation. "
        f"The best one seen is used; its loss is {reward.loss:.4g}. Missions may miss their goals."
    )


def choices_sentence(mission: MissionRun) -> str:
    """How much of a mission SA decided; the reader must not credit it with what HA and the order of groups did."""
    choices, moves = sum(run.choices for run in mission.agents), sum(run.moves for run in mission.agents)
    if not moves:
        return ""
    if any(record.heard for run in mission.agents for record in run.records):
        return f"SA planned {moves:,} moves in {choices:,} looks at the map."
    text = f"SA chose {choices:,} of {moves:,} moves; HA and the order of the state groups fixed the others."
    return (
        text if choices >= 0.05 * moves else text + " So this mission says next to nothing about SA or its retraining."
    )


def missions_table(run: RunData) -> Table:
    """One row a mission: goals met and every metric."""
    names = measures.ordered(name for one in run.missions if one.evaluation for name in one.evaluation.metrics)
    rows = []
    for mission in run.missions:
        evaluation = mission.evaluation
        values = [measures.text(name, evaluation.metrics.get(name) if evaluation else None) for name in names]
        met = f"{sum(one.met for one in evaluation.goals)} of {len(evaluation.goals)}" if evaluation else "not over"
        rows.append((str(mission.number), mission.context, met, *values, str(len(mission.failures))))
    header = ("mission", "context", "goals met", *(measures.label(name) for name in names), "failed agents")
    return Table(header, tuple(rows))


def _succeeded(run: RunData) -> bool:
    """Whether every planned mission is over and the last one met all its goals."""
    over = [mission.evaluation for mission in run.missions if mission.evaluation]
    planned = run.spec.spec.missions.count if run.spec else 1
    return len(over) >= planned and over[-1].goals_met


def _cards(run: RunData) -> list[tuple[str, str]]:
    """The figures of the last mission that is over, goals' metrics first."""
    over = [mission.evaluation for mission in run.missions if mission.evaluation]
    if not over:
        return []
    wanted = [result.goal.metric for result in over[-1].goals]
    wanted += ["accuracy", "coverage", "time_s", "uav_energy_j", "edge_energy_j"]
    unique = dict.fromkeys(name for name in wanted if name in over[-1].metrics)
    return [(measures.label(name), measures.text(name, over[-1].metrics[name])) for name in unique][:6]


def _section(mission: MissionRun, run: RunData, pictures: Sequence[Picture]) -> MissionSection:
    results = mission.evaluation.goals if mission.evaluation else ()
    return MissionSection(
        number=mission.number,
        title=f"Mission {mission.number}" + (f" over {mission.context}" if mission.context else ""),
        rendered=mission.rendered,
        choices=choices_sentence(mission),
        goals=tuple((result.met, _goal_text(result)) for result in results),
        agents=_agents_table(mission),
        failures=mission.failures,
        pictures=tuple(pictures),
    )


def _goal_text(result: GoalResult) -> str:
    value = measures.text(result.goal.metric, result.value) if result.value is not None else "not measured"
    return f"{measures.label(result.goal.metric)} {_bounds(result.goal)}: {value}"


def _bounds(goal: Goal) -> str:
    bounds = (("at least", goal.at_least), ("at most", goal.at_most))
    return " and ".join(f"{word} {measures.text(goal.metric, one)}" for word, one in bounds if one is not None)


def _agents_table(mission: MissionRun) -> Table:
    header = ("agent", "steps", "captures", "SA's choices", "groups", "time", "UAV energy", "edge energy", "ended")
    return Table(header, tuple(_agent_row(mission, index) for index in range(len(mission.agents))))


def _agent_row(mission: MissionRun, index: int) -> tuple[str, ...]:
    run = mission.agents[index]
    if run.landing is None:
        last = run.records[-1] if run.records else None
        metrics = AgentMetrics(
            agent=run.agent,
            steps=len(run.records),
            captures=sum(record.captured for record in run.records),
            time_s=last.time_s if last else 0.0,
            uav_energy_j=last.uav_energy_j if last else 0.0,
        )
        groups, edge, ended = "–", "–", "in the air"  # noqa: RUF001  # an en dash is the usual sign for an empty cell
    else:
        metrics = run.landing.metrics
        groups = f"{metrics.groups_explored} of {metrics.groups}"
        edge = measures.text("edge_energy_j", metrics.edge_energy_j)
        ended = "failed" if run.agent in mission.failures else _ended(run, metrics)
    time, energy = measures.duration(metrics.time_s), measures.text("uav_energy_j", metrics.uav_energy_j)
    counts = (f"{metrics.steps:,}", f"{metrics.captures:,}", f"{run.choices:,}")
    return run.agent, *counts, groups, time, energy, edge, ended


def _ended(run: AgentRun, metrics: AgentMetrics) -> str:
    """Why an agent landed that did not fail: a flight with groups before it ends only when Eval() says so."""
    last = run.records[-1] if run.records else None
    if last is not None and last.claimed is not None:
        return f"landed, with {last.claimed:.1%} of the map expected right"
    over = metrics.groups_explored >= metrics.groups
    return "landed: all groups explored" if over else "landed: Eval() said finished"


def _models_table(run: RunData) -> Table:
    last = run.weights[max(run.weights)].usefulness if run.weights else {}
    rows = []
    for model in run.models:
        reports = [one for number in sorted(run.retraining) for one in run.retraining[number] if one.subset == model]
        useful = last.get(model)
        rows.append(
            (
                model,
                "not flown yet" if useful is None else f"{useful:.3f}",
                _level(reports),
                str(len(reports)),
                f"{sum(one.transitions for one in reports):,}",
                measures.duration(sum(one.cpu_s for one in reports)),
                measures.text("energy_j", sum(one.energy_j for one in reports)),
            )
        )
    header = ("model", "usefulness", "last level", "retrained", "transitions", "CPU time", "energy")
    return Table(header, tuple(rows))


def _learning_table(run: RunData) -> Table:
    """What learning cost, beside the flights' own energy."""
    rows = []
    for number in sorted(run.trainer.keys() | run.retraining.keys()):
        aggregators = run.retraining.get(number, ())
        if aggregators:
            rows.append(_expense(f"{len(aggregators)} aggregators after mission {number}", aggregators))
        if number in run.trainer:
            name = f"weighing after mission {number}" if number else "shaping and training"
            rows.append(_expense(name, [run.trainer[number]]))
    if rows:
        rows.append(
            _expense("all", [*run.trainer.values(), *(one for all_ in run.retraining.values() for one in all_)])
        )
    return Table(("learning", "CPU time", "edge energy"), tuple(rows))


def _expense(name: str, parts: Sequence[Expense]) -> tuple[str, str, str]:
    cpu_s, energy_j = sum(part.cpu_s for part in parts), sum(part.energy_j for part in parts)
    return name, measures.duration(cpu_s), measures.text("energy_j", energy_j)


def _level(reports: Sequence[RetrainingReport]) -> str:
    """The last level; an aggregator at level 0 is suspended and reports nothing, so 0 says that none was recorded."""
    return str(reports[-1].level) if reports and reports[-1].level else "–"  # noqa: RUF001  # see above


def _thresholds(run: RunData) -> list[tuple[str, str]]:
    if run.reward is None:
        return []
    planner = run.reward.planner
    if planner is not None:
        return [
            ("feature that is mapped", planner.feature),
            *((name.replace("_", " "), f"{value:.2f}") for name, value in planner.weights.model_dump().items()),
            ("goal for accuracy", measures.text("accuracy", planner.goal)),
            ("caution", f"{planner.caution:.2f}"),
        ]
    return [
        ("utility threshold T_u", f"{run.reward.utility_threshold:.4g}"),
        ("visited threshold T_v", str(run.reward.visited_threshold)),
        ("loss on the shaping contexts", f"{run.reward.loss:.4g}"),
    ]


def _facts(run: RunData) -> list[tuple[str, str]]:
    recorded = run.spec.metadata.annotations.get("fleetcomputer.io/version") if run.spec else None
    facts = [("fleet", recorded or f"{fleet.__version__} (this report)"), ("Python", platform.python_version())]
    facts.append(("NumPy", np.__version__))
    if run.spec:
        facts.append(("seed", str(run.spec.spec.missions.seed)))
        facts.append(("agents", str(len(run.spec.spec.agents.resolved))))
    return [*facts, ("place in storage", run.paths.root)]


def _spec_yaml(run: RunData) -> str:
    if run.spec is None:
        return ""
    document = run.spec.model_dump(mode="json", by_alias=True, exclude_none=True, exclude={"status"})
    document["metadata"] = {key: value for key, value in document["metadata"].items() if value}
    return yaml.safe_dump(document, sort_keys=False, width=100)


def _data_uri(picture: Picture) -> str:
    return "data:image/png;base64," + base64.b64encode(picture.png).decode()
