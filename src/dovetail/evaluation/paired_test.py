"""Sequential test of two policies that were tried on the same starts."""

import math
from functools import cache
from typing import Literal, NamedTuple

import numpy as np

from dovetail.evaluation.transfer import Interval, wilson_interval
from dovetail.settings import in_count
from dovetail.types import Array

Verdict = Literal["first", "second", "undecided", "no answer"]
"""The better policy; or undecided so far; or no answer within the planned tries."""
TRIES_MAX = 2000
"""Most tries of a policy that a test is planned for."""
_Z = 1.959964
"""Normal quantile of a two-sided 95 % interval."""


class Pairs(NamedTuple):
    """Counts of the tries that two policies made from the same starts."""

    both: int = 0
    """Both succeeded."""
    first: int = 0
    """Only the first succeeded."""
    second: int = 0
    """Only the second succeeded."""
    neither: int = 0
    """Both failed."""

    @property
    def tries(self) -> int:
        """Number of tries of each."""
        return sum(self)

    @property
    def difference(self) -> float:
        """Success rate of the first less that of the second, -1 to 1."""
        return (self.first - self.second) / self.tries

    def add(self, first: bool, second: bool) -> "Pairs":
        """Return the counts with one more try of each."""
        counts = [*self]
        counts[2 * (not first) + (not second)] += 1
        return Pairs(*counts)


def judge(pairs: Pairs, tries: int, error_rate: float = 0.05) -> Verdict:
    """Say which policy is better, as soon as the tries tell.

    It may be asked after each try: for two policies that are equally good, the chance
    that it ever names one is at most `error_rate`. Only starts from which one policy
    succeeded and the other failed count (McNemar's test); with equal policies each is
    as likely to be the one. Against a better policy with an unknown share of these, the
    uniform mixture of likelihood ratios is compared with a threshold (Robbins 1970,
    Ann. Math. Stat. 41, 1397-1409), which is the smallest that keeps the error rate
    within the planned tries.

    Args:
        pairs: Counts so far.
        tries: Most tries of each policy, planned before the first one, 1 to 2000.
        error_rate: Chance of naming one of two equal policies, over 0 and below 1.

    Raises:
        ConfigError: `tries` is out of range.
    """
    bounds = _bounds(
        in_count("tries", tries, 1, TRIES_MAX, "of each policy"), error_rate
    )
    unequal, lead = pairs.first + pairs.second, pairs.first - pairs.second
    if abs(lead) >= bounds[unequal]:
        return "first" if lead > 0 else "second"
    left = np.arange(tries - pairs.tries + 1)
    can_end = np.any(abs(lead) + left >= bounds[unequal + left])
    return "undecided" if can_end else "no answer"


@cache
def _bounds(tries: int, error_rate: float) -> Array:
    """Return the lead that decides, for each number of unequal tries, 0 to `tries`."""
    low, high = 0.0, -math.log(error_rate) + 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        is_kept = error_of(_leads(tries, middle)) <= error_rate
        low, high = (low, middle) if is_kept else (middle, high)
    return _leads(tries, high)


def _leads(tries: int, threshold: float) -> Array:
    """Return the smallest lead whose log likelihood ratio reaches a threshold.

    With w of n unequal tries won, the ratio of the uniform mixture to a fair coin is
    2^n w! (n - w)! / (n + 1)!.
    """
    log_factorial = np.append(0.0, np.cumsum(np.log(np.arange(1, tries + 2))))
    leads = np.full(tries + 1, float(tries + 1))
    for n in range(1, tries + 1):
        won = np.arange((n + 1) // 2, n + 1)
        ratio = n * math.log(2.0) - log_factorial[n + 1]
        ratio = ratio + log_factorial[won] + log_factorial[n - won]
        enough = np.flatnonzero(ratio >= threshold)
        if enough.size:
            leads[n] = 2 * won[enough[0]] - n
    return leads


def error_of(leads: Array) -> float:
    """Return the chance that two equal policies are told apart.

    Args:
        leads: Lead that decides after 0, 1, 2, ... unequal tries.
    """
    widest = int(leads[leads < len(leads)].max(initial=0)) + 1
    lead = np.arange(-widest, widest + 1)
    share, error = (lead == 0).astype(float), 0.0
    for decides in leads[1:]:
        share = 0.5 * (np.append(share[1:], 0.0) + np.append(0.0, share[:-1]))
        is_out = np.abs(lead) >= decides
        error += float(share[is_out].sum())
        share[is_out] = 0.0
    return error


def difference_interval(pairs: Pairs) -> Interval:
    """Return the 95 % interval of the difference of two paired success rates.

    Newcombe's square-and-add interval with Wilson limits and the correlation of the
    pairs (his method 10).

    Reference:
        Newcombe 1998, Statistics in Medicine 17, 2635-2650.
    """
    both, first, second, neither = pairs
    n, rates = pairs.tries, (both + first, both + second)
    (low_1, high_1), (low_2, high_2) = (wilson_interval(k, n, z=_Z) for k in rates)
    rate_1, rate_2 = (k / n for k in rates)
    margins = math.prod((rates[0], n - rates[0], rates[1], n - rates[1]))
    product = both * neither - first * second
    if product > 0:  # Newcombe's correction for continuity
        product = max(product - n / 2, 0)
    phi = product / math.sqrt(margins) if margins else 0.0
    down = _apart(rate_1 - low_1, high_2 - rate_2, phi)
    up = _apart(high_1 - rate_1, rate_2 - low_2, phi)
    return Interval(pairs.difference - down, pairs.difference + up)


def _apart(one: float, other: float, phi: float) -> float:
    return math.sqrt(max(0.0, one**2 - 2.0 * phi * one * other + other**2))
