"""Named places of the fixture: where tries begin, and what a user gives."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.types import Vec4

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
    """Rotation (wxyz) of the fixture's frame at theta 0, not tilted."""
    b: float = 0.0
    """Tilt about y [rad]."""
    c: float = 0.0
    """Tilt about x [rad]."""

    @classmethod
    def given(
        cls, numbers: Sequence[float], facing: tuple[float, ...] = UPRIGHT
    ) -> Self:
        """Return the place that a user named by x y z [m], yaw and tilts B C [rad].

        Raises:
            ConfigError: Neither four nor six finite numbers.
        """
        if len(numbers) not in (4, 6) or not all(map(math.isfinite, numbers)):
            raise ConfigError(
                f"the fixture's place is {', '.join(f'{n:g}' for n in numbers)}; give "
                "four finite numbers: x y z [m] of its frame and yaw [rad], world "
                "axes; or six, with its tilts B and C about y and x [rad]"
            )
        x, y, z, yaw, b, c = (*map(float, numbers), 0.0, 0.0)[:6]
        return cls("given", x, y, z, yaw, facing, b, c)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The place as `given` reads it: four numbers, or six where it is tilted."""
        place = self.x, self.y, self.z, self.theta
        return (*place, self.b, self.c) if self.b or self.c else place

    def pose(self) -> Pose:
        """Return the fixture's frame in the world, z out of the fixture."""
        quat = turned(self.facing, self.theta, self.b, self.c)
        return Pose(np.array([self.x, self.y, self.z]), quat)


def turned(facing: tuple[float, ...], a: float, b: float, c: float) -> Vec4:
    """Return a fixture's rotation (wxyz): its facing, then turned as KUKA's A B C.

    .. math:: R = R_z(A) R_y(B) R_x(C) R_{facing}

    Args:
        facing: Rotation (wxyz) that is turned.
        a: Turn about the world's vertical [rad].
        b: Tilt about the y axis that A has turned [rad].
        c: Tilt about the x axis that A and B have turned [rad].
    """
    quat = np.array(facing)
    if b or c:
        about_x = np.array([math.cos(c / 2.0), math.sin(c / 2.0), 0.0, 0.0])
        about_y = np.array([math.cos(b / 2.0), 0.0, math.sin(b / 2.0), 0.0])
        quat = quat_multiply(quat_multiply(about_y, about_x), quat)
    return quat_multiply(quat_about_z(a), quat)
