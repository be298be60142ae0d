from __future__ import annotations

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from fleet.errors import ModelError
from fleet.learning.model import Fit, SAModel, Transitions
from fleet.learning.models import blank_model, load_model
from fleet.learning.reward import Normaliser
from fleet.missions.layout import MOVES
from fleet.spec.learning import SAKind, SASpec

FEATURES = ("exg", "lai", "blur")
NORMALISER = Normaliser(low=(0.0,) * 3, high=(1.0,) * 3)

needs_deep = pytest.mark.skipif(
    find_spec("stable_baselines3") is None or find_spec("torch") is None,
    reason="DQN and DDPG are not tested: the extra `deep` is not installed; pip install -e '.[deep]'",
)
ignore_torch = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")


def blank(kind: SAKind, seed: int = 3) -> SAModel:
    return blank_model(SASpec(kind=kind), FEATURES, NORMALISER, seed)


def north_when_green(count: int = 2048) -> Transitions:
    """One step episodes: the reward is 1 for North where exg is above a half, for South elsewhere."""
    generator = np.random.default_rng(0)
    ssv, moves = generator.random((count, 3)), generator.integers(0, 4, count)
    right = moves == (ssv[:, 0] <= 0.5)
    return Transitions(ssv, moves, right.astype(np.float64), ssv, np.zeros((count, len(MOVES)), dtype=np.bool_))


@needs_deep
@ignore_torch
@pytest.mark.parametrize(("kind", "epochs"), [(SAKind.DQN, 4), (SAKind.DDPG, 20)])
def test_a_network_learns_which_move_pays(kind: SAKind, epochs: int) -> None:
    data = north_when_green()
    scores = blank(kind).updated(data, Fit(epochs=epochs, seed=1)).scores(data.ssv)
    assert (scores[:, :2].argmax(axis=1) == (data.ssv[:, 0] <= 0.5)).mean() > 0.9


@needs_deep
@ignore_torch
@pytest.mark.parametrize("kind", [SAKind.DQN, SAKind.DDPG])
def test_training_depends_on_its_arguments_alone(kind: SAKind) -> None:
    data = north_when_green(256)
    np.random.seed(5)  # noqa: NPY002 - the library draws from this generator; it must come back
    undisturbed = np.random.random()  # noqa: NPY002 - see above
    np.random.seed(5)  # noqa: NPY002 - see above
    one, again, other = (blank(kind).updated(data, Fit(seed=seed)).to_bytes() for seed in (1, 1, 2))
    assert one == again != other
    assert np.random.random() == undisturbed  # noqa: NPY002 - see above


@needs_deep
@ignore_torch
@pytest.mark.parametrize("kind", [SAKind.DQN, SAKind.DDPG])
def test_a_network_is_saved_and_loaded_whole(kind: SAKind) -> None:
    data = north_when_green(256)
    model = blank(kind).updated(data, Fit())
    loaded = load_model(model.to_bytes(), FEATURES)
    assert loaded.kind is kind
    assert loaded.to_bytes() == model.to_bytes()
    assert loaded.updated(data, Fit(seed=4)).to_bytes() == model.updated(data, Fit(seed=4)).to_bytes()


@needs_deep
@ignore_torch
@pytest.mark.parametrize("kind", [SAKind.DQN, SAKind.DDPG])
def test_a_row_alone_scores_as_it_does_among_many_and_as_torch_scores_it(kind: SAKind) -> None:
    model = blank(kind)
    rows = np.random.default_rng(2).random((65, 3))
    together = model.scores(rows)
    np.testing.assert_array_equal(together, np.vstack([model.scores(rows[i : i + 1]) for i in range(len(rows))]))
    np.testing.assert_allclose(together, _torch_scores(model, rows), atol=1e-5)


@needs_deep
@ignore_torch
def test_scores_of_a_loaded_network_need_no_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    data = blank(SAKind.DQN).to_bytes()
    monkeypatch.setitem(sys.modules, "torch", None)
    assert load_model(data).scores(np.zeros((1, 3))).shape == (1, len(MOVES))


@pytest.mark.parametrize("kind", [SAKind.DQN, SAKind.DDPG])
def test_without_the_extra_the_error_names_it(kind: SAKind, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ModelError, match=rf"{kind} needs the extra `deep`: pip install 'fleet-computer\[deep\]'"):
        blank(kind)


def _torch_scores(model: SAModel, rows: np.ndarray) -> np.ndarray:
    import torch  # noqa: PLC0415 - not there in every installation

    from fleet.learning.network import Network  # noqa: PLC0415 - beside torch

    assert isinstance(model, Network)
    prefix, layers = ("q_net.q_net", (0, 2, 4)) if model.kind is SAKind.DQN else ("actor.mu", (0, 2, 4))
    value = torch.tensor(rows, dtype=torch.float32)
    for number in layers:
        weight, bias = (torch.tensor(model.parameters[f"{prefix}.{number}.{part}"]) for part in ("weight", "bias"))
        value = value @ weight.T + bias
        value = torch.relu(value) if number != layers[-1] else value
    return (torch.tanh(value) if model.kind is SAKind.DDPG else value).numpy()
