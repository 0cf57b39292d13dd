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
from dovetail.poses import UNMOVED, Pose, matrix_from_quat, quat_about_z
from dovetail.robots.robot import Payload, Robot
from dovetail.types import Array, Vec3
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, Part, Primitive, mass_centre_inertia
from dovetail.workcell.reach import reach_of
from dovetail.workcell.tool import Tool

Fixtures = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
"""Lower and upper corner of a box of fixtures [m], and their range of turn [rad]."""
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
    fixtures: Fixtures | None = None
    """Region of the fixtures; None is where their task draws them."""
    note: str = ""
    """Difference from the task's own places, in words, where the arm is too short."""
    widened_by: float = 0.0
    """Widening of the gaps beyond the task's [m]: a twin's difference."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about the robot, and about where its fixtures are."""
        return (*self.robot.all_notes, *filter(None, [self.note]))

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

    @property
    def tool_frame(self) -> Pose:
        """The TCP's frame in the flange frame."""
        return Pose(np.array([0.0, 0.0, self.tool.length]), self.tool.rotation)

    def tool_primitives(self, grasp: Pose = UNMOVED) -> list[Primitive]:
        """Return tool and held part in the flange frame, without what moves on it.

        Args:
            grasp: The held part's frame in the TCP's: it may have slipped.
        """
        return [*self.tool.primitives, *self.held_primitives(grasp)]

    def held_primitives(self, grasp: Pose = UNMOVED) -> list[Primitive]:
        """Return the held part in the flange frame; see `tool_primitives`."""
        shapes = self.held.primitives
        if grasp is not UNMOVED:
            shapes = tuple(shape.moved(*grasp) for shape in shapes)
        return [shape.moved(*self.tool_frame) for shape in shapes]

    def held_moving(self, grasp: Pose = UNMOVED) -> list[Moving]:
        """Return what moves on the held part, in the flange frame; see above."""
        pieces = self.held.moving
        if grasp is not UNMOVED:
            pieces = tuple(piece.moved(*grasp) for piece in pieces)
        return [piece.moved(*self.tool_frame) for piece in pieces]

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the parts, each in its part's frame: the held part's come first.

        Raises:
            ConfigError: Two have one name.
        """
        names = [piece.joint.name for piece in self.moving()]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ConfigError(
                f"{self.held.name} and {self.fixture.name} both have a joint "
                f"{twice[0]!r}; rename one of them"
            )
        return tuple(piece.joint for piece in self.moving())

    def meshes(self) -> list[Primitive]:
        """Return the shapes that engines build as convex meshes, those of tool too."""
        shapes = [*self.tool_primitives(), *self.fixture.primitives]
        shapes += [shape for piece in self.moving() for shape in piece.primitives]
        return [shape for shape in shapes if shape.kind in ("prism", "convex")]

    def moving(self) -> tuple[Moving, ...]:
        """Return what moves, in the order of `joints`, each in its part's frame."""
        return (*self.held.moving, *self.fixture.moving)

    @property
    def joint_starts(self) -> Array:
        """Positions of the parts' joints after a reset [rad, m]."""
        return np.array([joint.start for joint in self.joints], dtype=float)

    def payload(self) -> Payload:
        """Return mass, centre and inertia of tool and part, in the flange frame.

        What moves on the part counts where it starts.
        """
        shapes = self.tool_primitives()
        for piece in self.held_moving():
            shapes += piece.at(piece.joint.start)
        return _payload(shapes)

    def loaded_robot(self, inertia: str | None = None) -> Robot:
        """Return the arm with tool and held part; its tool frame is the TCP.

        Args:
            inertia: Another of its published inertia sets.

        Raises:
            ConfigError: It has no such set.
        """
        if inertia is None:
            return self._loaded  # one object: what is computed of it is computed once
        return self._with_tool(self.robot.with_inertia(inertia), self.payload())

    def rigid_robot(self, inertia: str) -> Robot:
        """Return the arm with what does not move on it: an engine's last link.

        Args:
            inertia: One of its published inertia sets.

        Raises:
            ConfigError: It has no such set.
        """
        robot = self.robot.with_inertia(inertia)
        return self._with_tool(robot, _payload(self.tool_primitives()))

    @cached_property
    def _loaded(self) -> Robot:
        return self._with_tool(self.robot, self.payload())

    def _with_tool(self, robot: Robot, payload: Payload) -> Robot:
        return robot.with_tool(
            payload,
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
        for distance in self._wrist_distances(fixture):
            if (excess := arm.excess(distance)) > 0.0:
                at = np.round(fixture.position, 4).tolist()
                is_far = distance > arm.nearest
                side = "too far" if is_far else "too near"
                held = "" if is_far else ": joint A4 would be past its limit"
                raise ConfigError(
                    f"{self.fixture.name} at {at} m is {side} by {excess:.3f} m: the "
                    f"wrist would be {distance:.3f} m from the shoulder, with the "
                    f"tool of {self.tool.length:g} m at work {arm.nearest:.3f} to "
                    f"{arm.farthest:.3f} m can be reached{held}; move it, or change "
                    "the tool"
                )

    def out_of_reach(self, fixture: Pose) -> float:
        """Return how far a fixture is out of reach [m]; below 0 is room to spare."""
        arm = reach_of(self._loaded)
        return max(arm.excess(d) for d in self._wrist_distances(fixture))

    def _wrist_distances(self, fixture: Pose) -> list[float]:
        """Return the distances of the wrist from the shoulder there, by height [m]."""
        arm = reach_of(self._loaded)
        out = matrix_from_quat(fixture.quat_wxyz)[:, 2]
        wrists = (fixture.position + (h + arm.above) * out for h in self.heights)
        return [float(np.linalg.norm(wrist - arm.shoulder)) for wrist in wrists]


def _payload(shapes: list[Primitive]) -> Payload:
    mass, com, inertia = mass_centre_inertia(shapes)
    return Payload(mass=mass, com=com, inertia=inertia)
