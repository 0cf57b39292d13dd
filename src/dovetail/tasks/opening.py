"""Going straight into an opening: depth along its axis, distance from it."""

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, ClassVar

from dovetail.errors import ConfigError
from dovetail.poses import TOOL_DOWN, Pose, quat_multiply
from dovetail.settings import Range, in_range
from dovetail.tasks.task import Goal, Progress, Task, axis_of
from dovetail.types import Vec3

if TYPE_CHECKING:
    from dovetail.arms.arm import ArmState

CLEARANCE = Range(0.0, 0.010, "m")
"""Gap between held part and fixture on each side; 0.06 mm to 4 mm is tested."""


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
