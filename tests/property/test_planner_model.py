"""What a Planner's model makes of what captures brought, held against the same regression solved in another way."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fleet.errors import ModelError
from fleet.learning.archive import Archive
from fleet.learning.planner import (
    BELIEVED,
    PRIOR_CAPTURES,
    Evidence,
    PlannerModel,
    blended,
    load_planner,
)
from fleet.planning.tactics import InterestWeights

Values = NDArray[np.float64]
NAMES = ("brightness", "exg")
USUAL = InterestWeights()

some = st.just(0.0) | st.floats(0.01, 3)
shaped = st.builds(InterestWeights, doubt=st.floats(0.1, 3), doubt_around=some, novelty=some)


@st.composite
def evidence(draw: st.DrawFn) -> Evidence:
    """Captures with features from 0 to 1 that brought something by a made-up rule, and much noise."""
    generator = np.random.default_rng(draw(st.integers(0, 10_000)))
    features = generator.uniform(0, 1, (draw(st.integers(1, 400)), len(BELIEVED)))
    features[:, draw(st.integers(0, 2))] *= draw(st.sampled_from([0.0, 0.01, 1.0]))
    true = generator.uniform(-1, 3, len(BELIEVED))
    return Evidence(features, features @ true + generator.normal(0, draw(st.floats(0, 2)), len(features)))


def many(true: tuple[float, float, float], count: int = 40_000, noise: float = 0.5) -> Evidence:
    """So many captures that the prior hardly counts."""
    generator = np.random.default_rng(5)
    features = generator.uniform(0, 1, (count, len(BELIEVED)))
    return Evidence(features, features @ np.array(true) + generator.normal(0, noise, count))


def array(weights: InterestWeights) -> Values:
    return np.array([getattr(weights, name) for name in BELIEVED])


def by_least_squares(prior: Values, captures: Evidence) -> Values:
    """The same weights from one system of equations: a row for each capture, and one for each weight's prior."""
    along = captures.features @ prior
    scale = max(0.0, float(np.linalg.lstsq(along[:, None], captures.gains)[0][0]))
    share = np.sqrt(PRIOR_CAPTURES * np.maximum((captures.features**2).mean(axis=0), 1e-12))
    rows = np.concatenate((captures.features, np.diag(share)))
    found = np.linalg.lstsq(rows, np.concatenate((captures.gains, share * scale * prior)))[0]
    return shares(np.maximum(found, 0.0) if found.max() > 0.0 else prior)


def shares(weights: Values) -> Values:
    """The same weights with the sum 1."""
    return np.asarray(weights / weights.sum())


@given(shaped, evidence())
def test_the_weights_are_those_of_a_regression_with_a_row_for_each_weights_prior(
    weights: InterestWeights, captures: Evidence
) -> None:
    found = PlannerModel.blank(NAMES, weights).updated(captures).interest
    assert array(found) == pytest.approx(by_least_squares(array(weights), captures), rel=1e-6, abs=1e-7)


@given(shaped, evidence(), evidence())
def test_learning_from_one_mission_after_the_other_is_learning_from_both_at_once(
    weights: InterestWeights, first: Evidence, second: Evidence
) -> None:
    blank = PlannerModel.blank(NAMES, weights)
    both = Evidence(np.concatenate((first.features, second.features)), np.concatenate((first.gains, second.gains)))
    one_by_one, turned, at_once = (
        blank.updated(first).updated(second),
        blank.updated(second).updated(first),
        blank.updated(both),
    )
    assert one_by_one.captures == turned.captures == at_once.captures == len(first) + len(second)
    for model in (one_by_one, turned):
        assert model.moments == pytest.approx(at_once.moments, rel=1e-12)
        assert model.products == pytest.approx(at_once.products, rel=1e-9, abs=1e-9)
        assert array(model.interest) == pytest.approx(array(at_once.interest), rel=1e-6, abs=1e-9)


@given(shaped, evidence())
def test_no_weight_is_negative_and_some_weight_is_more_than_nothing(
    weights: InterestWeights, captures: Evidence
) -> None:
    found = array(PlannerModel.blank(NAMES, weights).updated(captures).interest)
    assert found.min() >= 0.0
    assert found.sum() == pytest.approx(1.0)


@given(shaped)
def test_who_has_seen_nothing_believes_the_prior(weights: InterestWeights) -> None:
    blank = PlannerModel.blank(NAMES, weights)
    nothing = Evidence(np.zeros((0, len(BELIEVED))), np.zeros(0))
    assert blank.interest == blank.updated(nothing).interest
    assert array(blank.interest) == pytest.approx(shares(array(weights)))


@given(shaped, evidence(), st.floats(0.01, 100))
def test_the_scale_of_the_prior_does_not_matter(weights: InterestWeights, captures: Evidence, scale: float) -> None:
    blank = PlannerModel.blank(NAMES, weights)
    plain, scaled = (model.updated(captures) for model in (blank, replace(blank, prior=scale * blank.prior)))
    assert array(scaled.interest) == pytest.approx(array(plain.interest), rel=1e-6, abs=1e-9)


@given(evidence())
def test_an_update_leaves_the_model_before_it_as_it_was(captures: Evidence) -> None:
    blank = PlannerModel.blank(NAMES, USUAL)
    before = blank.to_bytes()
    assert blank.updated(captures).to_bytes() != before
    assert blank.to_bytes() == before


def test_much_evidence_outweighs_the_prior_and_little_of_it_hardly_counts() -> None:
    true = (0.2, 0.1, 2.0)
    blank = PlannerModel.blank(NAMES, InterestWeights(doubt=1.0, doubt_around=0.5, novelty=0.1))
    assert array(blank.updated(many(true, count=400_000)).interest) == pytest.approx(shares(np.array(true)), abs=0.06)
    few = array(blank.updated(many(true, count=50)).interest)
    assert few[2] / few[0] < 0.2


def test_captures_that_brought_less_than_nothing_leave_the_prior() -> None:
    blank = PlannerModel.blank(NAMES, USUAL)
    assert blank.updated(many((-1.0, -1.0, -1.0))).interest == blank.interest


@given(shaped, evidence())
def test_what_is_saved_comes_back_to_the_byte(weights: InterestWeights, captures: Evidence) -> None:
    model = PlannerModel.blank(NAMES, weights).updated(captures)
    saved = model.to_bytes()
    loaded = load_planner(saved, NAMES)
    assert loaded.to_bytes() == saved == load_planner(saved).to_bytes()
    assert (loaded.features, loaded.captures, loaded.interest) == (NAMES, len(captures), model.interest)


def test_another_kind_of_model_is_named() -> None:
    other = Archive("fleet-q-learning/1", {}, {"weights": np.zeros(2)}).to_bytes()
    with pytest.raises(ModelError) as told:
        load_planner(other)
    assert str(told.value) == (
        "the model has the format 'fleet-q-learning/1', and a Planner flies with 'fleet-planner/1'"
    )


def test_a_model_for_another_ssv_is_refused_with_what_to_do() -> None:
    saved = PlannerModel.blank(NAMES, USUAL).to_bytes()
    with pytest.raises(ModelError) as told:
        load_planner(saved, ("exg",))
    assert str(told.value) == (
        "the model expects the features brightness, exg, but Map() gives exg; "
        "train it anew or choose the Map() that it was trained with"
    )


@given(st.data())
def test_torn_bytes_are_refused_with_what_to_do(data: st.DataObject) -> None:
    saved = PlannerModel.blank(NAMES, USUAL).updated(many((1, 1, 1), count=20)).to_bytes()
    end = data.draw(st.integers(0, len(saved) - 1))
    with pytest.raises(ModelError, match=rf"cannot be read \({end} bytes\).*train or fetch it again"):
        load_planner(saved[:end])


@pytest.mark.parametrize(
    ("name", "found"), [("prior", np.zeros(2)), ("moments", np.zeros((3, 2))), ("products", np.zeros(3, dtype=int))]
)
def test_an_array_of_another_shape_or_type_is_named(name: str, found: NDArray[np.generic]) -> None:
    arrays = {"prior": np.ones(3), "moments": np.zeros((3, 3)), "products": np.zeros(3), name: found}
    damaged = Archive("fleet-planner/1", {"features": list(NAMES), "captures": 0}, arrays).to_bytes()
    with pytest.raises(ModelError, match=f"damaged: {name} is {found.dtype}"):
        load_planner(damaged)


@given(shaped, shaped, st.floats(0, 1))
def test_several_models_are_one_by_how_much_each_is_trusted(
    one: InterestWeights, other: InterestWeights, share: float
) -> None:
    models = {"initial": PlannerModel.blank(NAMES, one), "1-2": PlannerModel.blank(NAMES, other)}
    found = blended(models, {"1-2": 1.0 - share, "initial": share})
    expected = share * shares(array(one)) + (1.0 - share) * shares(array(other))
    assert array(found) == pytest.approx(expected)
    assert blended(models, {"1-2": 1.0, "initial": 0.0, "gone": 0.0}) == models["1-2"].interest


def test_a_trusted_model_that_is_not_there_is_named() -> None:
    models = {"initial": PlannerModel.blank(NAMES, USUAL)}
    with pytest.raises(ModelError, match="weights are given to models that are not there: 1, 2-3"):
        blended(models, {"initial": 0.5, "2-3": 0.25, "1": 0.25})


def test_the_saved_form_is_plain_numpy_and_json() -> None:
    with np.load(io.BytesIO(PlannerModel.blank(NAMES, USUAL).to_bytes())) as file:
        meta = json.loads(file["meta"].tobytes())
        assert meta == {"format": "fleet-planner/1", "features": list(NAMES), "captures": 0}
        assert sorted(file.files) == ["meta", "moments", "prior", "products"]
