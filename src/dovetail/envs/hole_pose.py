"""Named places of the hole: where tries begin, and what a user gives."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.types import Vec3

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
"""Rotation (wxyz) of a hole that opens upwards."""


class HolePose(NamedTuple):
    """A named place of the hole: mouth centre in the world, turned about z."""

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
    """Rotation (wxyz) of the hole's frame at theta 0."""

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
                f"hole is {', '.join(f'{n:g}' for n in numbers)}; give four finite "
                "numbers: x y z [m] of its mouth and yaw [rad], world axes"
            )
        x, y, z, yaw = map(float, numbers)
        return cls("given", x, y, z, yaw, facing)

    def pose(self) -> Pose:
        """Return the hole's frame in the world, z out of the hole."""
        quat = quat_multiply(quat_about_z(self.theta), np.array(self.facing))
        return Pose(np.array([self.x, self.y, self.z]), quat)


def insertion(error: Vec3, axis: Vec3, hole_depth: float) -> tuple[float, float]:
    """Return how deep the tool is in a hole and how far from its axis [m].

    Args:
        error: Tool minus the middle of the hole's floor [m].
        axis: The hole's axis, outwards, unit length; same axes.
        hole_depth: From mouth to floor [m].
    """
    x, y, z = error.tolist()
    nx, ny, nz = axis.tolist()
    height = x * nx + y * ny + z * nz
    lateral = math.sqrt(max(x * x + y * y + z * z - height * height, 0.0))
    return hole_depth - height, lateral


HOLE_POSES = (
    HolePose("A", 0.56, -0.045, 0.085, -0.15),
    HolePose("B", 0.60, 0.045, 0.10, 0.10),
    HolePose("C", 0.64, -0.01, 0.115, 0.20),
)
"""The three hole poses of the transfer table: x, y, z and theta all differ."""
