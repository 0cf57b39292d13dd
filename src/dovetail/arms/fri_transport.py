"""Builder of an arm behind FRI, from its address."""

from dataclasses import replace

import numpy as np

from dovetail.arms.fri_address import FriAddress
from dovetail.arms.fri_arm import FriArm
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.control.period import require_period
from dovetail.control.settings import ControllerSettings
from dovetail.workcell.workcell import Workcell

parse = FriAddress.parse


def build_arm(
    address: FriAddress,
    cell: Workcell,
    settings: ControllerSettings,
    watchdog: WatchdogConfig | None = None,
) -> FriArm:
    """Listen for a cabinet.

    Args:
        address: Where to listen.
        cell: What stands around the arm.
        settings: Of the controller.
        watchdog: When the arm must not follow; None is as usual.

    Raises:
        ConfigError: A period that the cabinet cannot have.
        ArmError: The port cannot be listened on.
    """
    require_period(settings.period, address.period_name, address.periods)
    if address.control is None:
        # A robot: T1's limit is one of the velocity's norm.
        limits = settings.limits
        limits = replace(limits, dx_max=limits.dx_max / np.sqrt(3.0))
        settings = replace(settings, limits=limits)
    return FriArm(address, cell.loaded_robot(), settings, watchdog=watchdog)
