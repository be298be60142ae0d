from __future__ import annotations

import hashlib
import io

import numpy as np
import pytest

from fleet.errors import ModelError
from fleet.learning.archive import Archive, read_archive
from fleet.learning.model import Fit, SAModel, Transitions
from fleet.learning.models import blank_model, load_model, register
from fleet.learning.qlearning import QLearning
from fleet.learning.reward import Normaliser
from fleet.missions.layout import MOVES
from fleet.spec.learning import SASpec

FEATURES = ("exg", "lai")


def trained() -> SAModel:
    generator = np.random.default_rng(4)
    steps = Transitions(
        generator.random((50, 2)), generator.integers(0, 4, 50), generator.random(50), generator.random((50, 2)),
        generator.random((50, len(MOVES))) < 0.5,
    )  # fmt: skip
    blank = blank_model(SASpec(), FEATURES, Normaliser(low=(0.0, 0.1), high=(1.0, 0.9)), seed=3)
    return blank.updated(steps, Fit(epochs=2, seed=1))


def test_a_model_that_was_saved_and_loaded_is_the_same() -> None:
    model = trained()
    loaded = load_model(model.to_bytes(), FEATURES)
    ssv = np.random.default_rng(0).random((20, 2))
    np.testing.assert_array_equal(loaded.scores(ssv), model.scores(ssv))
    assert loaded.to_bytes() == model.to_bytes()
    assert (loaded.kind, loaded.features) == (model.kind, FEATURES)


def test_equal_models_have_equal_bytes() -> None:
    assert trained().to_bytes() == trained().to_bytes()


def test_the_saved_form_does_not_change_by_accident() -> None:
    blank = Archive("test/1", {"b": 1, "a": [0.1]}, {"w": np.arange(6, dtype=np.float64).reshape(2, 3)})
    digest = hashlib.sha256(blank.to_bytes()).hexdigest()
    assert digest == "486752fd79146b51e8ecc6b69a8a96fa3fd715700a742309a1bdd6627a5be795"


def test_numpy_reads_a_saved_model() -> None:
    with np.load(io.BytesIO(trained().to_bytes())) as file:
        assert sorted(file.files) == ["centres", "meta", "weights"]


@pytest.mark.parametrize("part", [0, 1, 100, 0.3, 0.7, 0.99])
def test_a_file_that_was_cut_off_says_so(part: float) -> None:
    data = trained().to_bytes()
    length = int(part if part >= 1 else part * len(data))
    with pytest.raises(ModelError, match=r"cut off or no model"):
        load_model(data[:length])


def test_a_file_with_a_flipped_bit_is_refused_or_is_still_a_model() -> None:
    data = trained().to_bytes()
    for position in range(0, len(data), 37):
        broken = bytearray(data)
        broken[position] ^= 0x10
        try:
            load_model(bytes(broken))
        except ModelError:
            continue


def test_something_else_than_a_model_is_refused() -> None:
    with pytest.raises(ModelError, match="cannot be read"):
        load_model(b"PK\x03\x04 not a model")
    plain = io.BytesIO()
    np.savez(plain, a=np.zeros(2))
    with pytest.raises(ModelError, match="cannot be read"):
        load_model(plain.getvalue())


def test_a_model_for_another_ssv_is_refused_by_name() -> None:
    with pytest.raises(ModelError, match=r"expects the features exg, lai, but Map.. gives exg, blur"):
        load_model(trained().to_bytes(), ("exg", "blur"))


def test_an_unknown_format_names_the_known_ones() -> None:
    with pytest.raises(
        ModelError, match="unknown model format 'other/1'; known are fleet-network/1, fleet-q-learning/1"
    ):
        load_model(Archive("other/1", {}, {}).to_bytes())


def test_a_damaged_model_names_what_is_wrong() -> None:
    archive = read_archive(trained().to_bytes())
    without = Archive(archive.format, archive.meta, {"centres": archive.arrays["centres"]})
    with pytest.raises(ModelError, match="weights is missing"):
        load_model(without.to_bytes())
    with pytest.raises(ModelError, match="in its description"):
        load_model(Archive(archive.format, {}, archive.arrays).to_bytes())


def test_a_model_from_outside_joins_by_its_format() -> None:
    register("outside/1", _outside)
    register("outside/1", _outside)
    assert load_model(Archive("outside/1", {}, {}).to_bytes()).to_bytes() == trained().to_bytes()
    with pytest.raises(ModelError, match="taken"):
        register("outside/1", lambda _: trained())


def _outside(_: Archive) -> SAModel:
    model = trained()
    assert isinstance(model, QLearning)
    return model
