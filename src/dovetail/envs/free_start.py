"""Check that a start is in free air: depth of the tool in the things around it."""

from typing import Any, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.plants.mjcf import build_mjcf, model_positions
from dovetail.plants.plant import require_configuration
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.types import Vec7
from dovetail.workcell.workcell import START_MARGIN, Walls, Workcell

OVERLAP_MAX = 0.0002
"""Depth up to which a start counts as free air [m]: what touches is not in the way."""


class Overlap(NamedTuple):
    """The deepest overlap of the tool with fixture or table."""

    depth: float
    """[m]; 0 in free air."""
    part: str = ""
    """Part of the tool, or what it holds."""
    other: str = ""
    """Part of the fixture, or the table, that it lies in."""


class StartError(ConfigError):
    """No episode can start here: out of reach, behind a wall, or in something."""


class OverlapError(StartError):
    """A start lies inside the fixture or the table."""

    def __init__(self, found: Overlap, advice: str) -> None:
        """Word the error; `overlap` keeps its numbers."""
        self.overlap = found
        super().__init__(
            f"the start is inside the cell: {found.part} lies {1e3 * found.depth:.1f} "
            f"mm deep in {found.other}, allowed: {1e3 * OVERLAP_MAX:g} mm; {advice}"
        )


class StartCheck:
    """The cell's shapes alone, of any arm: no start may lie in what stands there."""

    def __init__(self, cell: Workcell) -> None:
        """Build the shapes."""
        import mujoco

        self._mujoco: Any = mujoco
        text = build_mjcf(cell.loaded_robot(), cell)
        self._model = self._mujoco.MjModel.from_xml_string(text)
        self._data = self._mujoco.MjData(self._model)
        self._fixture = self._model.body("fixture").id
        self._name = cell.fixture.name
        self._joints, self._parts = cell.joints, cell.joint_starts

    def overlap(self, q: Vec7, fixture: Pose) -> Overlap:
        """Return how deep the tool is in something.

        Args:
            q: Configuration [rad].
            fixture: Where the fixture is.

        Raises:
            ConfigError: q is not seven finite numbers.
        """
        model, data = self._model, self._data
        q = require_configuration(q)
        data.qpos[:] = model_positions(q, self._joints, self._parts)
        data.mocap_pos[0], data.mocap_quat[0] = fixture
        self._mujoco.mj_kinematics(model, data)
        self._mujoco.mj_comPos(model, data)
        self._mujoco.mj_collision(model, data)
        if not data.ncon:
            return Overlap(0.0)
        deepest = int(np.argmin(data.contact.dist[: data.ncon]))
        both = [model.geom(int(i)) for i in data.contact.geom[deepest]]
        tool, other = sorted(both, key=lambda geom: -int(geom.contype[0]))
        where = other.name
        if int(other.bodyid[0]) == self._fixture:
            where = f"{where} of the {self._name}"
        return Overlap(max(0.0, -float(data.contact.dist[deepest])), tool.name, where)

    def require_free(self, q: Vec7, fixture: Pose) -> None:
        """Refuse a start that lies in something.

        Raises:
            OverlapError: Says what is in what, and how deep.
        """
        if (found := self.overlap(q, fixture)).depth > OVERLAP_MAX:
            raise OverlapError(found, "give another start, higher above the fixture")


def require_within(start: Pose, walls: Walls, starts: Walls | None = None) -> None:
    """Refuse a start so near to a wall that the tool could not be led from it.

    Args:
        start: The tool's pose.
        walls: Lowest and highest position of the tool [m].
        starts: Box in which the tool starts [m]; None is all that the walls allow.

    Raises:
        StartError: Names the axis, the position and what is allowed.
    """
    if starts is not None:
        for name, at, low, high in zip("xyz", start.position, *starts, strict=True):
            if not low <= at <= high:
                raise StartError(
                    f"the start has {name} = {at:.4f} m; the cell's start_low and "
                    f"start_high allow {low:g} to {high:g} m"
                )
    for name, at, low, high in zip("xyz", start.position, *walls, strict=True):
        if not low + START_MARGIN <= at <= high - START_MARGIN:
            raise StartError(
                f"the start has {name} = {at:.4f} m; allowed between the walls: "
                f"{low + START_MARGIN:g} to {high - START_MARGIN:g} m"
            )


def require_room(q: Vec7, robot: Robot, margin: float) -> None:
    """Refuse a configuration so near to a joint's limit that the limits hold the arm.

    Args:
        q: Configuration [rad].
        robot: Its joint limits.
        margin: Margin of the limits before them [rad].

    Raises:
        StartError: Names the joint, its angle and what is allowed.
    """
    low, high = robot.limits.q_min + margin, robot.limits.q_max - margin
    excess = np.maximum(low - q, q - high)
    if excess.max() > 0.0:
        i = int(excess.argmax())
        raise StartError(
            f"at the start, or 7.5 mm from it where a tare leads the tool, joint "
            f"{i + 1} is at {q[i]:.3f} rad; the limits leave {low[i]:.3f} to "
            f"{high[i]:.3f} rad"
        )
