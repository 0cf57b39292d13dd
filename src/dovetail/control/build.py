"""Build the C++ controller from a robot and its settings."""

from typing import TYPE_CHECKING

from dovetail.control.config import LimitConfig, OscConfig, check_period
from dovetail.control.task_spec import TaskSpec
from dovetail.control.torque_limits import check_torque

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot


def make_controller(
    robot: "Robot",
    osc: OscConfig,
    limits: LimitConfig,
    task: TaskSpec | str,
    period: float,
) -> "_core.Controller":
    """Build the controller; call its ``reset`` before the first ``step``.

    Args:
        robot: The controller's model, tool and payload included.
        osc: Operational-space law.
        limits: Limits, made for the same robot and period.
        task: Mode of each axis, for example ``XYZ:force A:pose BC:hold``.
        period: Control period [s].

    Raises:
        ConfigError: Unknown axis or mode, or a period out of range.
        TorqueError: A torque limit is below what gravity takes.
    """
    from dovetail import _core

    check_torque(robot, limits)
    spec = TaskSpec.parse(task) if isinstance(task, str) else task
    return _core.Controller(
        robot.chain(),
        osc.params(),
        limits.params(),
        list(spec.modes),
        check_period(period),
    )
