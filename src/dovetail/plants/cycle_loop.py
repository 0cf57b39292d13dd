"""The control cycle over any plant, in Python: the reference of the C++ loop."""

from typing import TYPE_CHECKING, Protocol

import numpy as np

from dovetail import _core
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import quat_from_matrix
from dovetail.types import Array, Vec3, Vec6, Vec7

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot


class CyclePlant(Protocol):
    """Part of a plant that the cycle needs; `Plant` has it."""

    robot: "Robot"

    def read(self) -> tuple[Vec7, Vec7]:
        """Return the measured configuration [rad] and velocity [rad/s]."""
        ...

    def apply(self, tau: Vec7, dt: float) -> None:
        """Hold the overlay torque tau [Nm] for dt [s]."""
        ...

    def contact_force_peak(self) -> Vec3:
        """Return the largest force on the tool during the last `apply` [N], world."""
        ...


class Stepper(Protocol):
    """Part of a controller that the cycle needs; `_core.Controller` has it."""

    def step(self, q: Vec7, dq: Vec7, target: _core.Target, /) -> _core.StepResult:
        """Return the torque at a measured state [rad, rad/s] towards a Target."""
        ...

    @property
    def wrench(self) -> Vec6:
        """Estimated wrench on the tool at the TCP [N, Nm], world axes."""
        ...


def run_cycles(
    plant: CyclePlant,
    controller: Stepper,
    target: _core.Target,
    cycles: int,
    period: float,
    start: float,
) -> tuple[Array, Vec7, Vec7]:
    """Run the controller against a plant; see `Plant.run_cycles`.

    Args:
        plant: Where the torques go.
        controller: The controller, reset.
        target: Held during all cycles.
        cycles: Number of control cycles.
        period: Control period [s].
        start: Time since the plant's reset [s].
    """
    log = np.empty((cycles, len(CYCLE_COLUMNS)))
    chain = plant.robot.chain()
    held = _core.Target(target)
    q, dq = plant.read()
    for i in range(cycles):
        result = controller.step(q, dq, held)
        held.age += period
        position, rotation = chain.pose(q)
        quat = quat_from_matrix(rotation)
        twist = chain.jacobian(q) @ dq
        plant.apply(result.tau, period)
        log[i] = _core.cycle_row(
            time=start + i * period,
            q=q,
            dq=dq,
            tau=result.tau,
            position=position,
            quat_wxyz=quat,
            twist=twist,
            contact_force=plant.contact_force_peak(),
            f_star=target.f_star[:3],
            flags=result.flags,
            wrench=controller.wrench,
        )
        q, dq = plant.read()
    return log, q, dq
