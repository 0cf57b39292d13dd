"""Named places of the fixture: where tries begin, and what a user gives."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, quat_multiply

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
"""Rotation (wxyz) of a fixture that opens upwards."""


class FixturePose(NamedTuple):
    """A named place of the fixture: its frame's origin in the world, turned about z."""

    name: str
    x: float
    """[m]"""
    y: float
    """[m]"""
    z: float
    """[m]"""
    theta: float
    """[rad]"""
    facing: tuple[float, ...] = UPRIGHT
    """Rotation (wxyz) of the fixture's frame at theta 0."""

    @classmethod
    def given(
        cls, numbers: Sequence[float], facing: tuple[float, ...] = UPRIGHT
    ) -> Self:
        """Return the place that a user named by x y z [m] and yaw [rad].

        Raises:
            ConfigError: Not four finite numbers.
        """
        if len(numbers) != 4 or not all(map(math.isfinite, numbers)):
            raise ConfigError(
                f"the fixture's place is {', '.join(f'{n:g}' for n in numbers)}; give "
                "four finite numbers: x y z [m] of its frame and yaw [rad], world axes"
            )
        x, y, z, yaw = map(float, numbers)
        return cls("given", x, y, z, yaw, facing)

    def pose(self) -> Pose:
        """Return the fixture's frame in the world, z out of the fixture."""
        quat = quat_multiply(quat_about_z(self.theta), np.array(self.facing))
        return Pose(np.array([self.x, self.y, self.z]), quat)
