"""Hook a component over one lip of a DIN rail, and snap it behind the other."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from dovetail.poses import (
    TOOL_DOWN,
    Pose,
    quat_about_z,
    quat_multiply,
    theta_about_vertical,
)
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.rail_clip.din_rail import OVERLAP, component, rail
from dovetail.tasks.rail_clip.task import FACING_ROBOT
from dovetail.tasks.task import Goal, Progress, Task, axis_of
from dovetail.types import Vec3
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50
from dovetail.workcell.workcell import Walls

if TYPE_CHECKING:
    from dovetail.arms.arm import ArmState

_SEATED, _ASIDE, _TURNED = 0.0007, 0.0015, 0.03  # m, m, rad


@dataclass(frozen=True, kw_only=True)
class SnapOnRail(Task):
    """Hook the component over one lip, turn it about A and push until it snaps.

    The tool is horizontal and the rail upright, so that the motion is in the plane of
    X and Y. Z, B and C are held where the episode starts.
    """

    axes: str = "XY:force A:pose ZBC:hold"
    """Mode of each axis."""
    half_range: float = 0.02
    """Half range of the rail's place along each axis [m]."""
    distance: tuple[float, float] = (0.015, 0.05)
    """Range of the component's distance in front of the rail at the start [m]."""
    aside: float = 0.008
    """Half range of its start along Y [m]."""
    turn: float = 0.2
    """Half range of its turn about the vertical at the start [rad]."""

    done_word: ClassVar[str] = "clipped"
    posture: ClassVar[str] = "forward"
    walls: ClassVar[Walls] = (0.60, -0.15, 0.30), (0.95, 0.15, 0.50)
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.85, -0.015, 0.39, 0.0, FACING_ROBOT),
        FixturePose("B", 0.87, 0.015, 0.40, 0.0, FACING_ROBOT),
        FixturePose("C", 0.89, -0.005, 0.41, 0.0, FACING_ROBOT),
    )

    def held(self) -> Part:
        """Return the component; the TCP is in the middle of its face."""
        return component()

    def tool(self) -> Tool:
        """Return the gripper about the component's end."""
        return wsg50(opening=0.030, reach=0.075)

    def fixture(self, widened: float) -> Part:
        """Return the rail, the same on every twin: its play is the component's."""
        return rail()

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the place of the rail's front; its axis is the world's -x."""
        offset = rng.uniform(-self.half_range, self.half_range, 3)
        return Pose(np.array([0.87, 0.0, 0.40]) + offset, np.array(FACING_ROBOT))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the start in front of the rail, beside it and turned."""
        distance = rng.uniform(*self.distance)
        aside = rng.uniform(-self.aside, self.aside)
        turn = quat_about_z(rng.uniform(-self.turn, self.turn))
        aligned = quat_multiply(fixture.quat_wxyz, TOOL_DOWN)
        position = fixture.position + np.array([-distance, aside, 0.0])
        return Pose(position, quat_multiply(turn, aligned))

    def goal(self, fixture: Pose) -> Goal:
        """Return the tool's pose with the component's face on the rail's front."""
        axis = axis_of(fixture)
        return Goal(
            position=fixture.position,
            quat_wxyz=quat_multiply(fixture.quat_wxyz, TOOL_DOWN),
            normal=axis,
            surface=float(axis @ fixture.position),
        )

    def judge(self, error: Vec3, goal: Goal, state: "ArmState") -> Progress:
        """Return the depth of the face below the rail's front, and if it is on.

        Where the latch's position is known it must be behind the lip. By the pose
        alone it is: seated and straight, it cannot be pushed aside.
        """
        height = float(error @ goal.normal)
        aside = math.hypot(*(error - height * goal.normal))
        turn = theta_about_vertical(state.tool.quat_wxyz, goal.quat_wxyz)
        is_seated = abs(height) < _SEATED and aside < _ASIDE and abs(turn) < _TURNED
        is_in = not len(state.parts) or float(state.parts[0]) < 0.5 * OVERLAP
        return Progress(-height, is_seated and is_in)

    def slack(self) -> float:
        """Return how far in front of the rail is still success [m]."""
        return _SEATED

    def describe(self) -> list[str]:
        """Return the task in words."""
        return ["component on a DIN rail"]
