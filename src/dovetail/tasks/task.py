"""Contract of a task: held part, fixture, goal, success and reward.

A task knows no arm, no engine and no policy. `ContactEnv` runs it on any arm.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat
from dovetail.robots.robot import Robot
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.grasp import Grasp
from dovetail.tasks.region import Region
from dovetail.tasks.reward import RewardConfig, distance_reward
from dovetail.tasks.suited_robot import suited
from dovetail.tasks.within_reach import within_reach
from dovetail.types import Array, Vec3, Vec4
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.parts import Part
from dovetail.workcell.tool import Tool, wsg50
from dovetail.workcell.workcell import WALLS, Walls, Workcell

if TYPE_CHECKING:
    from dovetail.arms.arm import ArmState


class Goal(NamedTuple):
    """Goal of the tool for a fixture at a pose, world axes."""

    position: Vec3
    """TCP when done [m]."""
    quat_wxyz: Vec4
    """Its rotation when done."""
    normal: Vec3
    """Out of the fixture, unit length: contact is near below its surface."""
    surface: float
    """Position of that surface along the normal [m]."""

    def depth(self) -> float:
        """Return how far below the surface the goal is, along the normal [m]."""
        return self.surface - float(self.normal @ self.position)


class Progress(NamedTuple):
    """Progress of the task, by the fixture's true pose."""

    depth: float
    """Depth of the tool in the fixture [m], as the task defines it."""
    success: bool
    """True when the task is done."""


class Outline(NamedTuple):
    """Outline of a fixture's opening, or of its post, in its own frame [m]."""

    opening: Array
    """Closed line seen from above, shape (points, 2)."""
    outer: float
    """Half side of the square around the fixture."""
    depth: float
    """Depth of the held part's end below z = 0 when the task is done."""
    is_straight: bool = True
    """True if the opening is the same from mouth to floor: no step is inside."""
    is_post: bool = False
    """True if the line is that of a post, and the held part goes over it."""
    corner: Array | None = None
    """Corner of the line at which walls stop a part, x y [m]; None is the farthest from
    the middle."""
    is_pin: bool = False
    """True if the line is the opening of one of several pins: by it, all are led."""
    is_divided: bool = False
    """True if walls stand inside the line: no corner falls in everywhere."""


@dataclass(frozen=True, kw_only=True)
class Task(ABC):
    """The contract. A task is a frozen dataclass; its fields are its settings.

    The fixture's frame is its task's choice: z points out of it, to where the tool
    comes from. Methods draw from the generator they are given, and from nothing else.
    """

    axes: str
    """Mode of each axis: force, pose, hold or free, as `TaskSpec` reads it."""
    reward: RewardConfig = field(default_factory=RewardConfig)
    """Weights of the reward."""

    done_word: ClassVar[str] = "succeeded"
    """Word for a successful try in tables and figures, such as "inserted"."""
    posture: ClassVar[str] = "down"
    """The robot's posture in which inverse kinematics starts: down or forward."""
    walls: ClassVar[Walls] = WALLS
    """Lower and upper walls of the TCP [m], world axes."""
    columns: ClassVar[tuple[str, ...]] = ("joints", "position", "theta", "velocity")
    """Groups of numbers that a policy sees, see `envs.observation`."""
    trial_poses: ClassVar[tuple[FixturePose, ...]]
    """Poses of the fixture when a policy is tried; a place that a user gives takes the
    facing of the first one."""
    training: ClassVar[Mapping[str, Any]] = {}
    """Settings of `dovetail train`, and of its environment, that this task needs beside
    the usual ones; what is given goes before them."""
    grasp: ClassVar[Grasp] = Grasp()
    """Largest displacement of the held part in the fingers."""
    recording_pose: ClassVar[FixturePose | None] = None
    """Pose of the fixture while an arm is identified; None is the first trial pose."""
    zero_at: ClassVar[str] = ""
    """Name of the place at `zero_offset`, if a policy holds for any other height of it
    over the goal: then tasks differ in that alone, as deep and shallow openings do."""
    trial_region: ClassVar[Region | None] = None
    """Region in which the trial poses lie; None is the smallest one that holds them.
    Where a cell file gives a region of its own, they lie in it in the same way."""

    @abstractmethod
    def held(self) -> Part:
        """Return the part in the tool, in the TCP's frame: z points out of the tool."""

    @abstractmethod
    def fixture(self, widened: float) -> Part:
        """Return the fixture in its own frame.

        Args:
            widened: How much wider than the task says every gap is [m]: a twin's.

        Raises:
            ConfigError: The gap would be negative.
        """

    @abstractmethod
    def draw_fixture(self, rng: np.random.Generator) -> Pose:
        """Draw the fixture's true pose for an episode."""

    @abstractmethod
    def draw_start(self, rng: np.random.Generator, fixture: Pose) -> Pose:
        """Draw the tool's pose at the start of an episode, in free air."""

    @abstractmethod
    def goal(self, fixture: Pose) -> Goal:
        """Return what a fixture at this pose asks of the tool."""

    @abstractmethod
    def judge(self, error: Vec3, goal: Goal, state: "ArmState") -> Progress:
        """Say how far the task is.

        Args:
            error: TCP minus the goal's position [m], world axes, shape (3,).
            goal: Of the fixture's true pose.
            state: Measured state of the arm.
        """

    def draw_in(self, rng: np.random.Generator, region: Region) -> Pose:
        """Draw the fixture's true pose in the region of a cell file."""
        return region.draw(rng, self.trial_poses[0].facing)

    def tool(self) -> Tool:
        """Return what holds the part; the fingers are 30 mm apart."""
        return wsg50(opening=0.030, reach=-float(self.held().corners[:, 2].min()))

    def has_fixed_fixture(self) -> bool:
        """Return True if every pose that `draw_fixture` gives is the same."""
        return False

    def zero_offset(self) -> Vec3:
        """Return where the scaled position is 0, minus the goal [m], world axes.

        There a policy tells millimetres apart. It is the same for every fixture.
        """
        return np.zeros(3)

    def places(self, fixture: Pose) -> dict[str, Vec3]:
        """Return the points [m] that the tool must be able to go to, by name."""
        return {"place": fixture.position, "goal": self.goal(fixture).position}

    def heights(self) -> tuple[float, ...]:
        """Return the heights of the TCP that are gone to, along the fixture's z [m].

        A fixture where the arm does not reach them is refused.
        """
        return (0.0,)

    def slack(self) -> float:
        """Return how far short of the goal is still success [m]."""
        return 0.0

    def counted(self, error: Vec3, goal: Goal) -> Vec3:
        """Return the error that the reward counts, usually as it is.

        Args:
            error: TCP minus the goal's position [m], world axes, shape (3,).
            goal: Of the fixture's true pose.
        """
        del goal
        return error

    def weigh(
        self, position_error: Vec3, theta_error: float, success: bool, force: float
    ) -> float:
        """Return the reward of one policy step.

        Args:
            position_error: TCP minus the goal of the fixture's true pose [m], shape
                (3,), as `counted` returned it.
            theta_error: Rotation about the vertical minus the goal's [rad]; if `tilt`
                is among the task's columns, the whole angle between the two.
            success: True if the task is done in this step.
            force: Largest contact force of the step [N].
        """
        return distance_reward(position_error, theta_error, success, self.reward, force)

    def describe(self) -> list[str]:
        """Return the task in words, for titles and for comparing two ends of a wire."""
        return [type(self).__name__]

    def gap(self) -> float | None:
        """Return the gap between held part and fixture on each side [m], if any."""
        return None

    @classmethod
    def whole(
        cls, options: Mapping[str, Any], *, may_read: bool = True
    ) -> dict[str, Any]:
        """Return options of the task that name no other file, for a policy to carry.

        Args:
            options: By name.
            may_read: Read the files that options name; False refuses them: the options
                are of a file that may be a stranger's.

        Raises:
            ConfigError: A file cannot be read, or must not be.
        """
        del may_read
        return dict(options)

    @classmethod
    def listed(cls, name: str, text: str) -> list[str]:
        """Return the values of an option that a text lists, as A,B.

        Args:
            name: Of the option.
            text: The list.

        Raises:
            ConfigError: It lists nothing.
        """
        del name
        return text.split(",")

    @classmethod
    def low_starts(cls) -> dict[str, Any]:
        """Return the settings with which starts lie below the fixture's surface.

        Empty: the task has none.
        """
        return {}

    def outline(self) -> Outline | None:
        """Return the fixture's opening, or None if it is not searched by touch."""
        return None

    def workcell(self, robot: Robot, cell: CellConfig | None = None) -> Workcell:
        """Return the cell in which a robot does this task.

        Args:
            robot: The bare arm. One without a posture gets that of the task, and one
                that says nothing of a gripper what it can brake with.
            cell: Facts of a cell file in the place of the task's own.

        Raises:
            ConfigError: The cell's facts exclude each other, or this task.
            TorqueError: The arm is too weak for any tool.
        """
        return self.cell_of(suited(robot, self, cell), cell)

    def cell_of(self, robot: Robot, cell: CellConfig | None) -> Workcell:
        """Return the cell of a robot as it is; see `workcell`."""
        usual = Workcell(
            name=", ".join(self.describe()),
            robot=robot,
            tool=self.tool().held_by(robot.gripper),
            held=self.held(),
            make_fixture=self.fixture,
            heights=self.heights(),
            walls=self.walls,
        )
        fitted = usual if cell is None else cell.fit(usual)
        if fitted.fixtures is None:
            fitted = within_reach(
                fitted,
                self._usual_region,
                self.trial_poses,
                moves_walls=cell is None or not cell.gives_walls,
            )
        if cell is not None:
            self.require_region(fitted)
        return fitted

    def require_region(self, fitted: Workcell, margin: float = 0.005) -> None:
        """Refuse a cell that keeps the task from where it is tried.

        Args:
            fitted: Table, tool, walls, and the region of fixtures, if it has one.
            margin: Least distance of a place from the walls [m].

        Raises:
            ConfigError: Names the key, the place and what to write.
        """
        region = Region.of(fitted)
        if region is None:
            keys = (
                "the task's own fixtures (give fixture_low, fixture_high, fixture_yaw)"
            )
            poses = [place.pose() for place in self.trial_poses]
        else:
            keys = "fixture_low to fixture_high"
            poses = region.corners(self.trial_poses[0].facing)
        low, high = (np.array(wall) for wall in fitted.walls)
        for pose in poses:
            try:
                fitted.require_reachable(pose)
            except ConfigError as error:
                raise ConfigError(f"cell: {keys}: {error}") from error
            for name, point in self.places(pose).items():
                excess = np.maximum(low - point, point - high) + margin
                i = int(excess.argmax())
                if excess[i] > 1e-9:
                    raise ConfigError(
                        f"cell: {keys}: the {fitted.fixture.name}'s {name} is at "
                        f"{'xyz'[i]} = {point[i]:.4f} m, the walls allow "
                        f"{low[i] + margin:g} to {high[i] - margin:g} m: move the "
                        "fixtures, or walls_low and walls_high",
                        name=f"walls_low[{'xyz'[i]}]",
                        value=float(point[i]),
                        unit="m",
                    )

    def trial_poses_in(self, cell: Workcell) -> tuple[FixturePose, ...]:
        """Return the poses of the fixture when a policy is tried in a cell."""
        return tuple(self.placed_in(cell, pose) for pose in self.trial_poses)

    def placed_in(self, cell: Workcell, place: FixturePose) -> FixturePose:
        """Return one of the task's places as it lies in the region of a cell."""
        if (region := Region.of(cell)) is None:
            return place
        return region.carry(place, self._usual_region)

    @property
    def _usual_region(self) -> Region:
        return self.trial_region or Region.around(self.trial_poses)


def axis_of(fixture: Pose) -> Vec3:
    """Return the fixture's z in world axes, unit length."""
    return matrix_from_quat(fixture.quat_wxyz)[:, 2]
