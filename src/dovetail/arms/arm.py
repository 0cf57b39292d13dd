"""What an arm is: it follows a Target for a while and says where it is."""

from typing import TYPE_CHECKING, NamedTuple, Protocol

from dovetail.poses import Pose
from dovetail.types import Array, Vec3, Vec4, Vec6, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robot import Robot


class ArmState(NamedTuple):
    """What an arm knows of itself after a step."""

    stamp: float
    """Time since reset [s], by the arm's clock."""
    q: Vec7
    """Measured configuration [rad], shape (7,)."""
    dq: Vec7
    """Measured joint velocity [rad/s], shape (7,)."""
    position: Vec3
    """TCP in the world by the controller's model [m], shape (3,)."""
    quat_wxyz: Vec4
    """TCP rotation in the world by the controller's model, w >= 0."""
    velocity: Vec6
    """TCP twist [m/s, rad/s], linear then angular, world axes."""
    contact_force: Vec3
    """Largest contact force on the tool during the step [N], world axes, shape (3,);
    not-a-number where the arm cannot measure it."""
    flags: int
    """What limited any cycle of the step: the cycles' packed flags, or-ed."""
    log: Array
    """One row per control cycle of the step, columns CYCLE_COLUMNS."""


class Arm(Protocol):
    """An arm under the controller, wherever it is: in this process or a real one."""

    robot: "Robot"
    """The controller's model, tool included."""
    period: float
    """Control period [s]."""

    def reset(self, q: Vec7, fixture: Pose) -> ArmState:
        """Go to q [rad], at rest, with the fixture at its pose; latch what is held."""
        ...

    def step(self, target: "_core.Target", duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], a whole number of periods.

        Raises:
            ConfigError: The duration is not a whole number of periods.
        """
        ...

    def close(self) -> None:
        """Release the arm; harmless when repeated."""
        ...
