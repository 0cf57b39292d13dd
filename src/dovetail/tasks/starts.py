"""Random pose of the fixture and of the start; nothing else of an episode is random."""

import math

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat, quat_about_z, tool_down
from dovetail.settings import settings
from dovetail.types import Vec3, Vec4


@settings()
class FixtureRangeConfig:
    """Range of the fixture's pose."""

    middle: tuple[float, float, float] = (0.60, 0.0, 0.10)
    """Middle of the positions of the mouth [m], world axes."""
    half_range: tuple[float, float, float] = (0.05, 0.05, 0.02)
    """Half range of the mouth's position about the middle [m]."""
    yaw: float = 0.3
    """Half range of the fixture's turn about the vertical [rad]."""


@settings()
class StartRangeConfig:
    """Range of the tool's start pose."""

    aside: float = 0.12
    """Half range of the start beside the mouth, along world x and y [m]."""
    height: tuple[float, float] = (-0.03, 0.12)
    """Range of the start's height over the mouth [m]: also beside it, and lower."""
    turn: float = 0.2
    """Half range of the tool's turn against the fixture [rad]."""


@settings()
class FreeAirConfig:
    """Space that a start keeps clear of."""

    fixture_half: float = 0.05
    """Half side of the fixture, seen from above [m]."""
    held_radius: float = 0.0212
    """Radius of the circle around the held part, seen from above [m]."""
    gap: float = 0.005
    """Smallest gap between held part and fixture at the start [m]."""


@settings()
class RandomisationConfig(FixtureRangeConfig, StartRangeConfig, FreeAirConfig):
    """Ranges of start and fixture (uniform)."""

    @property
    def is_fixed(self) -> bool:
        """True if every fixture that is drawn is the same."""
        return not any((*self.half_range, self.yaw))


def sample_fixture(rng: np.random.Generator, config: RandomisationConfig) -> Pose:
    """Draw the pose of the mouth, z out of it and upwards."""
    half = np.asarray(config.half_range)
    position = np.asarray(config.middle) + rng.uniform(-half, half)
    return Pose(position, quat_about_z(rng.uniform(-config.yaw, config.yaw)))


def is_clear(offset: Vec3, fixture: Vec4, config: RandomisationConfig) -> bool:
    """Say whether a part whose end is at `offset` from the mouth is in free air.

    Above the mouth plus the gap everything is free; lower down only what lies beside
    the fixture's square footprint, widened by the part's radius and the gap. One that
    is tilted is seen along its own axis: there one side of the part's end is lower than
    its middle, and the part leans over the fixture.

    Args:
        offset: TCP minus the mouth's middle [m], world axes.
        fixture: Rotation (wxyz) of the fixture's frame.
        config: Fixture, part and gap.
    """
    x, y, z = matrix_from_quat(fixture).T @ offset
    lean = 2.0 * math.hypot(fixture[1], fixture[2])  # at least the sine of the tilt
    if z >= config.gap + lean * config.held_radius:
        return True
    reach = config.fixture_half + config.held_radius + config.gap - lean * min(z, 0.0)
    return max(abs(x), abs(y)) >= reach


def sample_start(
    rng: np.random.Generator, fixture: Pose, own_yaw: float, config: RandomisationConfig
) -> Pose:
    """Draw the tool's start pose about the mouth, in free air, tool down.

    Starts below the mouth, beside the fixture, are part of the range: they are what
    makes the task hard (Kaspar et al. 2020).

    Raises:
        ConfigError: When the ranges leave no free start.
    """
    low = np.array([-config.aside, -config.aside, config.height[0]])
    high = np.array([config.aside, config.aside, config.height[1]])
    for _ in range(1000):
        offset = rng.uniform(low, high)
        if is_clear(offset, fixture.quat_wxyz, config):
            yaw = own_yaw + rng.uniform(-config.turn, config.turn)
            return Pose(fixture.position + offset, tool_down(yaw))
    raise ConfigError(
        f"no start in free air among 1000 draws: aside {config.aside:g} m, "
        f"height {config.height[0]:g} to {config.height[1]:g} m, block half side "
        f"{config.fixture_half:g} m; widen aside or raise height"
    )
