"""Differences between cells, with intervals clustered by training seed and by twin.

Tries of one policy on one twin are not independent facts: another seed gives another
policy, another twin another robot. So whole policies and whole twins are drawn again,
in the bootstrap of two crossed factors. It errs on the wide side.

Reference:
    Owen 2007, The pigeonhole bootstrap, Ann. Appl. Stat. 1(2), 386-411.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dovetail.types import Array

DRAWS = 4000
"""Bootstrap samples behind an interval."""
FEWEST = 3
"""Twins, and policies that know none, from which an interval is given."""
_SEED = 20


class Measured(NamedTuple):
    """A measure of a cell's policies on its twins."""

    values: Array
    """Shape (policies, twins), means over the tries; nan where there is none. A row for
    each policy that knows no twin, else one row with each twin's own policy."""
    is_of_twin: bool
    """True if each twin has its own policy."""

    @property
    def mean(self) -> float:
        """Mean over policies and twins; nan without any."""
        known = self.values[~np.isnan(self.values)]
        return float(known.mean()) if known.size else math.nan


class Effect(NamedTuple):
    """A difference with its 95 % interval."""

    value: float
    low: float
    """nan with too few twins or policies for an interval."""
    high: float
    twins: int
    """Twins that all of its cells were tried on."""


def contrast(terms: Sequence[tuple[float, Measured]]) -> Effect:
    """Return a weighted sum of cells, paired by twins.

    Twins that a cell lacks are left out of all; then policies that lack one of these.

    Args:
        terms: Weight and measure of each cell; (1, a) and (-1, b) is a minus b. The
            twins are the same, in the same order.

    Returns:
        The effect; nan where no twin is left.
    """
    known = np.all([~np.isnan(m.values).all(axis=0) for _, m in terms], axis=0)
    count = int(known.sum())
    kept: list[tuple[float, Array]] = []
    crossed = []
    for weight, measured in terms:
        values = measured.values[:, known]
        values = values[~np.isnan(values).any(axis=1)]
        if not count or not len(values):
            return Effect(math.nan, math.nan, math.nan, count)
        kept.append((weight, values))
        crossed += [] if measured.is_of_twin else [len(values)]
    value = sum(weight * float(values.mean()) for weight, values in kept)
    if min([count, *crossed]) < FEWEST:
        return Effect(value, math.nan, math.nan, count)
    random = np.random.default_rng(_SEED)
    drawn = random.multinomial(count, [1.0 / count] * count, DRAWS) / count
    sums = np.zeros(DRAWS)
    for weight, values in kept:
        policies = len(values)
        share = random.multinomial(policies, [1.0 / policies] * policies, DRAWS)
        # one policy per twin: drawing the twin has drawn it
        sums += weight * np.einsum("dp,pt,dt->d", share / policies, values, drawn)
    low, high = np.percentile(sums, [2.5, 97.5])
    return Effect(value, float(low), float(high), count)
