"""Random fixture pose and start pose of an episode; nothing else is random."""

import math

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.settings import settings


@settings()
class InsertStarts:
    """Ranges of the fixture and of the tool's start (uniform)."""

    middle: tuple[float, float, float] = (0.60, 0.0, 0.10)
    """Middle of the positions of the fixture's mouth [m], world axes."""
    half_range: tuple[float, float, float] = (0.05, 0.05, 0.02)
    """Half range about it [m]."""
    yaw: float = 0.3
    """Half range of the fixture's turn about the vertical [rad]."""
    aside: float = 0.12
    """Half range of the start beside the mouth, along world x and y [m]."""
    height: tuple[float, float] = (-0.03, 0.12)
    """Range of its height over the mouth [m]: also beside the fixture, and lower."""
    turn: float = 0.2
    """Half range of its turn against the fixture [rad]."""
    apart: float = 0.05
    """Half side of the square about the mouth that a low start keeps out of [m]."""
    free: float = 0.005
    """Height over the mouth from which everything is in free air [m]."""


def draw_fixture(rng: np.random.Generator, ranges: InsertStarts) -> Pose:
    """Draw the pose of the fixture's mouth."""
    half = np.asarray(ranges.half_range)
    position = np.asarray(ranges.middle) + rng.uniform(-half, half)
    return Pose(position, quat_about_z(rng.uniform(-ranges.yaw, ranges.yaw)))


def draw_start(rng: np.random.Generator, fixture: Pose, ranges: InsertStarts) -> Pose:
    """Draw the tool's start pose about the fixture, in free air, tool down.

    Raises:
        ConfigError: The ranges leave no free start.
    """
    yaw = 2.0 * math.atan2(fixture.quat_wxyz[3], fixture.quat_wxyz[0])
    c, s = math.cos(yaw), math.sin(yaw)
    low = np.array([-ranges.aside, -ranges.aside, ranges.height[0]])
    high = np.array([ranges.aside, ranges.aside, ranges.height[1]])
    for _ in range(1000):
        x, y, z = offset = rng.uniform(low, high)
        if z >= ranges.free or max(abs(c * x + s * y), abs(c * y - s * x)) >= (
            ranges.apart
        ):
            turn = rng.uniform(-ranges.turn, ranges.turn)
            return Pose(fixture.position + offset, tool_down(yaw + turn))
    raise ConfigError(
        f"no start in free air among 1000 draws: aside {ranges.aside:g} m, height "
        f"{ranges.height[0]:g} to {ranges.height[1]:g} m, {ranges.apart:g} m to keep "
        "from the fixture; make the fixture smaller"
    )
