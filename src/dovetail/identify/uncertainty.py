r"""Identifiability of each parameter by a log: interval, sensitivity, confounding.

The residual r of a fit is model error, not white noise: its samples within a sequence
hang together, and the textbook covariance s^2 (J^T J)^-1, which counts each of them as
a new fact, is far too sure of itself. Here a whole sequence is one fact: the covariance
is the jackknife over sequences of the linearised fit,

.. math::
    V = \frac{G-1}{G} \sum_g d_g d_g^T, \qquad
    d_g = \hat\theta_{(g)} - \hat\theta, \qquad
    \hat\theta_{(g)} = \theta - (J^T J - J_g^T J_g)^{-1} (J^T r - J_g^T r_g)

with Student's t on G - 1 degrees. It is the cluster-robust estimator CR3, which keeps
its coverage with as few as ten clusters, where the plain sandwich is too narrow
(MacKinnon 2023).

What the model lacks, no sequence shows alone: dry friction that was not fitted, a
centre of mass elsewhere. Such effects are unknowns beside the fitted values, with the
spread that they have before any log (`unmodelled.py`), and fitted values have theirs.
All are jointly Gaussian, and the log says part of them. What it leaves open, the
expected square of the distance from the arm's own value, is added to the jackknife's.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.identify.linearise import Linearisation, Progress, linearise
from dovetail.identify.parameters import KNOWN, Parameter, ParameterSet
from dovetail.identify.prior import FACTS_PER_SEQUENCE
from dovetail.identify.replay import LogReplay
from dovetail.identify.search import EXACT
from dovetail.identify.student import student_t
from dovetail.identify.unmodelled import unmodelled_motion
from dovetail.types import Array

INFLATION = 225.0
"""Variance inflation from which parameters count as moving the tool alike: a pair with
condition index 30 has a correlation of 899/901 and this inflation. The condition index
of 30 is the usual limit (Belsley 1980)."""
KNOWN_SHARE = 0.1
"""Widest half of a 95 % interval of a value that is known, as a share of the range that
the parameter usually has. Before any log, with all of the range alike, it is 0.475."""
DEAD = 1e-6
"""RMS motion of the tool [m] over a parameter's whole range below which it has no
effect: what an encoder's 1e-5 rad moves at a reach of 0.1 m."""
_SINGULAR = 1e-4  # singular values below this part of the largest are zero
_LOADING = 0.03  # share of a parameter in a lost direction that makes it unknown

Verdict = Literal["known", "confounded", "undetermined", "no effect"]


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """Standard error and interval of a fitted value."""

    standard_error: float
    """Of the value, in its unit; infinite where the log says nothing."""
    interval: tuple[float, float]
    """95 % interval, in its unit; the bounds of the fit are not applied."""


@dataclass(frozen=True, kw_only=True)
class Confounding:
    """Overlap of a parameter's effect on the tool with that of other parameters."""

    variance_inflation: float
    """Factor on the variance because the others are not known either [1], >= 1."""
    partner: str
    """The parameter that moves the tool most like this one; empty without another."""
    correlation: float
    """Cosine between the two motions over the log [1]; negative: opposite."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """Judgement on a parameter: known, or why it is not."""

    verdict: Verdict
    sentence: str
    """The verdict in words."""


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """One parameter as the log determines it."""

    name: str
    unit: str
    value: float
    """Fitted value, in its unit."""
    uncertainty: Uncertainty
    """Uncertainty of that value."""
    sensitivity: float
    """RMS motion of the tool over the log per unit of the parameter [m]."""
    confounding: Confounding
    """Overlap with the other parameters."""
    step_left: float
    """Change that one more Gauss-Newton step would make, in its unit."""
    judgement: Judgement
    """Judgement on the parameter."""

    def numbers(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "name": self.name,
            "unit": self.unit,
            "value": self.value,
            **vars(self.uncertainty),
            "sensitivity": self.sensitivity,
            **vars(self.confounding),
            "step_left": self.step_left,
            **vars(self.judgement),
        }


@dataclass(frozen=True, kw_only=True)
class Identifiability:
    """Identifiability of a set of parameters by a log."""

    estimates: tuple[ParameterEstimate, ...]
    condition_number: float
    """Of the Jacobian with columns of unit length [1]; infinite without full rank."""
    sequences: int
    """Number of clusters G."""
    quantile: float
    """Of Student's t on G - 1 degrees, two-sided 95 %."""
    residual_rms: float
    """Of the position error, length of the vector [m]."""


def analyse(
    replay: LogReplay,
    parameters: ParameterSet,
    vector: Array,
    progress: Progress = tuple,
) -> Identifiability:
    """Say how well the replay's log determines each parameter of a fit.

    Costs two replays per parameter, one per effect that was not fitted (28 for the
    extended set, 57 for the paper's), and two more.

    Args:
        replay: The log, and the engine that plays it.
        parameters: What was fitted.
        vector: The fitted values, in the order of `parameters`.
        progress: Wraps the parameters on their way through the loop, for a bar.

    Raises:
        ConfigError: Fewer than two sequences, or a vector of another length.
    """
    lines = linearise(replay, parameters, vector, progress)
    effects = unmodelled_motion(replay, parameters, lines.vector)
    return judge(replace(lines, unmodelled=effects), parameters.parameters)


def judge(lines: Linearisation, parameters: Sequence[Parameter]) -> Identifiability:
    """Turn the linearised fit into intervals and sentences.

    Args:
        lines: Residual and Jacobian of each sequence, at the fitted values.
        parameters: Names, units and ranges, in the Jacobian's order.

    Raises:
        ConfigError: Fewer than two sequences: a jackknife needs something to leave out.
    """
    count = len(lines.residuals)
    if count < 2:
        raise ConfigError(
            f"the log has {count} sequence; an interval needs at least 2, because the "
            "spread between sequences is what it is made of"
        )
    rows = sum(len(r) for r in lines.residuals)
    total = sum(float(r @ r) for r in lines.residuals)
    noise = max(total, rows * EXACT**2) / (FACTS_PER_SEQUENCE * count)
    grams = np.array([J.T @ J for J in lines.jacobians])  # (G, k, k)
    slopes = np.array(
        [J.T @ r for J, r in zip(lines.jacobians, lines.residuals, strict=True)]
    )
    sensitivity = np.sqrt(3.0 * np.diagonal(grams.sum(axis=0)) / rows)
    spans = np.array([p.high - p.low for p in parameters])
    live = np.flatnonzero(sensitivity * spans >= DEAD)
    unit = np.sqrt(np.diagonal(grams.sum(axis=0))[live])
    grams = grams[:, live][:, :, live] / np.outer(unit, unit)
    starts = np.array([p.start for p in parameters])
    prior = _Prior(
        distance=((lines.vector - starts)[live] * unit),
        penalty=noise / (np.array([p.spread for p in parameters])[live] * unit) ** 2,
        noise=noise,
    )
    motion = _Motion(grams, slopes[:, live] / unit, prior)
    motion.add_unmodelled(_with_unmodelled(lines, live.tolist(), unit), prior)
    quantile = student_t(count - 1)
    estimates = []
    for index, parameter in enumerate(parameters):
        value, size = float(lines.vector[index]), float(sensitivity[index])
        if index not in live:
            estimates.append(_no_effect(parameter, value, size))
            continue
        at = int(np.flatnonzero(live == index)[0])
        names = [parameters[int(i)].name for i in live]
        estimates.append(
            _estimate(parameter, value, size, motion, at, names, unit[at], quantile)
        )
    return Identifiability(
        estimates=tuple(estimates),
        condition_number=motion.condition_number if len(live) else math.inf,
        sequences=count,
        quantile=quantile,
        residual_rms=math.sqrt(3.0 * total / rows),
    )


class _Prior(NamedTuple):
    """Prior of the live parameters, in columns of unit length."""

    distance: Array
    """Fitted values minus starts [m], shape (k,)."""
    penalty: Array
    """Addition to the diagonal of J^T J [1], shape (k,)."""
    noise: float
    """Square of the error that one independent fact has [m^2]."""


def _with_unmodelled(
    lines: Linearisation, live: list[int], unit: Array
) -> tuple[Array, Array]:
    """Return Gram matrix and slope of parameters and effects that were not fitted."""
    size = len(live) + (lines.unmodelled[0].shape[1] if lines.unmodelled else 0)
    gram, slope = np.zeros((size, size)), np.zeros(size)
    for index, residual in enumerate(lines.residuals):
        columns = lines.jacobians[index][:, live] / unit
        if lines.unmodelled:
            columns = np.hstack([columns, lines.unmodelled[index]])
        gram += columns.T @ columns
        slope += columns.T @ residual
    return gram, slope


class _Motion:
    """The linearised fit in columns of unit length, lost directions left out."""

    def __init__(self, grams: Array, slopes: Array, prior: _Prior) -> None:
        """Take J_g^T J_g, shape (G, k, k), and J_g^T r_g, shape (G, k)."""
        self.correlation = grams.sum(axis=0)
        count, size = slopes.shape
        self.errors = np.zeros(size)
        self.step = np.zeros(size)
        self.inflation = np.ones(size)
        if size == 0:
            return
        values, axes = np.linalg.eigh(self.correlation)
        values = np.maximum(values, 0.0)
        kept = values > values[-1] * _SINGULAR**2
        self.condition_number = (
            math.sqrt(values[-1] / values[0]) if kept.all() else math.inf
        )
        basis = axes[:, kept]
        lost = np.linalg.norm(axes[:, ~kept], axis=1) > _LOADING
        gram = basis.T @ grams @ basis
        slope = slopes @ basis
        total_gram = gram.sum(axis=0) + basis.T @ (prior.penalty[:, None] * basis)
        total_slope = slope.sum(axis=0) + (prior.penalty * prior.distance) @ basis
        whole = -np.linalg.solve(total_gram, total_slope)
        covariance = np.zeros_like(gram[0])
        for left_gram, left_slope in zip(gram, slope, strict=True):
            rest = total_gram - left_gram
            without = -np.linalg.pinv(rest, rcond=1e-12, hermitian=True) @ (
                total_slope - left_slope
            )
            covariance += np.outer(without - whole, without - whole)
        covariance *= (count - 1) / count
        self.step = basis @ whole
        self.errors = np.sqrt(np.diagonal(basis @ covariance @ basis.T))
        self.inflation = np.diagonal(basis @ np.diag(1 / values[kept]) @ basis.T).copy()
        self.errors[lost] = math.inf
        self.inflation[lost] = math.inf

    def add_unmodelled(self, joint: tuple[Array, Array], prior: _Prior) -> None:
        """Add the expected square of the distance from the arm's own values.

        Given the log, fitted values and effects that were left out are jointly
        Gaussian, with their priors. What the residual says of the effects is used;
        what a fit took up of them is in mean and variance.

        Args:
            joint: Gram matrix and slope of parameters and effects [1, m; m, m^2].
            prior: Of the parameters; that of an effect is 1 in its own unit.
        """
        gram, slope = joint
        size = len(self.errors)
        if size == len(slope):
            return
        added = np.full(len(slope), prior.noise)
        added[:size] = prior.penalty
        pull = np.zeros(len(slope))
        pull[:size] = prior.penalty * prior.distance
        inverse = np.linalg.pinv(gram + np.diag(added), hermitian=True)
        mean = -(inverse @ (slope + pull))[:size]
        variance = prior.noise * np.diagonal(inverse)[:size]
        self.errors = np.sqrt(self.errors**2 + variance + mean**2)

    def others(self, at: int) -> Array:
        """Return the mixture of the others that imitates one motion, 0 at itself."""
        rest = np.delete(np.arange(len(self.correlation)), at)
        among, with_it = self.correlation[np.ix_(rest, rest)], self.correlation[rest]
        weights = np.zeros(len(self.correlation))
        weights[rest] = np.linalg.pinv(among, rcond=1e-8) @ with_it[:, at]
        return weights


def _no_effect(parameter: Parameter, value: float, size: float) -> ParameterEstimate:
    span = parameter.high - parameter.low
    return ParameterEstimate(
        name=parameter.name,
        unit=parameter.unit,
        value=value,
        uncertainty=Uncertainty(
            standard_error=math.inf, interval=(-math.inf, math.inf)
        ),
        sensitivity=size,
        confounding=Confounding(
            variance_inflation=math.inf, partner="", correlation=0.0
        ),
        step_left=0.0,
        judgement=Judgement(
            verdict="no effect",
            sentence=(
                f"{parameter.name} has no effect on this log: over its whole range, "
                f"{_value(parameter.low, parameter)} to "
                f"{_value(parameter.high, parameter)}, the tool moves by "
                f"{1e3 * size * span:.2g} mm RMS; leave it out"
            ),
        ),
    )


def _estimate(
    parameter: Parameter,
    value: float,
    size: float,
    motion: _Motion,
    at: int,
    names: Sequence[str],
    unit: float,
    quantile: float,
) -> ParameterEstimate:
    error = float(motion.errors[at] / unit)
    row = motion.correlation[at].copy()
    row[at] = 0.0
    closest = int(np.argmax(np.abs(row)))
    alone = len(names) == 1
    verdict, sentence = _verdict(parameter, error * quantile, motion, at, names)
    sentence += _at_bound(parameter, value)
    return ParameterEstimate(
        name=parameter.name,
        unit=parameter.unit,
        value=value,
        uncertainty=Uncertainty(
            standard_error=error,
            interval=(value - quantile * error, value + quantile * error),
        ),
        sensitivity=size,
        confounding=Confounding(
            variance_inflation=float(motion.inflation[at]),
            partner="" if alone else names[closest],
            correlation=0.0 if alone else float(row[closest]),
        ),
        step_left=float(motion.step[at] / unit),
        judgement=Judgement(verdict=verdict, sentence=sentence),
    )


def _at_bound(parameter: Parameter, value: float) -> str:
    """Say where a value lies at the search's bound: the interval knows of none."""
    near = 0.01 * (parameter.high - parameter.low)
    for name, bound in (("lower", parameter.low), ("upper", parameter.high)):
        if abs(value - bound) < near:
            return f"; the value lies at its {name} bound, {_value(bound, parameter)}"
    return ""


def usual_span(parameter: Parameter) -> float:
    """Return the width of a parameter's usual range, in its unit.

    Not of the search's bounds: a value is not better known because they are wider.
    """
    usual = KNOWN.get(parameter.name, parameter)
    return usual.high - usual.low


def _verdict(
    parameter: Parameter, half: float, motion: _Motion, at: int, names: Sequence[str]
) -> tuple[Verdict, str]:
    """Judge by the interval alone, and name the reason where it is confounding."""
    is_alike = motion.inflation[at] >= INFLATION
    limit = KNOWN_SHARE * usual_span(parameter)
    if half <= limit:
        known = f"{parameter.name} is known to +-{_value(half, parameter)}"
        if is_alike:
            known += (
                f", although {_alike(motion, at, names)}: a log that fits less closely "
                "will not tell them apart"
            )
        return "known", known
    width = (
        f"its 95 % interval is +-{_value(half, parameter)}, known is up to "
        f"+-{_value(limit, parameter)}"
    )
    if is_alike:
        return (
            "confounded",
            f"{_alike(motion, at, names)}: only their combination is known; {width}",
        )
    return (
        "undetermined",
        f"{parameter.name} is not determined by this log: {width}",
    )


def _alike(motion: _Motion, at: int, names: Sequence[str]) -> str:
    """Say which other motion, or mixture of motions, is like this one."""
    row = motion.correlation[at].copy()
    row[at] = 0.0
    closest = int(np.argmax(np.abs(row)))
    if row[closest] ** 2 >= 1.0 - 1.0 / INFLATION - 1e-12:
        how = "alike" if row[closest] > 0.0 else "alike, in opposite directions"
        return (
            f"{names[at]} and {names[closest]} move the tool {how} "
            f"(correlation {_near_one(row[closest])})"
        )
    weights = motion.others(at)
    strong = np.flatnonzero(np.abs(weights) >= 0.1 * np.abs(weights).max())
    mixture = " and ".join(names[int(i)] for i in strong)
    explained = math.sqrt(max(0.0, 1.0 - 1.0 / motion.inflation[at]))
    return (
        f"{names[at]} and a mixture of {mixture} move the tool alike "
        f"(correlation {_near_one(explained)})"
    )


def _near_one(value: float) -> str:
    """Write a correlation so that 0.9996 does not read as 1."""
    digits = 3
    while digits < 6 and round(abs(value), digits) == 1.0:
        digits += 1
    return f"{value:.{digits}f}"


def _value(value: float, parameter: Parameter) -> str:
    return f"{value:.3g}" + ("" if parameter.unit == "1" else f" {parameter.unit}")
