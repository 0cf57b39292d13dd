"""Connection quality from the share of replies that came in time.

The thresholds of a real cabinet are not public; these let KUKA's own clients reach
COMMANDING_ACTIVE and are all parameters.
"""

from collections import deque
from typing import Self

from pydantic import model_validator

from dovetail.cabinet.protocol import Quality
from dovetail.errors import ConfigError
from dovetail.settings import settings


@settings(owner="quality")
class QualityRule:
    """Thresholds of a poor, fair, good or excellent link."""

    window: int = 100
    """Due replies that are looked at; those not yet due count as missed."""
    fair_from: float = 0.30
    """Share of replies in time from which the link is FAIR [1]."""
    good_from: float = 0.80
    """Share from which it is GOOD, which commanding needs [1]."""
    excellent_from: float = 0.97
    """Share from which it is EXCELLENT [1]."""
    misses_max: int = 10
    """Replies missed in a row that still are not POOR."""

    @model_validator(mode="after")
    def _check_quality_rule(self) -> Self:
        """Refuse thresholds that contradict each other."""
        if self.window < 1:
            raise ConfigError(f"quality window is {self.window}; give 1 or more")
        if self.misses_max < 0:
            raise ConfigError(f"quality misses_max is {self.misses_max}; give >= 0")
        shares = (self.fair_from, self.good_from, self.excellent_from)
        if not 0.0 <= shares[0] <= shares[1] <= shares[2] <= 1.0:
            raise ConfigError(
                f"quality thresholds are fair {shares[0]:g}, good {shares[1]:g}, "
                f"excellent {shares[2]:g}; they must rise within 0 to 1"
            )
        return self


class LinkQuality:
    """Judges the link, one due reply after the other."""

    def __init__(self, rule: QualityRule) -> None:
        """Begin with no reply seen, which is POOR."""
        self.rule = rule
        self._hits: deque[bool] = deque(maxlen=rule.window)
        self._num_hits = 0
        self.misses_in_a_row = 0
        self.forced: Quality | None = None
        """A quality that a fault puts in the rule's place."""

    def reset(self) -> None:
        """Forget every reply, as a new session does."""
        self._hits.clear()
        self._num_hits = 0
        self.misses_in_a_row = 0

    def add(self, is_hit: bool) -> None:
        """Count a due reply: in time, or missed."""
        hits = self._hits
        if len(hits) == self.rule.window:
            self._num_hits -= hits[0]
        hits.append(is_hit)
        self._num_hits += is_hit
        self.misses_in_a_row = 0 if is_hit else self.misses_in_a_row + 1

    @property
    def ratio(self) -> float:
        """Share of the window's replies that came in time."""
        return self._num_hits / self.rule.window

    @property
    def value(self) -> Quality:
        """The link's quality now."""
        if self.forced is not None:
            return self.forced
        rule, ratio = self.rule, self.ratio
        if ratio < rule.fair_from or self.misses_in_a_row > rule.misses_max:
            return Quality.POOR
        if ratio < rule.good_from:
            return Quality.FAIR
        if ratio < rule.excellent_from:
            return Quality.GOOD
        return Quality.EXCELLENT
