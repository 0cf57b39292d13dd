"""The arm that a service offers: which it is, and what a learner must ask of it."""

from dovetail.arms.arm import Arm
from dovetail.arms.arm_address import ArmAddress
from dovetail.control.limits import DeclaredErrors
from dovetail.control.period import require_period
from dovetail.control.proven import DECLARED, describe
from dovetail.control.settings import ControllerSettings
from dovetail.control.torque_limits import check_torque
from dovetail.durations import format_ms
from dovetail.errors import ConfigError
from dovetail.options import option_words
from dovetail.robots.robot import Robot
from dovetail.workcell.workcell import Workcell

NOTHING = DeclaredErrors(**dict.fromkeys(DECLARED, 0.0))
"""Errors that a learner has to declare where nothing is known of the arm."""


class OfferedArm:
    """An arm that is built anew for each learner's settings.

    The one before is closed first: it may own a port or a device.
    """

    def __init__(
        self, address: ArmAddress, cell: Workcell, declared: DeclaredErrors = NOTHING
    ) -> None:
        """Offer an arm; nothing is built before `build`.

        Args:
            address: Where it is; its period, if it says one, is the only one offered.
            cell: What stands around it, as the user says it is.
            declared: Least that a learner's limits have to be made for.
        """
        self.address, self.cell, self.declared = address, cell, declared
        self.robot: Robot = cell.loaded_robot()
        """The controller's model, tool included."""
        self.arm: Arm | None = None
        """The arm, while it is built."""

    def require_fit(self, settings: ControllerSettings) -> None:
        """Refuse a learner whose settings do not fit, before the arm is touched.

        Raises:
            ConfigError: Another period, one that the arm cannot have, or too little
                declared: names both, and what the learner has to add.
            TorqueError: Its torque limits cannot hold the arm.
        """
        require_period(settings.period, self.address.period_name, self.address.periods)
        check_torque(self.robot, settings.limits)
        name, period = self.address.text, self.address.period
        if period not in (None, settings.period):
            raise ConfigError(
                f"the arm at {name} is commanded every {1e3 * period:g} ms, the "
                f"learner asks for {1e3 * settings.period:g} ms: add "
                f"period={format_ms(period)} to the learner's address, "
                "grpc://HOST:PORT?period=..."
            )
        own = vars(settings.limits)
        for key, least in self.declared.declared_errors().items():
            if own[key] < least * (1.0 - 1e-9):
                word, given = option_words(key, least)
                raise ConfigError(
                    f"{key} of the arm at {name} is up to {describe(key, least)}, as "
                    f"who serves it says; the learner's limits declare "
                    f"{describe(key, own[key])}: give the learner {word} {given}, or "
                    f"in Python {key}={least:g}, and no margins=model"
                )

    def build(self, settings: ControllerSettings) -> Arm:
        """Close the arm before and return a new one."""
        self.close()
        self.arm = self.address.build(self.cell, settings)
        return self.arm

    def close(self) -> None:
        """Close the arm; harmless when repeated."""
        arm, self.arm = self.arm, None
        if arm is not None:
            arm.close()
