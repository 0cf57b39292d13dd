"""Any tracker, later and noisier: a camera without pictures."""

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.trackers.tracker import Estimate, Tracker, close_tracker
from dovetail.trackers.truth import Truth
from dovetail.types import Vec3

_DELAY = Range(0.0, 10.0, "s")
_RATE = Range(0.1, math.inf, "1/s")
_SHIFT = Range(0.0, 0.05, "m")
_TURN = Range(0.0, 0.5, "rad")
_SHARE = Range(0.0, 1.0, "1")
_STREAM = 0x1A7E
"""Keeps these draws apart from those of start and fixture, which have the same seed."""
_ROUNDING = 1e-9  # s, of stamps that are sums of periods


class _Look(NamedTuple):
    stamp: float
    estimate: Estimate


class Late:
    """Looks at what another tracker tells, as a camera would.

    A look is taken `rate` times a second and can be used `delay` later. Beside where it
    is: a horizontal offset of one length in a direction drawn for the episode, a normal
    offset of x y z drawn for the episode, a turn about the vertical whose sign is
    drawn, and normal jitter for each look.
    """

    def __init__(
        self,
        delay: float = 0.05,
        rate: float = 30.0,
        bias: float = 0.0,
        turn: float = 0.0,
        jitter: float = 0.0,
        dropout: float = 0.0,
        offset: float = 0.0,
        inner: Tracker | None = None,
    ) -> None:
        """Take the camera's faults.

        Args:
            delay: Age of a look when it can be used [s].
            rate: Looks per second; infinite is one at each step of the environment.
            bias: Horizontal offset [m].
            turn: Turn about the vertical [rad].
            jitter: Standard deviation of each look, each of x y z [m].
            dropout: Share of the looks that are lost.
            offset: Standard deviation of the episode's own error of x y z [m].
            inner: What is looked at; None is the truth.

        Raises:
            ConfigError: Out of range.
        """
        self.delay = in_range("tracker delay", delay, _DELAY)
        self.rate = in_range("tracker rate", rate, _RATE)
        self.bias = in_range("tracker bias", bias, _SHIFT)
        self.turn = in_range("tracker turn", turn, _TURN)
        self.jitter = in_range("tracker jitter", jitter, _SHIFT)
        self.dropout = in_range("tracker dropout", dropout, _SHARE)
        self.offset = in_range("tracker offset", offset, _SHIFT)
        self.inner = inner or Truth()
        self._rng = np.random.default_rng()
        self._waiting: deque[_Look] = deque()

    def reset(self, fixture: Pose, seed: int) -> None:
        """Draw the episode's errors; the first look was before the episode."""
        self._rng = np.random.default_rng([_STREAM, seed])
        angle = self._rng.uniform(-math.pi, math.pi)
        self._error: Vec3 = self.bias * np.array([math.cos(angle), math.sin(angle), 0])
        self._turned = quat_about_z(self.turn * float(self._rng.choice([-1.0, 1.0])))
        self._next = float(self._rng.uniform(0.0, 1.0 / self.rate))
        self._now = 0.0
        if self.offset:
            self._error = self._error + self.offset * self._rng.normal(size=3)
        self.inner.reset(fixture, seed)
        self._before = self.inner.estimate()
        first = 0.0 if math.isinf(self.rate) else -self.delay
        self._seen = _Look(first, self._spoilt(self._before))
        self._waiting.clear()

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Take the looks since the last call, and use those that are old enough."""
        begin, self._now = self._now, state.stamp
        self.inner.update(fixture, state)
        newest = self.inner.estimate()
        for stamp, look in self._looks(begin, newest):
            if self._rng.random() >= self.dropout:
                self._waiting.append(_Look(stamp, self._spoilt(look)))
        self._before = newest
        while self._waiting and (
            self._waiting[0].stamp <= self._now - self.delay + _ROUNDING
        ):
            self._seen = self._waiting.popleft()

    def estimate(self) -> Estimate:
        """Return the newest look that is old enough, and its age."""
        seen = self._seen
        return seen.estimate._replace(age=self._now - seen.stamp + seen.estimate.age)

    def close(self) -> None:
        """Give back what is looked at; harmless when repeated."""
        close_tracker(self.inner)

    def _looks(self, begin: float, newest: Estimate) -> Iterator[_Look]:
        """Yield the looks since a time [s], each with what was there at its own."""
        if math.isinf(self.rate):
            yield _Look(self._now, newest)
            return
        start, end = self._before.pose.position, newest.pose.position
        while self._next <= self._now + _ROUNDING:
            share = (self._next - begin) / max(self._now - begin, _ROUNDING)
            there = newest.pose._replace(position=start + share * (end - start))
            yield _Look(self._next, newest._replace(pose=there))
            self._next += 1.0 / self.rate

    def _spoilt(self, estimate: Estimate) -> Estimate:
        error = self._error + self.jitter * self._rng.normal(size=3)
        quat = quat_multiply(self._turned, estimate.pose.quat_wxyz)
        return estimate._replace(pose=Pose(estimate.pose.position + error, quat))
