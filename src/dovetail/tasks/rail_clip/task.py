"""Rail clip: hook a component over one lip of a DIN rail, and snap it on the other."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from dovetail.poses import (
    TOOL_DOWN,
    Pose,
    quat_about_z,
    quat_multiply,
    theta_about_vertical,
)
from dovetail.tasks.facing import FACINGS
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.rail_clip.din_rail import (
    OVERLAP,
    component,
    rail,
)
from dovetail.tasks.rail_clip.way import left_on_the_way
from dovetail.tasks.region import Region
from dovetail.tasks.task import Goal, Progress, Task, axis_of
from dovetail.types import Vec3
from dovetail.workcell.parts import Part
from dovetail.workcell.workcell import Walls

if TYPE_CHECKING:
    from dovetail.arms.arm import ArmState

_WALL = FACINGS["robot"]
_SEATED, _ASIDE, _TURNED = 0.00075, 0.0015, 0.03  # m, m, rad
_SNAPPED = 0.25 * OVERLAP  # m, of the latch from its rest


@dataclass(frozen=True, kw_only=True)
class ClipStarts:
    """Ranges of the rail and of the component's start (uniform)."""

    middle: tuple[float, float, float] = _WALL.middle
    """Middle of the rail's places [m], world axes."""
    half_range: float = 0.02
    """Half range of the rail's place about it along each axis [m]."""
    distance: tuple[float, float] = (0.015, 0.05)
    """Range of the component's distance in front of the rail [m]."""
    aside: float = 0.008
    """Half range of its start along Y [m]."""
    turn: float = 0.2
    """Half range of its turn about the vertical at the start [rad]."""


@dataclass(frozen=True, kw_only=True)
class RailClip(Task):
    """Hook a component over one lip of a DIN rail, turn it and push until it snaps.

    The tool is level and the rail upright, so that the motion is in the plane of X and
    Y. Z, B and C are held where the episode starts. The hook goes over the lip at
    positive Y, the latch snaps behind the other.
    """

    axes: str = "XY:force A:pose ZBC:hold"
    """Mode of each axis."""
    randomisation: ClipStarts = field(default_factory=ClipStarts)
    """Ranges of starts and rails."""

    done_word: ClassVar[str] = "clipped on"
    training: ClassVar[Mapping[str, Any]] = {"theta_range": 0.3, "f_scale": (1.5,)}
    """With a smaller turn the hook does not go behind its lip. With the usual force it
    learns after three times as many steps, and pulls at its hook."""
    posture: ClassVar[str] = _WALL.posture
    walls: ClassVar[Walls] = _WALL.walls
    trial_poses: ClassVar[tuple[FixturePose, ...]] = (
        FixturePose("A", 0.855, -0.015, 0.39, 0.0, _WALL.quat_wxyz),
        FixturePose("B", 0.87, 0.015, 0.40, 0.0, _WALL.quat_wxyz),
        FixturePose("C", 0.885, -0.005, 0.41, 0.0, _WALL.quat_wxyz),
    )
    """Poses of the rail when a policy is tried; its axis is the world's -x."""
    trial_region: ClassVar[Region] = Region.about(_WALL.middle, (0.02,) * 3, 0.0)
    """The region from which a training draws its rails."""
    recording_pose: ClassVar[FixturePose] = FixturePose(
        "aside", 0.90, 0.0, 0.40, 0.0, _WALL.quat_wxyz
    )
    """As far away as the tool goes: nearer to the robot joint 4 is at its limit."""

    def held(self) -> Part:
        """Return the component; the TCP is in the middle of its face."""
        return component()

    def fixture(self, widened: float) -> Part:
        """Return the rail, the same on every twin: the play is the component's."""
        return rail()

    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the place of the rail's front; its axis is the world's -x."""
        half = self.randomisation.half_range
        position = np.array(self.randomisation.middle) + rng.uniform(-half, half, 3)
        return Pose(position, np.array(_WALL.quat_wxyz))

    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the start in front of the rail, beside its middle and turned."""
        ranges = self.randomisation
        distance = rng.uniform(*ranges.distance)
        aside = rng.uniform(-ranges.aside, ranges.aside)
        turn = quat_about_z(rng.uniform(-ranges.turn, ranges.turn))
        aligned = quat_multiply(fixture.quat_wxyz, TOOL_DOWN)
        position = fixture.position + np.array([-distance, aside, 0.0])
        return Pose(position, quat_multiply(turn, aligned))

    def has_fixed_fixture(self) -> bool:
        """Return True if every rail that is drawn is the same."""
        return not self.randomisation.half_range

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

        It is on when it is seated, straight, and the latch has snapped behind its lip.
        Only a simulation knows the latch; by the pose alone it can be nowhere else.
        """
        height = float(error @ goal.normal)
        aside = math.hypot(*(error - height * goal.normal))
        turn = theta_about_vertical(state.tool.quat_wxyz, goal.quat_wxyz)
        is_seated = abs(height) < _SEATED and aside < _ASIDE and abs(turn) < _TURNED
        is_in = not len(state.parts) or float(state.parts[0]) < _SNAPPED
        return Progress(-height, is_seated and is_in)

    def weigh(
        self, position_error: Vec3, theta_error: float, success: bool, force: float
    ) -> float:
        """Return the reward of one policy step, by what is left of the way.

        The goal's distance leads the hook onto the lip's front, and no further. World
        axes are the rail's where it faces the robot, as the task's own do.
        """
        left, turn = left_on_the_way(position_error, theta_error)
        return super().weigh(left, turn, success, force)

    def slack(self) -> float:
        """Return how far in front of the rail is still success [m]."""
        return _SEATED

    def describe(self) -> list[str]:
        """Return the task in words."""
        return ["component on a DIN rail"]
