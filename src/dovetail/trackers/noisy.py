"""A camera that is not exact: an offset for the episode, and jitter on top."""

import numpy as np

from dovetail.arms.arm import ArmState
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.trackers.tracker import Estimate

_POSITION = Range(0.0, 0.05, "m")
_TURN = Range(0.0, 0.5, "rad")
_STREAM = 0x7AC4E5
"""Keeps these draws apart from those of start and fixture, which have the same seed."""


class Noisy:
    """Normal errors of position and of the turn about the world's vertical."""

    _fixture: Pose

    def __init__(
        self, offset: float = 0.0005, jitter: float = 0.0, turn: float = 0.0
    ) -> None:
        """Take the standard deviations.

        Args:
            offset: Of an error drawn once for an episode, each of x y z [m].
            jitter: Of an error drawn at each look, each of x y z [m].
            turn: Of a turn about the vertical, drawn once for an episode [rad].

        Raises:
            ConfigError: Out of range.
        """
        self.offset = in_range("tracker offset", offset, _POSITION)
        self.jitter = in_range("tracker jitter", jitter, _POSITION)
        self.turn = in_range("tracker turn", turn, _TURN)
        self._rng = np.random.default_rng()

    def reset(self, fixture: Pose, seed: int) -> None:
        """Draw the episode's errors."""
        self._rng = np.random.default_rng([_STREAM, seed])
        self._error = self.offset * self._rng.normal(size=3)
        self._turned = quat_about_z(self.turn * float(self._rng.normal()))
        self._look(fixture)

    def update(self, fixture: Pose, state: ArmState) -> None:
        """Look again."""
        self._look(fixture)

    def _look(self, fixture: Pose) -> None:
        error = self._error + self.jitter * self._rng.normal(size=3)
        quat = quat_multiply(self._turned, fixture.quat_wxyz)
        self._fixture = Pose(fixture.position + error, quat)

    def estimate(self) -> Estimate:
        """Return what was seen, just now."""
        return Estimate(self._fixture, 0.0)
