"""Teleoperation of the tool: with the gizmo at it, or with a 3D mouse.

The gizmo goes first. After a stop, both have to be let go before they lead again.
"""

import math

import numpy as np
from numpy.typing import NDArray

from dovetail.cockpit.space_mouse import SpaceMouse
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.teleop import GAIN, LEAD_SPEED, action_towards, resting_action
from dovetail.errors import ConfigError
from dovetail.poses import Pose, quat_from_vector, quat_multiply, quat_normalized
from dovetail.types import Vec3, Vec4

TURN_RATE = 0.5
"""Turning speed of the tool with a 3D mouse at full deflection [rad/s]."""
_FAR = 100.0  # [m] limit of a pose that the tool is led to
_STEP = 0.05  # [s] of the environment


class Teleoperator:
    """Computes the action that leads the tool; the page sets the goal, in its threads.

    The goal is one reference that is replaced as a whole, so that no thread waits.
    """

    def __init__(self) -> None:
        """Begin with a user who does not lead."""
        self._to: Pose | None = None
        self._mouse: SpaceMouse | None = None
        self._is_armed = False
        self._quat: Vec4 | None = None  # to which the 3D mouse has turned the tool
        self._last: NDArray[np.float32] | None = None
        self.heading = math.pi / 2.0
        """Direction away from the user: an angle from the world's x [rad]."""
        self.is_teaching = False
        """True if rests are the user's, too: a demonstration without a policy."""

    # -- from any thread -----------------------------------------------------------

    def grab(self, to: Pose) -> None:
        """Begin to lead by the gizmo."""
        self._to = _usable(to)

    def move(self, to: Pose) -> None:
        """Lead on; ignored where the gizmo was not grabbed, or a stop came between."""
        if self._to is not None:
            self._to = _usable(to)

    def let_go(self) -> None:
        """Lead no more; a 3D mouse has to rest before it leads again."""
        self._to = None
        self._is_armed = False

    def take_mouse(self, mouse: SpaceMouse | None) -> None:
        """Lead by this 3D mouse from now on, close the one before; None takes none."""
        before, self._mouse = self._mouse, mouse
        self._is_armed = False
        if before is not None:
            before.close()

    @property
    def has_mouse(self) -> bool:
        """True while a 3D mouse is switched on."""
        return self._mouse is not None

    def drop_lost_mouse(self) -> str:
        """Close a 3D mouse that cannot be read any more; return why, empty if none."""
        problem = "" if self._mouse is None else self._mouse.problem
        if problem:
            self.take_mouse(None)
        return problem

    @property
    def is_leading(self) -> bool:
        """True while the user leads."""
        return self._to is not None or self._is_pushed()

    def _is_pushed(self) -> bool:
        mouse = self._mouse
        if mouse is None:
            return False
        is_moved = bool(mouse.deflection.any())
        self._is_armed = self._is_armed or not is_moved
        return is_moved and self._is_armed

    # -- in the loop's thread --------------------------------------------------------

    def reset(self) -> None:
        """Forget where the tool was led: an episode begins."""
        self._last = self._quat = None

    def action(self, core: ContactEnv) -> NDArray[np.float32] | None:
        """Return the user's action of this step; None leaves it to the policy."""
        to = self._to or self._pushed_to(core)
        if to is not None:
            self._last = action_towards(core, to)
            return self._last
        self._quat = None
        if not self.is_teaching:
            self._last = None
            return None
        if self._last is None:
            here = Pose(core.state.tool.position, core.state.tool.quat_wxyz)
            self._last = action_towards(core, here)
        self._last = resting_action(core.axes, self._last, core.commands.axes)
        return self._last

    def _pushed_to(self, core: ContactEnv) -> Pose | None:
        if not self._is_pushed() or self._mouse is None:
            return None
        moved = self._mouse.deflection
        way = _turned(moved[:3], self.heading) * (LEAD_SPEED / GAIN)
        turn = _turned(moved[3:], self.heading) * (TURN_RATE * _STEP)
        before = core.state.tool.quat_wxyz if self._quat is None else self._quat
        self._quat = quat_normalized(quat_multiply(quat_from_vector(turn), before))
        return Pose(core.state.tool.position + way, self._quat)


def _turned(vector: Vec3, heading: float) -> Vec3:
    """Return right, away, up in world axes, for a view along a heading [rad]."""
    right, away, up = vector
    c, s = math.cos(heading), math.sin(heading)
    return np.array([c * away + s * right, s * away - c * right, up])


def _usable(to: Pose) -> Pose:
    """Return a pose with its quaternion normalised; refuse one that is not finite.

    Raises:
        ConfigError: It is no pose, or farther away than any tool goes.
    """
    position = np.array(to.position, dtype=float)
    quat = np.array(to.quat_wxyz, dtype=float)
    is_near = position.shape == (3,) and bool((np.abs(position) < _FAR).all())
    is_turn = quat.shape == (4,) and 0.5 < float(np.abs(quat).max()) <= 1.1
    if not (is_near and is_turn and np.isfinite(quat).all()):
        raise ConfigError(f"the tool cannot be led to {position} m, {quat}")
    return Pose(position, quat_normalized(quat))
