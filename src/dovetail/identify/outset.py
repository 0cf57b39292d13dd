"""What is known before the search: which parameters matter, and where to begin.

Each parameter is moved a little and the log simulated. That gives the sensitivities, a
few regularised least-squares steps towards the log, and the shape of the first
generation. CMA-ES then starts near the best linear answer instead of at the nominal
model, with steps that fit the problem.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.identify.parameters import Parameter, ParameterSet, nominal_model
from dovetail.identify.population import Population
from dovetail.identify.replay import DIVERGED, rms_of
from dovetail.identify.search import EDGE, EXACT, PRIOR_WIDTH, Space, space_of
from dovetail.types import Array

STEP = 0.1
"""Change of a parameter that its sensitivity is measured with, as a share of its
range."""
NO_EFFECT = 1e-5
"""RMS movement of the TCP for `STEP` below which a parameter has no effect on the log
[m]: what the finest encoders' noise of 1e-5 rad moves it at 1 m."""
FINE_STEP = 0.01
"""The same after the first round: near the answer the log's limits, which come and go
with the state, make long differences wrong."""
ROUNDS = 12
"""Most least-squares steps."""
GAIN = 0.97
"""A step that leaves more of the error than this is the last one [1]."""
TRUSTS = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03)
"""Noise levels that a step is tried with, as shares of the error; the best is taken."""


@dataclass(frozen=True)
class Outset:
    """Where a search begins."""

    before: float
    """Error of the nominal model [m]."""
    start: float
    """Error of the middle of the first generation [m]."""
    sensitivity: tuple[float, ...]
    """RMS movement of the TCP for `STEP` of each parameter's range [m]."""
    active: tuple[int, ...]
    """Indices of the parameters that have an effect."""
    mean: Array
    """Middle of the first generation, active parameters, in shares of the ranges."""
    covariance: Array
    """Of the first generation, in shares of the ranges."""
    evaluations: int
    """Simulated logs that this took."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "rms_before": self.before,
            "rms_start": self.start,
            "sensitivity": list(self.sensitivity),
            "active": list(self.active),
            "mean": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "evaluations": self.evaluations,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Read what `to_dict` wrote."""
        return cls(
            data["rms_before"],
            data["rms_start"],
            tuple(data["sensitivity"]),
            tuple(data["active"]),
            np.array(data["mean"]),
            np.array(data["covariance"]),
            data["evaluations"],
        )


def covariance_of(sensitivity: Array, error: float) -> Array:
    r"""Return the covariance of a generation about a point, in shares of each range.

    Directions that move the TCP much get small steps, those that hardly do get the
    whole `PRIOR_WIDTH`: a generation changes the trajectories by about the error that
    is there, in every direction.

    .. math:: C = (J^T J / (N e^2) + I / \sigma^2)^{-1}

    Args:
        sensitivity: J, change of the TCP at each cycle over the change of each
            parameter as a share of its range [m], shape (3 N, parameters).
        error: e, RMS of what the sensitivities do not explain [m].

    Returns:
        Shape (parameters, parameters).
    """
    cycles = len(sensitivity) / 3
    information = sensitivity.T @ sensitivity / (cycles * max(error, EXACT) ** 2)
    prior = np.eye(sensitivity.shape[1]) / PRIOR_WIDTH**2
    covariance = np.linalg.inv(information + prior)
    return 0.5 * (covariance + covariance.T)


def measure_outset(
    parameters: ParameterSet, population: Population, engine: str, *, warm: bool
) -> Outset:
    """Measure sensitivities, and with `warm` step towards the log.

    Args:
        parameters: What may change.
        population: Simulates the log.
        engine: Physics engine.
        warm: Begin at the least-squares answer; False begins at the parameters'
            start with a round first generation, as the paper's search does.

    Raises:
        ConfigError: The simulation diverges at the start, or nothing has an effect.
    """
    errors = _Errors(parameters, population, engine)
    point = errors.space.to_shares(parameters.start)
    error, jacobian = _linearise(errors, point, STEP)
    sizes = STEP * np.sqrt((jacobian**2).sum(axis=0) / (len(jacobian) / 3))
    active = [i for i, size in enumerate(sizes) if size >= NO_EFFECT]
    if not active:
        pairs = zip(parameters.parameters, sizes.tolist(), strict=True)
        raise ConfigError(
            "no parameter has an effect on this log: "
            + "; ".join(describe_sensitivity(p, size) for p, size in pairs)
        )
    before = rms_of(errors.of_models([nominal_model(engine)])[0])
    mean, spread = point[active], np.eye(len(active)) * PRIOR_WIDTH**2
    if warm:
        point, error, jacobian = _approach(errors, point, error, jacobian, active)
        mean = point[active]
        # So that all directions together move the TCP by the error that is there.
        share = rms_of(error) / len(active) ** 0.5
        spread = covariance_of(jacobian[:, active], share)
    sensitivity = tuple(sizes.tolist())
    return Outset(
        before, rms_of(error), sensitivity, tuple(active), mean, spread, errors.count
    )


def describe_sensitivity(p: Parameter, size: float) -> str:
    """Say how much a parameter moves the TCP [m], in words."""
    step = STEP * (p.high - p.low)
    return f"{p.name} moves the TCP by {1e3 * size:.2g} mm RMS per {step:.3g} {p.unit}"


class _Errors:
    """Errors along the log for points in shares, counted."""

    def __init__(
        self, parameters: ParameterSet, population: Population, engine: str
    ) -> None:
        self._parameters = parameters
        self._population = population
        self._engine = engine
        self.space: Space = space_of(parameters)
        self.count = 0

    def of_models(self, models: list[Any]) -> list[Array | None]:
        self.count += len(models)
        return self._population.errors(models)

    def __call__(self, points: list[Array]) -> list[Array | None]:
        values = [self.space.to_values(p) for p in points]
        models = [self._parameters.to_model(v, self._engine) for v in values]
        return self.of_models(models)


def _linearise(errors: _Errors, point: Array, step: float) -> tuple[Array, Array]:
    """Return the error at a point, (N, 3), and its change per share, (3 N, size)."""
    steps = np.where(point + step <= 1.0, step, -step)
    units = np.eye(len(point))
    points = [point + change * unit for change, unit in zip(steps, units, strict=True)]
    here, *moved = errors([point, *points])
    if here is None:
        raise ConfigError(
            "the simulation diverges where the search would start; give another start "
            "(NAME=LOW:HIGH:START)"
        )
    # A neighbour that diverges tells nothing: its direction keeps the prior's width.
    changes = [(here if m is None else m) - here for m in moved]
    return here, np.column_stack([c.ravel() for c in changes]) / steps


def _approach(
    errors: _Errors, point: Array, error: Array, jacobian: Array, active: list[int]
) -> tuple[Array, Array, Array]:
    """Take regularised least-squares steps while they help.

    Returns:
        The best point, its error and the last sensitivities.
    """
    for number in range(ROUNDS):
        best = rms_of(error)
        candidates = [
            _step(point, error, jacobian, active, share * best) for share in TRUSTS
        ]
        found = errors(candidates)
        values = [DIVERGED if e is None else rms_of(e) for e in found]
        i = int(np.argmin(values))
        better = found[i]
        if better is None or values[i] >= best:
            break
        point, error = candidates[i], better
        if values[i] > GAIN * best or number == ROUNDS - 1 or values[i] < EXACT:
            break
        error, fine = _linearise(errors, point, FINE_STEP)
        # A delay moves in whole physics steps: a fine change of it is none.
        is_moved = np.abs(fine).max(axis=0) > 0.0
        jacobian = np.where(is_moved, fine, jacobian)
    return point, error, jacobian


def _step(
    point: Array, error: Array, jacobian: Array, active: list[int], noise: float
) -> Array:
    """Return the least-squares point, regularised for a noise level [m]."""
    J = jacobian[:, active]
    covariance = covariance_of(J, noise)
    gradient = J.T @ error.ravel() / (len(error) * max(noise, EXACT) ** 2)
    moved = point.copy()
    moved[active] = np.clip(point[active] - covariance @ gradient, EDGE, 1.0 - EDGE)
    return moved
