"""Random hole pose and start pose of an episode; nothing else is random."""

import math

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.settings import settings
from dovetail.types import Vec3


@settings()
class HoleRangeConfig:
    """Range of the hole's pose."""

    hole_centre: tuple[float, float, float] = (0.60, 0.0, 0.10)
    """Middle of the hole's mouth positions [m], world axes."""
    hole_range: tuple[float, float, float] = (0.05, 0.05, 0.02)
    """Half range of the hole's mouth position about the middle [m]."""
    hole_yaw: float = 0.3
    """Half range of the hole's rotation about the vertical [rad]."""


@settings()
class StartRangeConfig:
    """Range of the tool's start pose."""

    start_xy: float = 0.12
    """Half range of the tool's start about the hole, along world x and y [m]."""
    start_z: tuple[float, float] = (-0.03, 0.12)
    """Range of the tool's start height above the hole's mouth [m]."""
    start_yaw: float = 0.2
    """Half range of the tool's start rotation relative to the hole [rad]."""


@settings()
class FreeAirConfig:
    """Space that a start keeps clear of."""

    block_half: float = 0.05
    """Half side of the block around the hole, seen from above [m]."""
    peg_radius: float = 0.0212
    """Radius of the circle around the peg's section, seen from above [m]."""
    gap: float = 0.005
    """Smallest gap between peg and block at the start [m]."""


@settings()
class RandomisationConfig(HoleRangeConfig, StartRangeConfig, FreeAirConfig):
    """Ranges of the start pose and the hole pose (uniform)."""

    @property
    def is_hole_fixed(self) -> bool:
        """True if every hole that is drawn is the same."""
        return not any((*self.hole_range, self.hole_yaw))


def sample_hole(rng: np.random.Generator, config: RandomisationConfig) -> Pose:
    """Draw the pose of the hole's mouth (z out of the hole)."""
    half = np.asarray(config.hole_range)
    position = np.asarray(config.hole_centre) + rng.uniform(-half, half)
    return Pose(position, quat_about_z(rng.uniform(-config.hole_yaw, config.hole_yaw)))


def is_clear_of_block(
    offset: Vec3, hole_yaw: float, config: RandomisationConfig
) -> bool:
    """Say whether a peg tip at `offset` from the mouth [m], world axes, is in free air.

    Above the mouth plus the gap everything is free; lower down only what lies beside
    the block's square footprint, widened by the peg's radius and the gap.
    """
    if offset[2] >= config.gap:
        return True
    c, s = math.cos(hole_yaw), math.sin(hole_yaw)
    x = c * offset[0] + s * offset[1]
    y = -s * offset[0] + c * offset[1]
    reach = config.block_half + config.peg_radius + config.gap
    return max(abs(x), abs(y)) >= reach


def sample_start(
    rng: np.random.Generator, hole: Pose, hole_yaw: float, config: RandomisationConfig
) -> Pose:
    """Draw the tool's start pose about the hole, in free air, tool down.

    Starts below the block's surface, beside it, are part of the range: they are what
    makes the task hard (Kaspar et al. 2020).

    Raises:
        ConfigError: When the ranges leave no free start.
    """
    low = np.array([-config.start_xy, -config.start_xy, config.start_z[0]])
    high = np.array([config.start_xy, config.start_xy, config.start_z[1]])
    for _ in range(1000):
        offset = rng.uniform(low, high)
        if is_clear_of_block(offset, hole_yaw, config):
            yaw = hole_yaw + rng.uniform(-config.start_yaw, config.start_yaw)
            return Pose(hole.position + offset, tool_down(yaw))
    raise ConfigError(
        f"no start in free air among 1000 draws: start_xy {config.start_xy:g} m, "
        f"start_z {config.start_z[0]:g} to {config.start_z[1]:g} m, block half side "
        f"{config.block_half:g} m; widen start_xy or raise start_z"
    )
