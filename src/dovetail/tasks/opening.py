"""Going straight into an opening: depth along its axis, distance from it."""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from dovetail.control.task_spec import AXES, HOLD, POSE, TaskSpec
from dovetail.errors import ConfigError
from dovetail.poses import TOOL_DOWN, Pose, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.tasks.facing import Facing, FacingName, find_facing
from dovetail.tasks.fixture_pose import UPRIGHT, turned
from dovetail.tasks.task import Goal, Progress, Task, axis_of
from dovetail.types import Vec3

if TYPE_CHECKING:
    from dovetail.arms.arm import ArmState

CLEARANCE = Range(0.0, 0.010, "m")
"""Gap between held part and fixture on each side; 0.06 mm to 4 mm is tested."""

TILT = Range(0.0, 0.2, "rad")
"""Half range of a fixture's tilt about each of its axes x and y; 0.2 is tested."""
TRIED_TILTS = (1.0, 0.0), (0.0, 1.0), (-0.7, -0.7)
"""Tilts about its own x and y of the places where a policy is tried, as shares."""


def with_tilt(axes: str) -> str:
    """Return the mode of each axis with B and C to the goal where they were held.

    What is held stays as the episode began, and would not follow a fixture's tilt.
    """
    task = TaskSpec.parse(axes)
    tilting = [AXES.index("B"), AXES.index("C")]
    modes = (
        POSE if i in tilting and mode == HOLD else mode
        for i, mode in enumerate(task.modes)
    )
    return str(TaskSpec(tuple(modes)))


def widened_gap(clearance: float, widened: float) -> float:
    """Return a gap [m] that a twin made wider.

    Raises:
        ConfigError: It would be negative.
    """
    if clearance + widened < 0.0:
        raise ConfigError(
            f"clearance_offset {widened * 1e3:g} mm makes the clearance of "
            f"{clearance * 1e3:g} mm negative; allowed is "
            f"{-clearance * 1e3:g} mm and more"
        )
    return clearance + widened


class IntoOpening(Task):
    """A task that goes straight into an opening: down to its floor, tool against its z.

    The fixture's frame is in the middle of the opening's mouth, z out of it.
    """

    clearance: float
    """Gap between held part and fixture on each side [m]."""
    tilt: float = 0.0
    """Half range of the fixture's tilt about its own x and y [rad], a field of tasks
    that draw it."""
    facing: FacingName = "up"
    """Way that the fixture opens, a field of tasks that know others than upwards."""

    done_word: ClassVar[str] = "inserted"
    """The part is in the opening, deep enough."""

    @abstractmethod
    def depths(self) -> tuple[float, float]:
        """Return how deep the opening is, and which depth is done [m]."""

    def __post_init__(self) -> None:
        """Refuse a clearance that cannot be built, and note how deep is deep enough."""
        gap = in_range("clearance", self.clearance, CLEARANCE)
        object.__setattr__(self, "clearance", gap)
        object.__setattr__(self, "_depths", self.depths())
        object.__setattr__(self, "_lateral_max", gap * math.sqrt(2.0) + 0.002)
        tilt = float(in_range("tilt", self.tilt, TILT))
        object.__setattr__(self, "tilt", tilt)
        way = find_facing(self.facing)
        object.__setattr__(self, "_way", way)
        if tilt > 0.0 or self.facing != "up":
            self._let_turn(way)

    def _let_turn(self, way: Facing) -> None:
        """Let the tool turn to such fixtures, show the turn, and try them."""
        shown = [name for name in ("tilt", "mouth") if name not in self.columns]
        tilts = self.tilt * np.array(TRIED_TILTS)
        poses = tuple(
            way.place(pose, *map(float, tilts[i % len(tilts)]))
            for i, pose in enumerate(self.trial_poses)
        )
        made = {"axes": with_tilt(self.axes), "columns": (*self.columns, *shown)}
        made |= {"trial_poses": poses, "recording_pose": None}
        if self.facing != "up":
            made |= {"posture": way.posture, "walls": way.walls}
        for name, value in made.items():
            object.__setattr__(self, name, value)

    _depths: tuple[float, float]
    _lateral_max: float
    """Largest distance from the axis that is inside [m]."""
    _way: Facing

    def turned_fixture(self, rng: np.random.Generator, upright: Pose) -> Pose:
        """Return a fixture that was drawn upright, tilted and as it faces.

        Args:
            rng: Draws the tilt, if there is one.
            upright: Its pose if it opened upwards.
        """
        if self.tilt > 0.0:
            tilt = turned(UPRIGHT, 0.0, *rng.uniform(-self.tilt, self.tilt, 2))
            upright = upright._replace(quat_wxyz=quat_multiply(upright.quat_wxyz, tilt))
        if self.facing == "up":
            return upright
        return self._way.turned_out(upright, upright.position)

    def turned_start(self, fixture: Pose, draw: Callable[[Pose], Pose]) -> Pose:
        """Return a start beside a fixture, drawn as if that opened upwards.

        Args:
            fixture: Its pose.
            draw: Draws the tool's pose beside an upright one, which may be tilted.
        """
        if self.facing == "up":
            return draw(fixture)
        upright = self._way.turned_back(fixture)
        return self._way.turned_out(draw(upright), fixture.position)

    def goal(self, fixture: Pose) -> Goal:
        """Return the tool's pose with the held part on the opening's floor."""
        axis, (depth, _) = axis_of(fixture), self._depths
        return Goal(
            position=fixture.position - depth * axis,
            quat_wxyz=quat_multiply(fixture.quat_wxyz, TOOL_DOWN),
            normal=axis,
            surface=float(axis @ fixture.position),
        )

    def judge(self, error: Vec3, goal: Goal, state: "ArmState") -> Progress:
        """Return the depth of the held part's end below the mouth, and if it is in."""
        x, y, z = error.tolist()
        nx, ny, nz = goal.normal.tolist()
        height = x * nx + y * ny + z * nz  # above the floor
        lateral = math.sqrt(max(x * x + y * y + z * z - height * height, 0.0))
        depth, done = self._depths
        reached = depth - height
        return Progress(reached, reached >= done and lateral <= self._lateral_max)

    def places(self, fixture: Pose) -> dict[str, Vec3]:
        """Return the middle of the opening's mouth and of its floor [m]."""
        return {"mouth": fixture.position, "floor": self.goal(fixture).position}

    def heights(self) -> tuple[float, ...]:
        """Return the heights of the opening's mouth and floor over its mouth [m]."""
        return 0.0, -self._depths[0]

    def slack(self) -> float:
        """Return how far above the floor is deep enough [m]."""
        depth, done = self._depths
        return depth - done

    def gap(self) -> float:
        """Return the clearance [m]."""
        return self.clearance
