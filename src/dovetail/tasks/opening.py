"""Going straight into an opening: depth along its axis, distance from it."""

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar

from dovetail.control.task_spec import AXES, HOLD, POSE, TaskSpec
from dovetail.errors import ConfigError
from dovetail.poses import TOOL_DOWN, Pose, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.task import Goal, Progress, Task, axis_of
from dovetail.types import Vec3

if TYPE_CHECKING:
    from dovetail.arms.arm import ArmState

CLEARANCE = Range(0.0, 0.010, "m")
"""Gap between held part and fixture on each side; 0.06 mm to 4 mm is tested."""

TILT = Range(0.0, 0.2, "rad")
"""Half range of a fixture's tilt about each of its axes x and y; 0.2 is tested."""
_TRIED_TILTS = (1.0, 0.0), (0.0, 1.0), (-0.7, -0.7)
"""Tilts B and C of the places where a policy is tried, as shares of the range."""


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
    that draw it. Above 0 B and C are pose axes and the policy sees `tilt` and
    `normal`: without it they are held where the episode starts."""

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
        if tilt > 0.0:
            self._let_tilt(tilt)

    def _let_tilt(self, tilt: float) -> None:
        """Let the tool turn to the fixture's tilt, show it, and try such fixtures."""
        shown = [name for name in ("tilt", "normal") if name not in self.columns]
        poses = self.trial_poses
        tilted = tuple(
            pose._replace(b=tilt * _TRIED_TILTS[i % 3][0], c=tilt * _TRIED_TILTS[i % 3][1])
            for i, pose in enumerate(poses)
        )
        object.__setattr__(self, "axes", with_tilt(self.axes))
        object.__setattr__(self, "columns", (*self.columns, *shown))
        object.__setattr__(self, "trial_poses", tilted)

    _depths: tuple[float, float]
    _lateral_max: float
    """Largest distance from the axis that is inside [m]."""

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
