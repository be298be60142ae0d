"""Crop scouting: map the expected yield of a corn field from a part of its pictures.

The two functions of the FleetSpec beside this file. Copy them and change what differs in your field.
"""

from fleet.functions.compose import compose
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.functions.evaluation import class_mean, classes, error_map, evaluation_metrics, yield_map
from fleet.functions.extractors import blur, brightness, canopy_cover, excess_green, leaf_area_index
from fleet.functions.extrapolation import extrapolate
from fleet.functions.stalks import plant_count

# Map(D) -> SSV: one picture of one cell to six numbers.
map_observation = compose(excess_green, leaf_area_index, canopy_cover, plant_count, brightness, blur)


def evaluate(fs: FeatureSpace, metrics: Metrics) -> Evaluation:
    """Eval(FS, m): the whole field's yield from the captured cells, and how good and how dear the mission was."""
    captured = yield_map(fs, "exg")
    predicted = extrapolate(captured, fs.environment.grid)
    return Evaluation(
        finished=metrics.explored,
        metrics=evaluation_metrics(predicted, fs, metrics),
        artefacts={
            "predicted": predicted,
            "class": classes(predicted, class_mean(predicted, fs.environment)),
            "error": error_map(predicted, fs.environment),
        },
    )
