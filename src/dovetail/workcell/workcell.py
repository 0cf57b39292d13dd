"""A workcell: robot, tool, held part, fixture, table and the walls of the tool.

Frames: the robot's base is the world's origin and the table's top is z = 0, or where a
cell file says. The tool frame (TCP) lies at the end of the held part, z out of the
flange. The fixture's frame is where its task puts it; a task says in which pose of the
tool it is done.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import Pose, matrix_from_quat, quat_about_z
from dovetail.robots.robot import Payload, Robot
from dovetail.types import Vec3
from dovetail.workcell.parts import Part, Primitive, unit_inertia
from dovetail.workcell.reach import reach_of
from dovetail.workcell.tool import Tool

Walls = tuple[tuple[float, ...], tuple[float, ...]]
"""Lower and upper walls of the TCP [m], world axes."""

WALLS: Walls = (0.38, -0.22, 0.03), (0.82, 0.22, 0.30)
"""The usual walls, over the table in front of the robot."""
TABLE = Part(
    "table",
    (
        Primitive(
            "table",
            "box",
            (0.8, 0.8, 0.05),
            np.array([0.4, 0.0, -0.05]),
            rgba=(0.80, 0.78, 0.74, 1.0),
        ),
    ),
)
"""A table whose top is z = 0."""
_PLACE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START_MARGIN = 0.02
"""Distance of a start from the walls [m]: a tare leads the tool 7.5 mm, and the limits
slow it down before a wall. The shipped tasks' usual starts keep 21 mm."""
_INSIDE = 1e-9  # [m] of rounding that a fixture may be in the table


@dataclass(frozen=True, kw_only=True, eq=False)
class Workcell:
    """Everything that a plant needs to build a world, and a controller its payload."""

    name: str
    """Name of the cell, in words: two ends of a wire compare it."""
    robot: Robot
    """The bare arm."""
    tool: Tool
    """Tool on the flange."""
    held: Part
    """Part in the tool, in the TCP's frame: it ends at the origin, z points away."""
    make_fixture: Callable[[float], Part]
    """Builds the fixture, in its own frame, with every gap this much wider [m]."""
    heights: tuple[float, ...] = (0.0,)
    """Heights of the TCP over the fixture's frame, along its z, where it goes [m]."""
    walls: Walls = WALLS
    """Walls of the TCP."""
    place: Pose = _PLACE
    """The pose of a fixture that has not been placed."""
    own: str = ""
    """The content of its cell file, in words; empty without one."""
    table: Part = TABLE
    """The table, in the world's frame."""
    starts: Walls | None = None
    """Lower and upper corner of the box in which the TCP starts [m]; None is all that
    the walls allow."""
    widened_by: float = 0.0
    """Widening of the gaps beyond the task's [m]: a twin's difference."""

    @cached_property
    def fixture(self) -> Part:
        """The fixture in its own frame.

        Raises:
            ConfigError: The gaps would be negative.
        """
        return self.make_fixture(self.widened_by)

    def widened(self, offset: float) -> Self:
        """Return the cell with every gap between held part and fixture wider [m]."""
        cell = replace(self, widened_by=self.widened_by + offset)
        _ = cell.fixture  # refuses what cannot be
        return cell

    def tool_primitives(self) -> list[Primitive]:
        """Return tool and held part in the flange frame."""
        tcp = np.array([0.0, 0.0, self.tool.length])
        held = (part.moved(tcp, self.tool.rotation) for part in self.held.primitives)
        return [*self.tool.primitives, *held]

    def payload(self) -> Payload:
        """Return mass, centre and inertia of tool and part, in the flange frame."""
        parts = self.tool_primitives()
        total = sum(part.mass for part in parts)
        com: Vec3 = sum((p.mass * p.position for p in parts), start=np.zeros(3)) / total
        inertia = np.zeros((3, 3))
        for part in parts:
            d = part.position - com
            own = unit_inertia(part) + (d @ d) * np.eye(3) - np.outer(d, d)
            inertia += part.mass * own
        return Payload(mass=total, com=com, inertia=inertia)

    def loaded_robot(self, inertia: str | None = None) -> Robot:
        """Return the arm with tool and held part; its tool frame is the TCP.

        Args:
            inertia: Another of its published inertia sets.

        Raises:
            ConfigError: It has no such set.
        """
        if inertia is None:
            return self._loaded  # one object: what is computed of it is computed once
        return self._with_tool(self.robot.with_inertia(inertia))

    @cached_property
    def _loaded(self) -> Robot:
        return self._with_tool(self.robot)

    def _with_tool(self, robot: Robot) -> Robot:
        return robot.with_tool(
            self.payload(),
            tool_position=np.array([0.0, 0.0, self.tool.length]),
            tool_rotation=matrix_from_quat(self.tool.rotation),
        )

    def is_free(self, tip: Vec3, fixture: Pose, gap: float) -> bool:
        """Say whether the TCP is in free air, by the boxes around the parts.

        Args:
            tip: TCP, world axes [m].
            fixture: Where the fixture is.
            gap: Distance from it that is not free yet [m].
        """
        x, y, z = matrix_from_quat(fixture.quat_wxyz).T @ (tip - fixture.position)
        corners = self.fixture.corners
        if z >= float(corners[:, 2].max()) + gap:
            return True
        radius = float(np.hypot(*self.held.corners[:, :2].T).max())
        reach = float(np.abs(corners[:, :2]).max()) + radius + gap
        return max(abs(x), abs(y)) >= reach

    def require_reachable(self, fixture: Pose) -> None:
        """Check that the fixture stands over the table, and within the arm's reach.

        Raises:
            ConfigError: With how far it is out of reach [m].
        """
        top = float(self.table.corners[:, 2].max())
        inside = top - self.fixture.lowest(fixture)
        if inside > _INSIDE:
            z = float(fixture.position[2])
            raise ConfigError(
                f"{self.fixture.name} at z = {z:.4f} m would be {inside:.4f} m inside "
                f"the table: the lowest that it can be is {z + inside:.4f} m; raise it"
            )
        arm = reach_of(self._loaded)
        out = matrix_from_quat(fixture.quat_wxyz)[:, 2]
        for height in self.heights:
            wrist = fixture.position + (height + arm.above) * out
            distance = float(np.linalg.norm(wrist - arm.shoulder))
            excess = max(distance - arm.farthest, arm.nearest - distance) - arm.aside
            if excess > 0.0:
                at = np.round(fixture.position, 4).tolist()
                side = "too far" if distance > arm.nearest else "too near"
                raise ConfigError(
                    f"{self.fixture.name} at {at} m is {side} by {excess:.3f} m: the "
                    f"wrist would be {distance:.3f} m from the shoulder, with the "
                    f"tool of {self.tool.length:g} m at work {arm.nearest:.3f} to "
                    f"{arm.farthest:.3f} m can be reached; move it, or change the tool"
                )
