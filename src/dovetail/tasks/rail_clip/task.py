"""Clip a component on a rail: the second task, over the same arm."""

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from dovetail.poses import TOOL_DOWN, Pose, quat_about_z, quat_multiply
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.opening import IntoOpening, widened_gap
from dovetail.tasks.rail_clip.geometry import (
    DEPTH,
    LENGTH,
    SUCCESS_DEPTH,
    WIDTH,
    clip,
    rail,
)
from dovetail.tasks.region import Region
from dovetail.types import Vec3
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50
from dovetail.workcell.workcell import Walls

FACING_ROBOT = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
"""Rotation (wxyz) of a slot whose z axis points out of it towards the robot, -x."""


@dataclass(frozen=True, kw_only=True)
class ClipStarts:
    """Ranges of the slot and of the clip's start (uniform)."""

    middle: tuple[float, float, float] = (0.87, 0.0, 0.40)
    """Middle of the slot's mouth positions [m], world axes."""
    half_range: float = 0.03
    """Half range of the slot's mouth about it along each axis [m]."""
    distance: tuple[float, float] = (0.02, 0.10)
    """Range of the clip's distance in front of the slot [m]."""
    turn: float = 0.2
    """Half range of the clip's turn about the vertical at the start [rad]."""


@dataclass(frozen=True, kw_only=True)
class RailClip(IntoOpening):
    """Push a clip along X into a rail's slot that faces the robot, turning it about A.

    The tool is horizontal. The policy commands X as a force and A as a pose; Y, Z, B
    and C are held where the episode starts, on the slot's axis. The clip starts turned
    about the vertical, so it must be aligned before it goes in.
    """

    axes: str = "X:force A:pose YZBC:hold"
    """Mode of each axis."""
    clearance: float = 0.001
    """Gap between clip and slot on each side [m]."""
    randomisation: ClipStarts = field(default_factory=ClipStarts)
    """Ranges of starts and slots."""

    posture: ClassVar[str] = "forward"
    """Elbow up, tool forward."""
    walls: ClassVar[Walls] = (0.60, -0.15, 0.30), (0.95, 0.15, 0.50)
    """Lower and upper walls of the TCP [m], world axes."""
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.85, -0.02, 0.39, 0.0, FACING_ROBOT),
        FixturePose("B", 0.87, 0.02, 0.40, 0.0, FACING_ROBOT),
        FixturePose("C", 0.89, -0.005, 0.415, 0.0, FACING_ROBOT),
    )
    """Poses of the slot's mouth when a policy is tried; its axis is the world's -x."""
    trial_region: ClassVar[Region] = Region.about((0.87, 0.0, 0.40), (0.03,) * 3, 0.0)
    """The region from which a training draws its slots."""
    recording_pose: ClassVar[FixturePose] = FixturePose(
        "aside", 0.90, 0.0, 0.40, 0.0, FACING_ROBOT
    )
    """As far away as the tool goes: nearer to the robot joint 4 is at its limit."""

    def held(self) -> Part:
        """Return the clip; its end face is the TCP."""
        return clip()

    def tool(self) -> Tool:
        """Return the gripper about the clip."""
        return wsg50(opening=WIDTH, reach=LENGTH)

    def fixture(self, widened: float) -> Part:
        """Return the rail in the slot's frame.

        Raises:
            ConfigError: The clearance would be negative.
        """
        return rail(widened_gap(self.clearance, widened))

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the pose of the slot's mouth; its axis is the world's -x."""
        half = self.randomisation.half_range
        position = np.array(self.randomisation.middle) + rng.uniform(-half, half, 3)
        return Pose(position, np.array(FACING_ROBOT))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the clip's start in front of the slot, turned about the vertical."""
        ranges = self.randomisation
        distance = rng.uniform(*ranges.distance)
        turn = quat_about_z(rng.uniform(-ranges.turn, ranges.turn))
        aligned = quat_multiply(fixture.quat_wxyz, TOOL_DOWN)
        position = fixture.position + distance * np.array([-1.0, 0.0, 0.0])
        return Pose(position, quat_multiply(turn, aligned))

    def has_fixed_fixture(self) -> bool:
        """Return True if every slot that is drawn is the same."""
        return not self.randomisation.half_range

    def depths(self) -> tuple[float, float]:
        """Return how deep the opening is, and which depth is done [m]."""
        return DEPTH, SUCCESS_DEPTH

    def zero_offset(self) -> Vec3:
        """Return the mouth from the goal [m]: there millimetres decide."""
        return DEPTH * np.array([-1.0, 0.0, 0.0])

    def describe(self) -> list[str]:
        """Return the clearance in words."""
        return ["rail clip", f"{1e3 * self.clearance:g} mm clearance per side"]
