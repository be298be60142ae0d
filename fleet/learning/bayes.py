"""Bayesian optimisation: where to try next, by a Gaussian process and expected improvement. The one door to skopt.

Source: paper, sections "Reward Shaping and Training" and "Bayesian optimization for system-level hyperparameters";
Ginsbourger, Le Riche, Carraro: Kriging is well-suited to parallelize optimization, 2010 (constant liar).
"""

from __future__ import annotations

import math
import warnings
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from fleet.errors import TrainingError
from fleet.randomness import named_seed

Point = tuple[float, ...]
"""A value for each dimension; whole numbers for integer dimensions."""


@dataclass(frozen=True)
class Dimension:
    """A parameter and its range, both ends included; a range of one value is fixed.

    Args:
        integer: Whether only whole numbers are tried.
    """

    name: str
    low: float
    high: float
    integer: bool = False

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low <= self.high):
            raise TrainingError(f"{self.name}: {self.low}..{self.high} is not a range; write the lower end first")

    @property
    def fixed(self) -> bool:
        """Whether there is nothing to choose."""
        return self.low == self.high

    def holds(self, value: float) -> bool:
        """Whether a value is in the range."""
        return self.low <= value <= self.high


@contextmanager
def _library() -> Iterator[Any]:
    """skopt without its warnings, and on one thread.

    skopt 0.10 uses names that scikit-learn and numpy have deprecated, and warns where it clips a length scale. Its
    matrices are small: more threads only wait for each other, and would make sums depend on the number of cores.
    """
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        import skopt  # noqa: PLC0415 - takes a second to load; only roles that shape or weigh pay for it

        yield skopt


class Optimiser:
    """Looks for the least loss in batches: `ask`, evaluate side by side, `tell`.

    What `ask` gives depends on the dimensions, the seed and the points told so far, and on nothing else. So an
    optimiser that is made anew and told the same history in the same order goes on as the first one would have.

    Args:
        dimensions: The parameters; fixed ones are passed through.
        seed: Of the first points and of the search for the best expected improvement.
        initial: How many points are spread over the space (a Latin hypercube) before the process is asked.
        first: Points to ask for before these; they count among them.
    """

    def __init__(
        self, dimensions: Sequence[Dimension], seed: int, initial: int = 10, first: Sequence[Point] = ()
    ) -> None:
        self.dimensions = tuple(dimensions)
        self.points: list[Point] = []
        self.losses: list[float] = []
        self._seed = seed
        self._first = tuple(first)
        self._initial = max(1, initial, len(self._first))
        self._known = 0

    def tell(self, points: Sequence[Point], losses: Sequence[float]) -> None:
        """Add what was tried and what it gave.

        Raises:
            TrainingError: a point is outside of the dimensions, or a loss is not a finite number.
        """
        for point, loss in zip(points, losses, strict=True):
            if len(point) != len(self.dimensions) or not all(
                dimension.holds(value) for dimension, value in zip(self.dimensions, point, strict=True)
            ):
                raise TrainingError(f"{point} is not a point of {', '.join(d.name for d in self.dimensions)}")
            if not np.isfinite(loss):
                raise TrainingError(f"the loss of {point} is {loss}; a loss must be a finite number")
            self.points.append(tuple(point))
            self.losses.append(float(loss))

    def know(self, points: Sequence[Point], losses: Sequence[float]) -> None:
        """Add what is known from elsewhere, before anything is asked: it does not count among the initial points."""
        self.tell(points, losses)
        self._known += len(points)

    def ask(self, count: int) -> list[Point]:
        """The next points to try, as many as asked for; they may repeat when there are few values to choose from."""
        free = [index for index, dimension in enumerate(self.dimensions) if not dimension.fixed]
        if not free:
            return [tuple(self._value(index, dimension.low) for index, dimension in enumerate(self.dimensions))] * count
        told = len(self.losses) - self._known
        with _library() as skopt:
            space = skopt.Space(self._ranges(skopt, free))
            chosen = self._spread(skopt, space)[told : told + count] if told < self._initial else []
            if len(chosen) < count:
                chosen = chosen + self._improving(skopt, space, chosen, count - len(chosen))
        return [self._whole(free, values) for values in chosen]

    def _spread(self, skopt: Any, space: Any) -> list[list[float]]:
        free = [index for index, dimension in enumerate(self.dimensions) if not dimension.fixed]
        first = [[point[index] for index in free] for point in self._first]
        if len(first) == self._initial:
            return first
        hypercube, seed = skopt.sampler.Lhs(criterion=None), named_seed(self._seed, "spread")
        return first + list(hypercube.generate(space, self._initial - len(first), random_state=seed))

    def _improving(self, skopt: Any, space: Any, pending: list[list[float]], count: int) -> list[list[float]]:
        """Points of the greatest expected improvement; those still open count as the least loss that is known.

        The process is fitted to the ranks of what was told, as normal scores: the losses of missed goals lie far
        above all others, and a smooth process would see nothing but that step. The points of one batch share its
        kernel.
        """
        free = [index for index, dimension in enumerate(self.dimensions) if not dimension.fixed]
        points: list[list[float]] = [[point[index] for index in free] for point in self.points] + pending
        losses = normal_scores(self.losses)
        lie = min(losses, default=0.0)
        losses += [lie] * len(pending)
        if len(points) < 2:
            return list(space.rvs(count, random_state=named_seed(self._seed, "random")))
        process: Any = "GP"
        chosen: list[list[float]] = []
        for number in range(count):
            optimiser = skopt.Optimizer(
                space.dimensions, base_estimator=process, acq_func="EI", acq_optimizer="lbfgs", n_initial_points=1,
                acq_optimizer_kwargs={"n_points": 2000, "n_restarts_optimizer": 3},
                random_state=named_seed(self._seed, f"ask/{len(self.losses)}/{number}"),
            )  # fmt: skip
            optimiser.tell(points + chosen, losses + [lie] * len(chosen))
            chosen.append(list(optimiser.ask()))
            if number == 0:
                process = optimiser.models[-1].set_params(kernel=optimiser.models[-1].kernel_, optimizer=None)
        return chosen

    def _ranges(self, skopt: Any, free: list[int]) -> list[Any]:
        chosen = [self.dimensions[index] for index in free]
        real, integer = skopt.space.Real, skopt.space.Integer
        return [integer(int(d.low), int(d.high)) if d.integer else real(d.low, d.high) for d in chosen]

    def _whole(self, free: list[int], values: Sequence[float]) -> Point:
        """The free values with the fixed ones between them, as plain numbers within their ranges."""
        given = dict(zip(free, values, strict=True))
        return tuple(
            self._value(index, given.get(index, dimension.low)) for index, dimension in enumerate(self.dimensions)
        )

    def _value(self, index: int, value: float) -> float:
        dimension = self.dimensions[index]
        inside = min(max(float(value), dimension.low), dimension.high)
        return round(inside) if dimension.integer else inside


def normal_scores(losses: Sequence[float]) -> list[float]:
    """Quantiles of the normal distribution that lie as the losses do; equal losses have equal scores.

    Source: Salinas, Shen, Perrone: A quantile-based approach for hyperparameter transfer learning, 2020.
    """
    order = sorted(losses)
    count = len(order)
    middle = {loss: (bisect_left(order, loss) + bisect_right(order, loss)) / 2.0 for loss in order}
    return [NormalDist().inv_cdf(middle[loss] / count) for loss in losses]


def expected_improvement(
    points: NDArray[np.float64],
    losses: NDArray[np.float64],
    noise_sd: NDArray[np.float64],
    candidates: NDArray[np.float64],
    seed: int,
) -> NDArray[np.float64]:
    """How far each candidate is expected to fall below the least loss that is believed to be reached.

    Args:
        points: Where the loss was observed, float64 [n, d].
        losses: Observed losses, float64 [n].
        noise_sd: Standard deviation of each observation's noise, in units of the loss, float64 [n].
        candidates: Where to judge, float64 [m, d].
        seed: Of the restarts of the fit.
    Returns:
        Expected improvement, float64 [m], not negative.
    Source: Jones, Schonlau, Welch: Efficient global optimization, 1998; with noise the least posterior mean stands
        for the least loss (Picheny et al., A benchmark of kriging-based infill criteria for noisy optimization, 2013).
    """
    scale = float(np.std(losses)) or 1.0
    middle = float(np.mean(losses))
    with _library() as skopt:
        kernels = skopt.learning.gaussian_process.kernels
        process = skopt.learning.GaussianProcessRegressor(
            kernels.ConstantKernel(1.0, (1e-2, 1e2)) * kernels.Matern(1.0, (5e-2, 1e2), nu=2.5),
            alpha=np.maximum(noise_sd / scale, 1e-4) ** 2, n_restarts_optimizer=1, random_state=seed,
        )  # fmt: skip
        process.fit(points, (losses - middle) / scale)
        mean, deviation = process.predict(candidates, return_std=True)
        least = float(np.min(process.predict(points)))
    deviation = np.maximum(deviation, 1e-12)
    z = (least - mean) / deviation
    below = np.array([0.5 * math.erfc(-value / math.sqrt(2.0)) for value in z.tolist()])
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    return np.asarray(np.maximum((least - mean) * below + deviation * density, 0.0) * scale)
