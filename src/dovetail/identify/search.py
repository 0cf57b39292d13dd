"""CMA-ES (Hansen 2016) over the parameters of a model, one generation at a time.

A search is determined by its settings and the values it was told. A checkpoint is
therefore the list of those values: `tell` them again, in order, and the search stands
where it stood, its random numbers included.
"""

import math
from dataclasses import dataclass

import numpy as np

from dovetail.errors import MissingDependencyError
from dovetail.types import Array

PRIOR_WIDTH = 0.2
"""Standard deviation of the first generation, as a share of each parameter's range."""
EDGE = 0.02
"""The search begins no nearer to a bound than this, as a share of the range."""
PATIENCE = 0.001
"""Improvement of the best error over a window below which it has converged [1]."""
EXACT = 1e-9
"""Error below which there is nothing left to improve [m]."""


def initial_covariance(sensitivity: Array, error: float) -> Array:
    r"""Return the covariance of the first generation, in shares of each range.

    Directions that move the TCP much get small steps, those that hardly do get the
    whole `PRIOR_WIDTH`: with it a generation changes the trajectories by about the
    error that is there, in every direction.

    .. math:: C = (J^T J / (N e^2) + I / \sigma^2)^{-1}

    Args:
        sensitivity: J, change of the TCP at each cycle over the change of each
            parameter as a share of its range [m], shape (3 N, parameters).
        error: e, RMS error where the search begins [m].

    Returns:
        Shape (parameters, parameters).
    """
    cycles = len(sensitivity) / 3
    information = sensitivity.T @ sensitivity / (cycles * max(error, EXACT) ** 2)
    prior = np.eye(sensitivity.shape[1]) / PRIOR_WIDTH**2
    covariance = np.linalg.inv(information + prior)
    return 0.5 * (covariance + covariance.T)


@dataclass(frozen=True)
class Space:
    """The box that is searched; inside, every parameter runs from 0 to 1."""

    low: Array
    high: Array
    start: Array
    """Shape (parameters,) each, in the parameters' units."""

    def to_values(self, shares: Array) -> Array:
        """Return values in units for shares of the ranges."""
        return self.low + (self.high - self.low) * np.asarray(shares)

    def to_shares(self, values: Array) -> Array:
        """Return shares of the ranges for values in units."""
        return (np.asarray(values) - self.low) / (self.high - self.low)


class Search:
    """Asks for vectors, is told their errors, and knows the best."""

    def __init__(
        self, space: Space, covariance: Array, seed: int, population: int | None = None
    ) -> None:
        """Begin at the start of the space.

        Args:
            space: What is searched.
            covariance: Of the first generation, in shares.
            seed: Seed of the search.
            population: Size of a generation; None is 4 + 3 ln n, made even.

        Raises:
            MissingDependencyError: cmaes is not installed.
        """
        try:
            from cmaes import CMA
        except ImportError as error:
            raise MissingDependencyError(
                'a fit needs the package cmaes: pip install "dovetail[identify]"'
            ) from error
        size = len(space.low)
        self.space = space
        self._optimiser = CMA(
            mean=np.clip(space.to_shares(space.start), EDGE, 1.0 - EDGE),
            sigma=1.0,
            cov=covariance,
            bounds=np.tile([0.0, 1.0], (size, 1)),
            seed=seed,
            population_size=population or 2 * math.ceil(2 + 1.5 * math.log(size)),
        )
        self._asked: list[Array] = []
        self.best = math.inf
        """Smallest error so far [m]."""
        self.best_vector = space.start
        """Where it was, in units."""
        self.history: list[float] = []
        """Best error after each generation [m]."""
        self.evaluations = 0

    def ask(self) -> list[Array]:
        """Return the vectors of the next generation, in units."""
        count = self._optimiser.population_size
        self._asked = [self._optimiser.ask() for _ in range(count)]
        return [self.space.to_values(u) for u in self._asked]

    def tell(self, values: list[float]) -> None:
        """Take the errors [m] of the vectors that `ask` returned."""
        self._optimiser.tell(list(zip(self._asked, values, strict=True)))
        self.evaluations += len(values)
        i = int(np.argmin(values))
        if values[i] < self.best:
            self.best = values[i]
            self.best_vector = self.space.to_values(self._asked[i])
        self.history.append(self.best)

    @property
    def mean(self) -> Array:
        """Middle of the distribution, in units: often better than any one vector."""
        return self.space.to_values(np.clip(self._optimiser.mean, 0.0, 1.0))

    def has_converged(self) -> bool:
        """Say whether more generations will change nothing that matters."""
        size, count = len(self.space.low), self._optimiser.population_size
        window = 10 + math.ceil(20 * size / count)
        if self.best < EXACT:
            return True
        if len(self.history) > window:
            before = self.history[-window - 1]
            if before - self.best < PATIENCE * before:
                return True
        return self._optimiser.should_stop()
