"""The transfer table: successes per pose with Wilson intervals, force, limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.evaluation.outcome import Outcome
from dovetail.types import Array


class Interval(NamedTuple):
    """A confidence interval of a proportion, both ends inside 0 to 1."""

    low: float
    high: float


def wilson_interval(successes: int, tries: int, *, z: float = 1.959964) -> Interval:
    r"""Return the Wilson score interval of a success rate.

    .. math:: \frac{p + z^2/2n \pm z\sqrt{p(1-p)/n + z^2/4n^2}}{1 + z^2/n}

    Args:
        successes: Number of successes, 0 to `tries`.
        tries: Number of tries n, at least 1.
        z: Normal quantile; the default gives 95 %.

    Returns:
        The interval's two ends, each 0 to 1.

    Raises:
        ConfigError: the counts are impossible.

    Reference:
        Wilson 1927, J. Am. Stat. Assoc. 22, 209-212.
    """
    if tries < 1 or not 0 <= successes <= tries:
        raise ConfigError(
            f"{successes} successes of {tries} tries is impossible: "
            "needs tries >= 1 and 0 <= successes <= tries"
        )
    rate = successes / tries
    spread = z * math.sqrt(rate * (1 - rate) / tries + z**2 / (4 * tries**2))
    centre = rate + z**2 / (2 * tries)
    scale = 1 + z**2 / tries
    low = 0.0 if successes == 0 else (centre - spread) / scale
    high = 1.0 if successes == tries else (centre + spread) / scale
    return Interval(low, high)


@dataclass(frozen=True, kw_only=True)
class StepsTaken:
    """Policy steps to insert of several tries, the successful ones; nan without one."""

    median: float
    """Median policy steps."""
    max: float
    """Most policy steps."""


@dataclass(frozen=True, kw_only=True)
class ForceSpread:
    """Contact force of several tries; nan where the arm does not measure it."""

    mean: float
    """Mean over the cycles in contact of all tries [N]."""
    peak_p95: float
    """95th percentile over the tries of the peak [N]."""
    peak: float
    """Largest seen in any try [N]."""
    step_p95: float
    """95th percentile over the tries of the largest 50 ms mean [N]."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table: all tries at one fixture pose, or all of them."""

    label: str
    """Name of the fixture pose, or "all"."""
    tries: int
    """Number of tries."""
    successes: int
    """Number of tries in which the task was done."""
    interval: Interval
    """Wilson 95 % interval of the success rate."""
    steps: StepsTaken
    """Policy steps to do the task."""
    force: ForceSpread
    """Contact force meanwhile."""
    violations: int
    """Control cycles in which a measured value lay outside its limit."""

    def numbers(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        return {
            "label": self.label,
            "tries": self.tries,
            "successes": self.successes,
            "interval": self.interval,
            "steps_median": self.steps.median,
            "steps_max": self.steps.max,
            "force_mean": self.force.mean,
            "force_peak_p95": self.force.peak_p95,
            "force_peak": self.force.peak,
            "force_step_p95": self.force.step_p95,
            "violations": self.violations,
        }


def summarise(outcomes: Sequence[Outcome], labels: Sequence[str]) -> list[Row]:
    """Return one row per fixture pose, in order, and a last one over all.

    Args:
        outcomes: Every try; at least one per pose.
        labels: Name of each fixture pose; `Job.pose` indexes it.

    Raises:
        ConfigError: a pose has no try.
    """
    rows = [
        _row(label, [outcome for outcome in outcomes if outcome.job.pose == index])
        for index, label in enumerate(labels)
    ]
    return [*rows, _row("all", outcomes)]


def _row(label: str, outcomes: Sequence[Outcome]) -> Row:
    if not outcomes:
        raise ConfigError(f"fixture pose {label} has no try to summarise")
    steps = np.array([o.course.steps for o in outcomes if o.success], dtype=float)
    forces = [o.force for o in outcomes if o.course.steps] or [outcomes[0].force]
    peaks = np.array([force.peak for force in forces])
    in_contact = np.array([force.cycles for force in forces])
    means = np.array([force.mean for force in forces])
    successes = sum(o.success for o in outcomes)
    return Row(
        label=label,
        tries=len(outcomes),
        successes=successes,
        interval=wilson_interval(successes, len(outcomes)),
        steps=StepsTaken(
            median=float(np.median(steps)) if steps.size else math.nan,
            max=float(steps.max()) if steps.size else math.nan,
        ),
        force=ForceSpread(
            mean=_weighted_mean(means, in_contact),
            peak_p95=float(np.percentile(peaks, 95)),
            peak=float(peaks.max()),
            step_p95=float(np.percentile([force.step for force in forces], 95)),
        ),
        violations=sum(o.course.violations for o in outcomes),
    )


def _weighted_mean(means: Array, counts: Array) -> float:
    """Return the mean over all cycles in contact; nan if a try did not measure it."""
    if np.isnan(means).any():
        return math.nan
    total = counts.sum()
    return float((means * counts).sum() / total) if total else 0.0


COLUMNS = (
    "pose",
    "success",
    "Wilson 95 %",
    "steps median / max",
    "force mean [N]",
    "peak p95 [N]",
    "50 ms p95 [N]",
    "limits broken",
)
"""Headings of the table, in the order of `cells`."""


def cells(row: Row) -> tuple[str, ...]:
    """Return a row as text, one cell per entry of `COLUMNS`."""
    steps, forces = row.steps, row.force
    has_steps = not math.isnan(steps.median)
    low, high = row.interval
    return (
        row.label,
        f"{row.successes}/{row.tries}",
        f"{100 * low:.1f}-{100 * high:.1f} %",
        f"{steps.median:.0f} / {steps.max:.0f}" if has_steps else "none",
        *(
            "-" if math.isnan(force) else f"{force:.1f}"
            for force in (forces.mean, forces.peak_p95, forces.step_p95)
        ),
        str(row.violations),
    )
