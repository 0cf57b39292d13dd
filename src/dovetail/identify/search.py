"""CMA-ES (Hansen 2016) over the parameters of a model, one generation at a time.

A search is determined by its settings and the values it was told. A checkpoint is
therefore the list of those values: `tell` them again, in order, and the search stands
where it stood, its random numbers included.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dovetail.errors import MissingDependencyError, install_command
from dovetail.identify.parameters import ParameterSet
from dovetail.types import Array

FIRST_WIDTH = 0.2
"""Standard deviation of the first generation, as a share of each parameter's range."""
EDGE = 0.02
"""The search begins no nearer to a bound than this, as a share of the range."""
PATIENCE = 0.01
"""Improvement of the best error over a window below which it has converged [1]. Less
fits the noise: on twin medium the error on a held-out log no longer falls by then."""
EXACT = 1e-6
"""Error below which there is nothing left to improve [m]: no log is as fine."""


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


def space_of(parameters: ParameterSet, active: Sequence[int] | None = None) -> Space:
    """Return the box of a parameter set, or of some of its parameters."""
    rows = slice(None) if active is None else list(active)
    return Space(parameters.low[rows], parameters.high[rows], parameters.start[rows])


class Search:
    """CMA-ES search: proposes vectors, takes their errors, and keeps the best."""

    def __init__(
        self, space: Space, mean: Array, covariance: Array, error: float, seed: int
    ) -> None:
        """Begin with a first generation; its size is 4 + 3 ln n, made even.

        Args:
            space: What is searched.
            mean: Middle of the first generation, in shares.
            covariance: Of the first generation, in shares.
            error: Of the middle of the first generation [m]: the best so far.
            seed: Seed of the search.

        Raises:
            MissingDependencyError: cmaes is not installed.
        """
        try:
            from cmaes import CMA
        except ImportError as missing:
            raise MissingDependencyError(
                f"a fit needs the package cmaes: {install_command('identify')}"
            ) from missing
        size = len(space.low)
        self.space = space
        self._optimiser = CMA(
            mean=np.clip(mean, EDGE, 1.0 - EDGE),
            sigma=1.0,
            cov=covariance,
            bounds=np.tile([0.0, 1.0], (size, 1)),
            seed=seed,
            population_size=2 * math.ceil(2 + 1.5 * math.log(size)),
        )
        self._asked: list[Array] = []
        self.best = error
        """Smallest error so far [m]."""
        self.best_vector = space.to_values(mean)
        """Vector with that error, in units."""
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
        window = 5 + math.ceil(2.5 * size / count)
        if self.best < EXACT:
            return True
        if len(self.history) > window:
            before = self.history[-window - 1]
            if before - self.best < PATIENCE * before:
                return True
        return self._optimiser.should_stop()
