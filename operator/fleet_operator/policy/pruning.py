"""Which models are no longer retrained, because the agents have found no use for them.

Source: paper, section "Bayesian optimization for system-level hyperparameters": usefulness can prune SA_s online.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fleet.spec.platform import Pruning


def pruned(history: Sequence[Mapping[str, float | None]], pruning: Pruning) -> frozenset[str]:
    """Models whose usefulness was under the threshold for so many missions in a row; pruned once, pruned for good.

    Args:
        history: Usefulness of each model after each mission, in the order of missions; None, or no entry, when the
            model had not flown, which neither counts nor breaks the row.
    Returns:
        Keys of the pruned models; empty when the threshold is 0.
    """
    gone: set[str] = set()
    below: dict[str, int] = {}
    for usefulness in history:
        for model, value in usefulness.items():
            if value is not None:
                below[model] = below.get(model, 0) + 1 if value < pruning.below else 0
            if below.get(model, 0) >= pruning.after:
                gone.add(model)
    return frozenset(gone)
