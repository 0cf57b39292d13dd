"""Gear mesh: put a gear on a shaft so that its teeth mesh with a gear beside it."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.settings import settings
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.gear_mesh.geometry import (
    DEPTH,
    REACH,
    SHAFT_RADIUS,
    STALK_RADIUS,
    SUCCESS_DEPTH,
    gear,
    station,
)
from dovetail.tasks.opening import IntoOpening
from dovetail.types import Vec3
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50


@settings()
class GearStarts:
    """Ranges of the shaft and of the gear's start (uniform)."""

    middle: tuple[float, float, float] = (0.58, 0.0, 0.10)
    """Middle of the positions of the shaft's end [m], world axes."""
    half_range: tuple[float, float, float] = (0.05, 0.05, 0.02)
    """Half range about it [m]."""
    yaw: float = 0.3
    """Half range of the station's turn about the vertical [rad]."""
    aside: float = 0.08
    """Half range of the gear's start beside the shaft, along world x and y [m]."""
    height: tuple[float, float] = (0.01, 0.10)
    """Range of its height over the shaft's end [m]."""
    turn: float = 0.2
    """Half range of its turn against the meshed one [rad]: more than half a tooth."""


@dataclass(frozen=True, kw_only=True)
class GearMesh(IntoOpening):
    """Put a gear on a shaft beside a gear that stands still, and let the teeth mesh.

    The bore finds the shaft first; 8 mm deeper the teeth meet, and go in where a tooth
    is turned to a gap. The fixture's frame is at the shaft's end, its x axis towards
    the standing gear.
    """

    axes: str = "XYZ:force A:pose BC:hold"
    """Mode of each axis."""
    clearance: float = 0.0002
    """Gap between bore and shaft on each side [m]."""
    randomisation: GearStarts = field(default_factory=GearStarts)
    """Ranges of starts and shafts."""

    done_word: ClassVar[str] = "meshed"
    """The gear lies on the shaft's shoulder, its teeth in the other's."""
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.54, -0.045, 0.085, -0.15),
        FixturePose("B", 0.58, 0.045, 0.10, 0.10),
        FixturePose("C", 0.62, -0.01, 0.115, 0.20),
    )
    """Poses of the shaft when a policy is tried."""
    recording_pose: ClassVar[FixturePose] = FixturePose("aside", 0.58, 0.0, 0.09, 0.0)
    """In the middle of the walls, and low."""

    def held(self) -> Part:
        """Return the gear; the middle of its lower face is the TCP."""
        return gear(self.clearance)

    def tool(self) -> Tool:
        """Return the gripper about the gear's stalk."""
        return wsg50(opening=2.0 * STALK_RADIUS, reach=REACH)

    def fixture(self, widened: float) -> Part:
        """Return plate, shaft and standing gear in the shaft's frame.

        Raises:
            ConfigError: The gap would be negative.
        """
        if self.clearance + widened < 0.0 or widened >= SHAFT_RADIUS:
            raise ConfigError(
                f"clearance_offset {1e3 * widened:g} mm with a clearance of "
                f"{1e3 * self.clearance:g} mm; allowed: {-1e3 * self.clearance:g} mm "
                f"to less than {1e3 * SHAFT_RADIUS:g} mm, the shaft's radius"
            )
        return station(widened)

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the pose of the shaft's end."""
        ranges = self.randomisation
        half = np.asarray(ranges.half_range)
        position = np.asarray(ranges.middle) + rng.uniform(-half, half)
        return Pose(position, quat_about_z(rng.uniform(-ranges.yaw, ranges.yaw)))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the gear's start over the shaft and beside it."""
        ranges, yaw = self.randomisation, self._yaw(fixture)
        low = np.array([-ranges.aside, -ranges.aside, ranges.height[0]])
        high = np.array([ranges.aside, ranges.aside, ranges.height[1]])
        offset = rng.uniform(low, high)
        turn = rng.uniform(-ranges.turn, ranges.turn)
        return Pose(fixture.position + offset, tool_down(yaw + turn))

    @staticmethod
    def _yaw(fixture: Pose) -> float:
        return 2.0 * math.atan2(fixture.quat_wxyz[3], fixture.quat_wxyz[0])

    def has_fixed_fixture(self) -> bool:
        """Return True if every shaft that is drawn is the same."""
        ranges = self.randomisation
        return not any((*ranges.half_range, ranges.yaw))

    def depths(self) -> tuple[float, float]:
        """Return how deep the gear goes, and which depth is done [m]."""
        return DEPTH, SUCCESS_DEPTH

    def zero_offset(self) -> Vec3:
        """Return the shaft's end from the goal [m]: there millimetres decide."""
        return DEPTH * np.array([0.0, 0.0, 1.0])

    def describe(self) -> list[str]:
        """Return the clearance in words."""
        return ["gear mesh", f"{1e3 * self.clearance:g} mm clearance per side"]
