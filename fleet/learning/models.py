"""Makes and loads SA models of every kind; models from outside register here."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fleet.errors import ModelError
from fleet.learning.archive import Archive, read_archive
from fleet.learning.model import SAModel
from fleet.learning.network import FORMAT as NETWORK
from fleet.learning.network import blank_network, read_network
from fleet.learning.qlearning import FORMAT as Q_LEARNING
from fleet.learning.qlearning import QLearning, read_qlearning
from fleet.learning.reward import Normaliser
from fleet.spec.learning import SAKind, SASpec

Reader = Callable[[Archive], SAModel]
"""Makes a model of an archive; raises ModelError when it is damaged."""

_READERS: dict[str, Reader] = {Q_LEARNING: read_qlearning, NETWORK: read_network}


def register(tag: str, reader: Reader) -> None:
    """Let `load_model` read archives of a format.

    Args:
        tag: Format tag of the archives: `my-model/1`.
        reader: Makes the model.
    Raises:
        ModelError: the tag is taken by another reader.
    """
    if _READERS.get(tag, reader) is not reader:
        raise ModelError(f"the model format {tag!r} is taken; choose another tag")
    _READERS[tag] = reader


def blank_model(sa: SASpec, features: Sequence[str], normaliser: Normaliser, seed: int) -> SAModel:
    """A model that has learned nothing.

    Args:
        sa: Kind, learning rate and discount.
        features: Names of the SSV's features, in order.
        normaliser: Maps the SSV to [0, 1].
        seed: Fixes what is random in a blank model.
    Raises:
        ModelError: the kind needs the extra `deep`, which is not installed.
    """
    match sa.kind:
        case SAKind.Q_LEARNING:
            return QLearning.blank(sa, tuple(features), normaliser, seed)
        case SAKind.DQN | SAKind.DDPG:
            return blank_network(sa, tuple(features), normaliser, seed)
        case SAKind.PLANNER:
            raise ModelError("a Planner learns what captures bring, not scores of moves: see fleet.learning.planner")


def load_model(data: bytes, features: Sequence[str] | None = None) -> SAModel:
    """A saved model.

    Args:
        data: What `to_bytes` gave.
        features: Names of the features that the model must expect; None takes any.
    Raises:
        ModelError: the format is not known, the bytes are not whole, or the model is for another SSV.
    """
    archive = read_archive(data)
    reader = _READERS.get(archive.format)
    if reader is None:
        raise ModelError(
            f"unknown model format {archive.format!r}; known are {', '.join(sorted(_READERS))} "
            "(a model from outside must be registered first)"
        )
    model = reader(archive)
    if features is not None and model.features != tuple(features):
        raise ModelError(
            f"the model expects the features {', '.join(model.features)}, but Map() gives {', '.join(features)}; "
            "train it anew or choose the Map() that it was trained with"
        )
    return model
