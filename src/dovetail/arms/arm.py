"""Interface of an arm: it follows a Target for a while and returns its state."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeGuard

import numpy as np

from dovetail.errors import ArmError
from dovetail.poses import Pose
from dovetail.types import Array, Vec3, Vec4, Vec6, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.control.config import LimitConfig, OscConfig
    from dovetail.control.task_spec import TaskSpec
    from dovetail.robots.robot import Robot


_UNKNOWN = np.zeros(0)


class ToolState(NamedTuple):
    """Pose and twist of the tool."""

    position: Vec3
    """TCP in the world by the controller's model [m], shape (3,)."""
    quat_wxyz: Vec4
    """TCP rotation in the world by the controller's model, w >= 0."""
    velocity: Vec6
    """TCP twist [m/s, rad/s], linear then angular, world axes."""


class ArmState(NamedTuple):
    """State of an arm after a step."""

    stamp: float
    """Time since reset [s], by the arm's clock."""
    q: Vec7
    """Measured configuration [rad], shape (7,)."""
    dq: Vec7
    """Measured joint velocity [rad/s], shape (7,)."""
    tool: ToolState
    """Pose and twist of the tool."""
    contact_force: Vec3
    """True contact force on the tool, the largest of the step [N], world axes, shape
    (3,): a simulation's. Not-a-number where the arm cannot measure it, as on a robot:
    then no comparison with it is true."""
    wrench: Vec6
    """Estimated wrench of the world on the tool at the TCP [N, Nm], world axes, force
    then moment, as the step's last cycle knew it; zero before the first. An arm's holds
    missed weight and dry friction beside contact (docs/control.md, Wrench on the tool).
    In `ContactEnv.state` the weight that a tare measured is taken off, so that it is
    contact within some newtons of friction (docs/your-own-task.md)."""
    flags: int
    """Limits that acted in any cycle of the step: the cycles' packed flags, or-ed."""
    log: Array
    """One row per control cycle of the step, columns CYCLE_COLUMNS."""
    parts: Array = _UNKNOWN
    """True positions of the parts' joints after the step [rad, m], in the order of
    `Workcell.joints`: a simulation's. Empty where the arm does not know them, as on a
    robot, and where no part has a joint."""


@dataclass(frozen=True, kw_only=True)
class ArmTraits:
    """Capabilities of an arm, apart from its address."""

    is_simulated: bool
    """True for a `SimulatedArm`: it can be pushed and its fixture moved."""
    is_real_time: bool
    """True if the arm moves on while the learner thinks."""
    places_fixture: bool
    """True if a reset can place the fixture; otherwise it stays where it is."""
    measures_contact: bool
    """True if it may measure contact forces; otherwise they are not-a-number. Behind a
    service, which alone knows, it is always True."""
    holds_its_weight: bool = False
    """True if gravity compensation is exact: on a plant with the masses and the gravity
    of the controller's model. Elsewhere it may not be, and a tare measures the rest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmFacts:
    """Constants of an arm, from its building to its end."""

    robot: "Robot"
    """The controller's model, tool included."""
    osc: "OscConfig"
    """The controller's operational-space law."""
    limits: "LimitConfig"
    """The controller's limits."""
    task: "TaskSpec"
    """Mode of each axis."""
    period: float
    """Control period [s]."""
    address: str = ""
    """Address of the arm; empty if it was built without one."""
    traits: ArmTraits
    """Capabilities of the arm."""


class Arm(Protocol):
    """An arm under the controller, wherever it is: in this process or a real one."""

    @property
    def facts(self) -> ArmFacts:
        """Constants of the arm."""
        ...

    def reset(self, q: Vec7, fixture: Pose) -> ArmState:
        """Go to q [rad], at rest, with the fixture at its pose; latch what is held."""
        ...

    def step(self, target: "_core.Target", duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], a whole number of periods.

        Raises:
            ConfigError: The duration is not a whole number of periods.
        """
        ...

    def seed(self, seed: int) -> None:
        """Start a simulation's noise again, with the next reset; a real arm's cannot.

        Args:
            seed: At least 0.
        """
        ...

    def stop(self) -> None:
        """Hold the arm, now where it moves on its own, until `clear` or `reset`."""
        ...

    def clear(self) -> None:
        """End a stop; harmless when there is none."""
        ...

    def statistics(self) -> dict[str, Any]:
        """Return what was counted and timed, by name.

        `notes`, always there, is a list of lines that a person should read. `problem`,
        of an arm that another process moves, says why it cannot follow, or is empty.
        """
        ...

    def close(self) -> None:
        """Release the arm; harmless when repeated."""
        ...


class SimulatedArm(Arm, Protocol):
    """An arm whose world can be disturbed: here, or behind a cabinet's control port."""

    def push(self, force: Vec3, duration: float) -> None:
        """Push the TCP from now on with a force [N], world axes, for a duration [s]."""
        ...

    def move_fixture(self, fixture: Pose, velocity: Vec3) -> None:
        """Put the fixture at a pose; it then moves at a velocity [m/s], world axes."""
        ...

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on.

        Args:
            offset: The part's frame in the TCP's. The controller does not know of it.
        """
        ...


def require_simulated(arm: Arm) -> SimulatedArm:
    """Return the arm as one that can be pushed and its fixture moved.

    Raises:
        ArmError: It cannot.
    """
    if is_simulated(arm):
        return arm
    raise ArmError(
        f"nothing at this end can push the arm {arm.facts.address} or move its "
        "fixture: take a simulation, or a simulated cabinet's control port",
        "no_control",
    )


def is_simulated(arm: Arm) -> TypeGuard[SimulatedArm]:
    """Say whether the arm can be pushed and its fixture moved."""
    return arm.facts.traits.is_simulated
