"""Outset of the search: the parameters that matter, and the point to begin at.

Each parameter is moved a little and the log simulated. That gives the sensitivities, a
few regularised least-squares steps towards the log, and the shape of the first
generation. CMA-ES then starts near the best linear answer instead of at the nominal
model, with steps that fit the problem.

A limit that acts one cycle earlier or later moves all that follows in its sequence by
some tenths of a millimetre. Along a valley in which two parameters trade places, such
jumps are far larger than the slope, and the RMS has many minima. They touch few
sequences at a time, the slope all of them: the steps therefore weigh each cycle by how
well it agrees with most others, in its error and in its sensitivities, and are judged
by the median (a GM-estimator, Hampel 1986, chapter 6).
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.identify.parameters import Parameter
from dovetail.identify.population import Population
from dovetail.identify.prior import Prior
from dovetail.identify.replay import DIVERGED, rms_of
from dovetail.identify.search import (
    EDGE,
    EXACT,
    FIRST_WIDTH,
    PATIENCE,
    Space,
    space_of,
)
from dovetail.types import Array

STEP = 0.1
"""Change of a parameter that its sensitivity is measured with, as a share of its
range."""
NO_EFFECT = 1e-5
"""RMS movement of the TCP for `STEP` below which a parameter has no effect on the log
[m]: what the finest encoders' noise of 1e-5 rad moves it at 1 m."""
FINE_STEP = 0.01
"""The same after the first round, to both sides: near the answer the log's limits,
which come and go with the state, make long differences wrong."""
ROUNDS = 12
"""Most least-squares steps; one that gains less than `PATIENCE` is the last."""
REWEIGHTS = 10
"""Rounds in which weights, and what is computed with them, determine each other."""
TRUSTS = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03)
"""Noise levels that a step is tried with, as shares of the error; the best is taken."""


@dataclass(frozen=True)
class WarmStart:
    """Start of a search, measured on the log."""

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


def covariance_of(
    sensitivity: Array, error: float, stiffness: Array | float = 0.0
) -> Array:
    r"""Return the covariance of a generation about a point, in shares of each range.

    Directions that move the TCP much get small steps, those that hardly do get the
    whole `FIRST_WIDTH`: a generation changes the trajectories by about the error that
    is there, in every direction.

    .. math:: C = (J^T J / (N e^2) + I / \sigma^2 + diag(s))^{-1}

    Args:
        sensitivity: J, change of the TCP at each cycle over the change of each
            parameter as a share of its range [m], shape (3 N, parameters).
        error: e, RMS of what the sensitivities do not explain [m].
        stiffness: s, what else holds each parameter [1], shape (parameters,).

    Returns:
        Shape (parameters, parameters).
    """
    cycles = len(sensitivity) / 3
    information = sensitivity.T @ sensitivity / (cycles * max(error, EXACT) ** 2)
    prior = np.diag(np.full(sensitivity.shape[1], 1.0 / FIRST_WIDTH**2) + stiffness)
    covariance = np.linalg.inv(information + prior)
    return 0.5 * (covariance + covariance.T)


def measure_warm_start(
    prior: Prior, population: Population, engine: str, *, warm: bool
) -> WarmStart:
    """Measure sensitivities, and with `warm` step towards the log.

    Args:
        prior: What may change, and how far an arm's values usually are from the start.
        population: Simulates the log.
        engine: Physics engine.
        warm: Begin at the least-squares answer; False begins at the parameters'
            start with a round first generation, as the paper's search does.

    Raises:
        ConfigError: The simulation diverges at the start, or nothing has an effect.
    """
    parameters = prior.parameters
    errors = _Errors(prior, population, engine)
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
    before = rms_of(errors.of_models([parameters.nominal(engine)])[0])
    mean, spread = point[active], np.eye(len(active)) * FIRST_WIDTH**2
    if warm:
        point, error, jacobian = _approach(errors, point, error, jacobian, active)
        mean = point[active]
        # So that all directions together move the TCP by the error that is there.
        share = rms_of(error) / len(active) ** 0.5
        spread = covariance_of(jacobian[:, active], share)
    sensitivity = tuple(sizes.tolist())
    return WarmStart(
        before, rms_of(error), sensitivity, tuple(active), mean, spread, errors.count
    )


def describe_sensitivity(p: Parameter, size: float) -> str:
    """Say how much a parameter moves the TCP [m], in words."""
    step = STEP * (p.high - p.low)
    return f"{p.name} moves the TCP by {1e3 * size:.2g} mm RMS per {step:.3g} {p.unit}"


class _Errors:
    """Errors along the log for points in shares, counted."""

    def __init__(self, prior: Prior, population: Population, engine: str) -> None:
        self.prior = prior
        self._parameters = prior.parameters
        self._population = population
        self._engine = engine
        self.space: Space = space_of(self._parameters)
        self.centre = self.space.to_shares(self._parameters.start)
        self.spread = self._parameters.spread / (self.space.high - self.space.low)
        self.count = 0

    def of_models(self, models: list[Any]) -> list[Array | None]:
        self.count += len(models)
        return self._population.errors(models)

    def __call__(self, points: list[Array]) -> list[Array | None]:
        values = [self.space.to_values(p) for p in points]
        models = [self._parameters.to_model(v, self._engine) for v in values]
        return self.of_models(models)

    def value(self, error: Array | None, point: Array) -> float:
        """Return the median error, times the prior's factor at the point [m]."""
        return _median(error) * self.prior.factor(self.space.to_values(point))


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


def _fine_slopes(
    errors: _Errors, point: Array, error: Array, active: list[int]
) -> Array:
    """Return the error's change per share, (3 N, active), from short differences.

    A jump lies on one side of the point, so each cycle takes the side that changes
    less (the minmod limiter of shock-capturing schemes).
    """
    units = FINE_STEP * np.eye(len(point))[active]
    found = errors([point + unit for unit in units] + [point - unit for unit in units])
    changes = np.array([(error if e is None else e) - error for e in found])
    ahead, behind = changes[: len(active)], -changes[len(active) :]
    sizes = [np.linalg.norm(side, axis=2, keepdims=True) for side in (ahead, behind)]
    slopes = np.where(sizes[0] < sizes[1], ahead, behind) / FINE_STEP
    return slopes.reshape(len(active), -1).T


def _approach(
    errors: _Errors, point: Array, error: Array, jacobian: Array, active: list[int]
) -> tuple[Array, Array, Array]:
    """Take regularised least-squares steps while they help.

    Returns:
        The best point, its error and the last sensitivities.
    """
    for number in range(ROUNDS):
        best, noise = errors.value(error, point), rms_of(error)
        spread = errors.spread[active]
        distance = (point - errors.centre)[active]
        variance = max(_median(error), EXACT) ** 2 / errors.prior.facts
        trusted = _usual_rows(jacobian[:, active])
        candidates = []
        for share in TRUSTS:
            level = share * noise
            pull = _Pull(distance, spread, variance / level**2)
            change = _step(error, jacobian[:, active], trusted, level, pull)
            candidates.append(point.copy())
            candidates[-1][active] = np.clip(point[active] + change, EDGE, 1.0 - EDGE)
        found = errors(candidates)
        values = [errors.value(*pair) for pair in zip(found, candidates, strict=True)]
        i = int(np.argmin(values))
        better = found[i]
        if better is None or values[i] >= best:
            break
        point, error = candidates[i], better
        is_last = values[i] > (1.0 - PATIENCE) * best or number == ROUNDS - 1
        if is_last or rms_of(error) < EXACT:
            break
        fine = _fine_slopes(errors, point, error, active)
        # Where a limit holds the arm, a fine change may be none.
        is_moved = np.abs(fine).max(axis=0) > 0.0
        jacobian = jacobian.copy()
        jacobian[:, active] = np.where(is_moved, fine, jacobian[:, active])
    return point, error, jacobian


def _median(error: Array | None) -> float:
    """Return the median distance from the log [m]."""
    if error is None:
        return DIVERGED
    return float(np.median(np.linalg.norm(error, axis=1)))


def _usual_rows(J: Array) -> Array:
    """Return a weight per cycle, small where its sensitivities are unlike the others'.

    A cycle behind a jump has a difference over the jump for a slope. It would hold a
    step back alone: along a valley all others have almost none.
    """
    weights = np.ones(len(J) // 3)
    for _ in range(REWEIGHTS):
        gram = (J * np.repeat(weights, 3)[:, None]).T @ J
        leverage = ((J @ np.linalg.pinv(gram, hermitian=True)) * J).sum(axis=1)
        leverage = np.maximum(leverage.reshape(-1, 3).sum(axis=1), 0.0)
        weights = 1.0 / (1.0 + leverage / np.median(leverage[leverage > 0.0]))
    return weights


class _Pull(NamedTuple):
    """The prior, as a step feels it; in shares of the ranges."""

    distance: Array
    """Of the parameters from the prior's centre, shape (parameters,)."""
    spread: Array
    """Of the prior, shape (parameters,)."""
    weight: float
    """Variance of a fact of the log over that of the noise level [1]."""


def _step(error: Array, J: Array, trusted: Array, noise: float, pull: _Pull) -> Array:
    """Return the least-squares change, in shares, regularised for a noise level [m].

    Cycles that it leaves further from the log than most count less (Cauchy's weights,
    with the median for a scale).
    """
    target, change = error.ravel(), np.zeros(J.shape[1])
    for _ in range(REWEIGHTS):
        left = (target + J @ change).reshape(error.shape)
        scale = max(_median(left), EXACT)
        weights = trusted / (1.0 + (left**2).sum(axis=1) / scale**2)
        roots = np.repeat(np.sqrt(weights / weights.mean()), 3)
        weighted = J * roots[:, None]
        slope = weighted.T @ (target * roots) / (len(error) * max(noise, EXACT) ** 2)
        stiffness = pull.weight / pull.spread**2
        slope += stiffness * pull.distance
        change = -covariance_of(weighted, noise, stiffness) @ slope
    return change
