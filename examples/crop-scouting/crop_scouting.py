"""Crop scouting: map the expected yield of a corn field from a part of its pictures.

The two functions of the FleetSpec beside this file. Copy them and change what differs in your field.
"""

from fleet.functions.classes import class_mean, classes, expected_accuracy, likely_values
from fleet.functions.compose import compose
from fleet.functions.contract import Evaluation, FeatureSpace, Metrics
from fleet.functions.evaluation import error_map, evaluation_metrics, yield_map
from fleet.functions.extractors import blur, brightness, canopy_cover, excess_green, leaf_area_index
from fleet.functions.extrapolation import extrapolate
from fleet.functions.stalks import plant_count

# Map(D) -> SSV: one picture of one cell to six numbers.
map_observation = compose(excess_green, leaf_area_index, canopy_cover, plant_count, brightness, blur)


def evaluate(fs: FeatureSpace, metrics: Metrics) -> Evaluation:
    """Eval(FS, m): the whole field's yield from the captured cells, how good it is, and what it cost."""
    place = fs.environment
    prediction = extrapolate(yield_map(fs, "exg"), place.grid, expected=place.expected)
    mean = class_mean(prediction.values, place)
    predicted = likely_values(prediction, mean)
    return Evaluation(
        finished=metrics.explored,
        metrics={**evaluation_metrics(predicted, fs, metrics), **expected_accuracy(prediction, mean)},
        artefacts={
            "predicted": predicted,
            "class": classes(predicted, mean),
            "error": error_map(predicted, place),
        },
    )
