"""Which pictures a report has, from the data of a run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.contexts.grid import Grid
from fleet.report import figures, measures, plots
from fleet.report.collect import MissionRun, RunData
from fleet.report.tables import CLASS, PREDICTED, grid_or_nan, map_shape
from fleet.spec.swarm import Goal

MODEL_LIMIT = 31
"""Models in the picture; with more, those that were most useful in the end."""
_LATEST = 9


@dataclass(frozen=True)
class Picture:
    """One PNG.

    Args:
        path: Where it is stored, relative to the report.
        caption: What it shows, for the reader.
    """

    path: str
    caption: str
    png: bytes


def pictured(missions: Sequence[MissionRun]) -> tuple[MissionRun, ...]:
    """The missions that get pictures: the first and the latest, so that a long run has a report of readable size."""
    return tuple(missions) if len(missions) <= _LATEST + 1 else (missions[0], *missions[-_LATEST:])


def mission_pictures(mission: MissionRun) -> tuple[Picture, ...]:
    """True map, paths, predicted map, error and classes of a mission: those for which the data is there."""
    shape = map_shape(mission)
    if shape is None:
        return ()
    environment = mission.environment
    predicted = grid_or_nan(mission.artefacts.get(PREDICTED), shape)
    grid = environment.grid if environment else Grid(np.isfinite(predicted))
    truth = np.where(grid.valid, grid_or_nan(environment.truth if environment else None, shape), np.nan)
    predicted = np.where(grid.valid, predicted, np.nan)
    classes = np.where(grid.valid, grid_or_nan(mission.artefacts.get(CLASS), shape), np.nan)
    maps = _Maps(mission, grid, (environment.truth_name if environment else "") or "value")
    return tuple(maps.all(truth, predicted, classes))


@dataclass(frozen=True, eq=False)
class _Maps:
    mission: MissionRun
    grid: Grid
    quantity: str

    def all(
        self, truth: NDArray[np.float64], predicted: NDArray[np.float64], classes: NDArray[np.float64]
    ) -> Iterable[Picture]:
        scale = figures.value_scale(self.quantity, [truth, predicted])
        if _any(truth):
            yield self._picture("truth", f"True {self.quantity}.", plots.value_map(self.grid, truth, scale))
        yield self._picture(
            "paths",
            "Way of each agent over the true map: a disc where it took off, a cross in its last state.",
            plots.path_map(self.grid, truth if _any(truth) else None, _tracks(self.mission)),
        )
        if _any(predicted):
            yield self._picture(
                "predicted",
                f"Predicted {self.quantity}, in the colours of the true map.",
                plots.value_map(self.grid, predicted, scale),
            )
        error = predicted - truth
        if _any(error):
            scale = figures.error_scale(f"predicted - true {self.quantity}", error)
            mean = float(np.mean(np.abs(error[np.isfinite(error)])))
            caption = f"Error of the prediction; its mean size is {mean:.3g}."
            yield self._picture("error", caption, plots.value_map(self.grid, error, scale))
        if _any(classes):
            scale = figures.class_scale("class", [classes])
            yield self._picture("classes", "Predicted classes.", plots.value_map(self.grid, classes, scale))

    def _picture(self, name: str, caption: str, png: bytes) -> Picture:
        return Picture(f"missions/{self.mission.number:04d}/{name}.png", caption, png)


def claims_pictures(run: RunData, mission: MissionRun) -> tuple[Picture, ...]:
    """What agents that plan expected of their map against what was true, and how well they were calibrated."""
    if run.reward is None or run.reward.planner is None:
        return ()
    from fleet.report.claims import mission_claims  # noqa: PLC0415 - loads scipy and numba

    goal = run.spec.spec.accuracy_goal if run.spec else None
    planner = run.reward.planner.model_copy(update={"goal": goal} if goal else {})
    found = mission_claims(mission, planner, run.reward.features)
    if found is None:
        return ()
    claims, folder = found.claims, f"missions/{mission.number:04d}"
    minutes = (claims.time_s / 60.0).tolist()
    over_time = [
        figures.Line("expected by the agents", minutes, (100.0 * claims.claimed).tolist()),
        figures.Line("needed to land", minutes, (100.0 * claims.needed).tolist(), dashed=True),
    ]
    if _any(claims.true):
        over_time.append(figures.Line("true", minutes, (100.0 * claims.true).tolist()))
    parts = [("before correction", found.captured), ("corrected", found.calibrated)]
    if found.unseen is not None:
        parts.append(("cells never captured", found.unseen))
    lines = [
        figures.Line(label, (100.0 * one.probability).tolist(), (100.0 * one.right).tolist()) for label, one in parts
    ]
    return (
        Picture(
            f"{folder}/accuracy.png",
            "Accuracy that the agents expected of their map, and what they needed to expect in order to land.",
            plots.accuracy_over_time(over_time, 100.0 * claims.goal),
        ),
        Picture(
            f"{folder}/calibration.png",
            "How often a cell's most probable class was right, by its probability: predictions held against captures, "
            "and the last ones against the truth where that is known.",
            plots.calibration(lines),
        ),
    )


def metric_pictures(run: RunData) -> tuple[Picture, ...]:
    """One chart for each metric that at least two missions have a value of."""
    evaluated = [mission.evaluation for mission in run.missions if mission.evaluation]
    goals = run.spec.spec.goals if run.spec else ()
    pictures = []
    for metric in measures.ordered(name for evaluation in evaluated for name in evaluation.metrics):
        points = [
            (one.number, one.metrics[metric]) for one in evaluated if np.isfinite(one.metrics.get(metric, np.nan))
        ]
        if len(points) > 1:
            png = plots.metric_over_missions(_series(metric, points, goals))
            pictures.append(Picture(f"metrics/{metric}.png", f"{measures.label(metric)} over missions", png))
    return tuple(pictures)


def models_picture(run: RunData) -> Picture | None:
    """Usefulness and level of each model over missions; None before a model was weighed."""
    models = _most_useful(run)
    usefulness = {
        number: [_or_nan(document.usefulness.get(model)) for model in models]
        for number, document in sorted(run.weights.items())
    }
    levels = {
        # At level 0 an aggregator is suspended and reports nothing: 0 says that no level was recorded.
        number: [{one.subset: float(one.level or np.nan) for one in reports}.get(model, np.nan) for model in models]
        for number, reports in sorted(run.retraining.items())
        if reports
    }
    if not models or not (usefulness or levels):
        return None
    caption = "Usefulness of each model, and the scheduling level at which its aggregator retrained it; grey: none."
    if len(models) < len(run.models):
        caption += f" Shown are the {len(models)} of {len(run.models)} models that were most useful in the end."
    return Picture("models.png", caption, plots.models_over_missions(models, usefulness, levels))


def trials_picture(run: RunData) -> Picture | None:
    """What each parameter set of reward shaping cost and reached; None when nothing can be drawn."""
    goal = next((goal for goal in run.spec.spec.goals if goal.at_least is not None), None) if run.spec else None
    cost = run.spec.spec.reward_shaping.minimise if run.spec else ""
    if goal is None or not cost:
        return None
    (x_factor, x_unit), (y_factor, y_unit) = measures.scaled(cost), measures.scaled(goal.metric)
    points = [(trial.mean(cost) * x_factor, trial.mean(goal.metric) * y_factor) for trial in run.trials]
    if not np.isfinite(points).all(axis=-1).any():
        return None
    cloud = figures.Cloud(
        x_label=_with_unit(measures.label(cost), x_unit),
        y_label=_with_unit(measures.label(goal.metric), y_unit),
        x=[x for x, _ in points],
        y=[y for _, y in points],
        met=[trial.goals_met for trial in run.trials],
        chosen=_chosen(run),
        at_least=None if goal.at_least is None else goal.at_least * y_factor,
    )
    caption = "Parameter sets of reward shaping in simulation, mean over the shaping contexts; dashed: the goal."
    return Picture("shaping.png", caption, plots.trial_cloud(cloud))


def _chosen(run: RunData) -> int | None:
    """Which parameter set the reward model is."""
    if run.reward is None:
        return None
    losses = [trial.loss for trial in run.trials if trial.goals_met == run.reward.goals_met]
    if run.reward.loss not in losses:
        return None
    return [(trial.loss, trial.goals_met) for trial in run.trials].index((run.reward.loss, run.reward.goals_met))


def _with_unit(text: str, unit: str) -> str:
    return f"{text} ({unit})" if unit else text


def reward_picture(run: RunData) -> Picture | None:
    """Weights of the features in the reward; None before reward shaping has ended."""
    if run.reward is None or not run.reward.features:
        return None
    weights = dict(zip(run.reward.features, run.reward.weights, strict=True))
    if run.reward.planner is not None:
        weights = {name.replace("_", " "): one for name, one in run.reward.planner.weights.model_dump().items()}
    png = plots.reward_weights(list(weights), list(weights.values()))
    return Picture("reward.png", "Weight of each feature in the reward.", png)


def _series(metric: str, points: Sequence[tuple[int, float]], goals: Sequence[Goal]) -> figures.Series:
    factor, unit = measures.scaled(metric)
    low = [goal.at_least * factor for goal in goals if goal.metric == metric and goal.at_least is not None]
    high = [goal.at_most * factor for goal in goals if goal.metric == metric and goal.at_most is not None]
    return figures.Series(
        label=_with_unit(measures.label(metric), unit),
        missions=[number for number, _ in points],
        values=[value * factor for _, value in points],
        at_least=max(low, default=None),
        at_most=min(high, default=None),
    )


def _tracks(mission: MissionRun) -> list[figures.Track]:
    return [
        figures.Track(run.agent, [record.row for record in run.records], [record.column for record in run.records])
        for run in mission.agents
        if run.records
    ]


def _most_useful(run: RunData) -> tuple[str, ...]:
    if len(run.models) <= MODEL_LIMIT:
        return run.models
    last = run.weights[max(run.weights)].usefulness if run.weights else {}
    best = sorted(run.models, key=lambda model: -(last.get(model) or 0.0))[:MODEL_LIMIT]
    return tuple(model for model in run.models if model in best)


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def _any(values: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(values).any())
