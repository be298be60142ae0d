"""Flies every plan over every field with every seed, in several processes, and keeps what came of it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from bench.scouting.fields import MADE_UP, Field, field
from bench.scouting.judge import CHECKPOINTS, Curve, How, Values, judged
from bench.scouting.registry import plans

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True, order=True)
class Job:
    """One plan over one field with one seed."""

    plan: str
    field: str
    agents: int
    seed: int


Curves = dict[Job, Curve]


def jobs(names: Sequence[str], fields: Sequence[str], agents: int, seeds: int) -> list[Job]:
    """All that is to be flown."""
    return [Job(plan, place, agents, seed) for place in fields for plan in names for seed in range(seeds)]


def flown(wanted: Sequence[Job], workers: int, told: Callable[[int, Job], None]) -> Curves:
    """Fly and judge; `told` hears of each job that is done, and how many are.

    Returns:
        Curves in the order of the jobs, whatever order they came in.
    """
    found: Curves = {}
    for job, curve in _answers(wanted, workers):
        found[job] = curve
        told(len(found), job)
    return {job: found[job] for job in wanted}


def _answers(wanted: Sequence[Job], workers: int) -> Iterator[tuple[Job, Curve]]:
    if workers == 1:
        yield from ((job, fly(job)) for job in wanted)
        return
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        asked = {pool.submit(fly, job): job for job in wanted}
        for answer in as_completed(asked):
            yield asked[answer], answer.result()


def fly(job: Job) -> Curve:
    """Fly and judge one job."""
    return judged(plans()[job.plan], known(job.field, job.seed if job.field in MADE_UP else 0), job.agents, job.seed)


@cache
def known(name: str, seed: int) -> Field:
    """A field, read or made once in a process."""
    return field(name, seed)


def write(path: Path, curves: Curves, command: str) -> None:
    """Write every curve; NaN becomes null."""
    runs = [
        {
            "plan": job.plan,
            "field": job.field,
            "agents": job.agents,
            "seed": job.seed,
            "ended": curve.ended,
            "time_s": curve.time_s,
            "balance": curve.balance,
            "cells": _plain(curve.cells),
            "accuracy": {how.value: _plain(values) for how, values in curve.accuracy.items()},
        }
        for job, curve in curves.items()
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {"command": command, "energy": CHECKPOINTS.tolist(), "runs": runs}
    path.write_text(json.dumps(document) + "\n", encoding="utf-8")


def read(path: Path) -> Curves:
    """What `write` wrote."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    curves = {}
    for run in document["runs"]:
        accuracy = {How(how): np.array(values, dtype=np.float64) for how, values in run["accuracy"].items()}
        cells = np.array(run["cells"], dtype=np.float64)
        job = Job(run["plan"], run["field"], run["agents"], run["seed"])
        curves[job] = Curve(cells, accuracy, run["ended"], run["time_s"], run["balance"])
    return curves


def _plain(values: Values) -> list[float | None]:
    return [round(float(value), 5) if np.isfinite(value) else None for value in values]
