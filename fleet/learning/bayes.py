"""Bayesian optimisation: where to try next, by a Gaussian process and expected improvement. The one door to skopt.

Source: paper, sections "Reward Shaping and Training" and "Bayesian optimization for system-level hyperparameters";
Ginsbourger, Le Riche, Carraro: Kriging is well-suited to parallelize optimization, 2010 (constant liar).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import ndtr
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from fleet.errors import TrainingError
from fleet.randomness import named_seed

Point = tuple[float, ...]
"""A value for each dimension; whole numbers for integer dimensions."""
SAMPLES = 1024
"""Candidates all over the space."""
BEST, NEAR = 4, 192
"""Candidates near each of the best points."""
LENGTHS = (0.1, 2.0)
"""Length scales in the unit cube; longer ones would take a parameter for idle, and its first value for good."""
FIT_STEPS = 30
"""Of a kernel's fit, at most."""


@dataclass(frozen=True)
class Dimension:
    """A parameter and its range, both ends included; a range of one value is fixed.

    Args:
        integer: Whether only whole numbers are tried.
        logarithmic: Whether ratios count and not differences; the lower end is above 0 then.
    """

    name: str
    low: float
    high: float
    integer: bool = False
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low <= self.high):
            raise TrainingError(f"{self.name}: {self.low}..{self.high} is not a range; write the lower end first")
        if self.logarithmic and self.low <= 0.0:
            raise TrainingError(f"{self.name}: {self.low}..{self.high} cannot be logarithmic; start above 0")

    @property
    def fixed(self) -> bool:
        """Whether there is nothing to choose."""
        return self.low == self.high

    def holds(self, value: float) -> bool:
        """Whether a value is in the range."""
        return self.low <= value <= self.high

    def value_at(self, place: float) -> float:
        """The value at a share of the range, in [0, 1]; a plain number."""
        if self.integer:
            return int(min(math.floor(self.low + place * (self.high - self.low + 1)), self.high))
        if self.logarithmic:
            value = float(self.low * (self.high / self.low) ** place)
            return min(max(value, self.low), self.high)
        return min(max(self.low + place * (self.high - self.low), self.low), self.high)

    def place_of(self, value: float) -> float:
        """At which share of the range a value is; whole numbers lie in the middles of equal parts."""
        if self.integer:
            return (value - self.low + 0.5) / (self.high - self.low + 1)
        if self.logarithmic:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


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
            return [self.point_at(np.empty(0))] * count
        told = len(self.losses) - self._known
        chosen = self._spread(len(free))[told : told + count] if told < self._initial else []
        if len(chosen) < count:
            chosen = chosen + self._improving(free, chosen, count - len(chosen))
        return chosen

    def _spread(self, free: int) -> list[Point]:
        """The first points: given ones, then a Latin hypercube."""
        spread = self._initial - len(self._first)
        hypercube = qmc.LatinHypercube(free, rng=np.random.default_rng(named_seed(self._seed, "spread")))
        return [*self._first, *(self.point_at(place) for place in hypercube.random(spread))]

    def _improving(self, free: list[int], pending: list[Point], count: int) -> list[Point]:
        """Points of the greatest expected improvement; those still open count as the least loss that is known.

        The kernel is fitted once a batch.
        """
        generator = np.random.default_rng(named_seed(self._seed, f"ask/{len(self.losses)}"))
        if len(self.points) < 2:
            return [self.point_at(place) for place in generator.random((count, len(free)))]
        losses = np.array(self.losses)
        told = np.array([self._place(free, point) for point in self.points])
        best = told[np.argsort(losses, kind="stable")[:BEST]]
        places = self._whole(free, candidates(best, generator))
        seen = np.concatenate([told, np.array([self._place(free, point) for point in pending]).reshape(-1, len(free))])
        return [self.point_at(places[index]) for index in batch_of_improvements(seen, losses, places, count)]

    def _whole(self, free: list[int], places: NDArray[np.float64]) -> NDArray[np.float64]:
        """The places of the points nearest to some places: whole numbers have one place each."""
        for column, dimension in enumerate(self.dimensions[index] for index in free):
            if dimension.integer:
                parts = dimension.high - dimension.low + 1
                places[:, column] = (np.minimum(np.floor(places[:, column] * parts), parts - 1) + 0.5) / parts
        return places

    def point_at(self, place: NDArray[np.float64]) -> Point:
        """The point at a place in the unit cube of the free dimensions, with the fixed values between them."""
        shares = iter(place.tolist())
        return tuple(d.low if d.fixed else d.value_at(next(shares)) for d in self.dimensions)

    def _place(self, free: list[int], point: Point) -> list[float]:
        return [self.dimensions[index].place_of(point[index]) for index in free]


def candidates(best: NDArray[np.float64], generator: np.random.Generator) -> NDArray[np.float64]:
    """Where to look for improvement: everywhere, and near the best points, by some or all of their values.

    Args:
        best: Places in the unit cube, float64 [n, d].
    Returns:
        Places in the unit cube, float64 [SAMPLES + n * NEAR, d].
    """
    near = np.repeat(best, NEAR, axis=0)
    changed = generator.random(near.shape) < generator.choice([0.2, 0.5, 1.0], size=(len(near), 1))
    changed[np.arange(len(near)), generator.integers(0, near.shape[1], len(near))] = True
    steps = generator.choice([0.05, 0.2], size=(len(near), 1)) * generator.normal(size=near.shape)
    return np.concatenate([generator.random((SAMPLES, best.shape[1])), np.clip(near + changed * steps, 0.0, 1.0)])


def batch_of_improvements(
    seen: NDArray[np.float64], losses: NDArray[np.float64], places: NDArray[np.float64], count: int
) -> list[int]:
    """The candidates of the greatest expected improvement, each chosen as if those before had given the least loss.

    Args:
        seen: Places in the unit cube that were told, and after them those still open, float64 [n + open, d].
        losses: Of those that were told, float64 [n].
        places: Candidates, float64 [m, d].
    Returns:
        Indices of candidates, `count` of them.
    """
    losses = (losses - losses.mean()) / (float(losses.std()) or 1.0)
    lie = float(losses.min())
    chosen: list[int] = []
    with _library() as skopt:
        kernels = skopt.learning.gaussian_process.kernels
        kernel = kernels.ConstantKernel(1.0, (0.05, 20.0)) * kernels.Matern(np.full(seen.shape[1], 0.5), LENGTHS)
        process = skopt.learning.GaussianProcessRegressor(
            kernel, alpha=1e-6, noise="gaussian", n_restarts_optimizer=0, optimizer=_climb
        )
        process.fit(seen[: len(losses)], losses)
        process.set_params(kernel=_with_noise(process, kernels), optimizer=None)
        for _ in range(count):
            points = np.concatenate([seen, places[chosen]])
            process.fit(points, np.concatenate([losses, np.full(len(points) - len(losses), lie)]))
            mean, deviation = process.predict(places, return_std=True)
            chosen.append(int(np.argmax(_improvement(lie, mean, deviation))))
    return chosen


def _with_noise(process: Any, kernels: Any) -> Any:
    """The kernel of a fitted process as it was fitted: skopt takes the noise out of it, to predict without noise."""
    return process.kernel_.k1 + kernels.WhiteKernel(process.noise_)


def _climb(
    objective: Callable[..., tuple[float, NDArray[np.float64]]], start: NDArray[np.float64], bounds: Any
) -> tuple[NDArray[np.float64], float]:
    """Fits a kernel in a few steps: the last digits of its length scales change nothing of what is asked next."""
    found = minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": FIT_STEPS})
    return found.x, float(found.fun)


def _improvement(least: float, mean: NDArray[np.float64], deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expected improvement on a loss of normal distributions; not negative but for rounding."""
    deviation = np.maximum(deviation, 1e-12)
    z = (least - mean) / deviation
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    return np.asarray((least - mean) * ndtr(z) + deviation * density)


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
    return np.asarray(np.maximum(_improvement(least, mean, deviation), 0.0) * scale)
