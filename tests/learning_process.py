"""Shapes and trains on the small field, as a program that a test can kill: FOLDER WORKERS DELAY_S."""

from __future__ import annotations

import sys
from pathlib import Path

from fleet.learning.run import Run
from fleet.learning.shaping import shape
from fleet.learning.training import train
from fleet.storage.local import LocalStorage
from tests.learning_field import field_fleet, field_grounds


def main(folder: str, workers: str, delay_s: str) -> None:
    """Leave reward.json and model.npz in the folder."""
    storage = LocalStorage(Path(folder))
    fleet = field_fleet(
        rewardShaping={"epochs": 12, "batch": 4, "missions": 8, "periods": 2},
        training={"epochs": 3, "missions": 16, "periods": 2},
    )
    grounds = field_grounds(fleet, contexts=2, delay_s=float(delay_s))
    run = Run(storage, "shaping", seed=5, workers=int(workers))
    reward = shape(fleet, grounds, run)
    storage.write("reward.json", reward.model_dump_json(indent=1).encode())
    model = train(fleet, grounds, reward, Run(storage, "training", seed=5, workers=int(workers)))
    storage.write("model.npz", model.to_bytes())


if __name__ == "__main__":
    main(*sys.argv[1:])
