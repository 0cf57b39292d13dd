"""The arm that an address names: here, behind a cabinet, or behind a service."""

from dataclasses import replace

import numpy as np

from dovetail.arms.arm import Arm
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.fri_address import FriAddress
from dovetail.arms.fri_arm import FriArm
from dovetail.arms.grpc_address import GrpcAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.arms.remote_arm import RemoteArm
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.control.period import require_period
from dovetail.control.settings import ControllerSettings
from dovetail.errors import ConfigError
from dovetail.workcell.workcell import Workcell


def arm_from_address(
    address: ArmAddress, cell: Workcell, settings: ControllerSettings
) -> Arm:
    """Build an arm.

    Args:
        address: Where it is.
        cell: What stands around it.
        settings: Made for the cell's robot and this address's margins.

    Raises:
        ConfigError: A setting that this arm cannot have.
        ArmError: It cannot be had.
        MissingDependencyError: What it needs is not installed.
    """
    if isinstance(address, FriAddress):
        return fri_arm(address, cell, settings)
    if isinstance(address, GrpcAddress):
        return RemoteArm(address, settings, robot=cell.loaded_robot(), cell=cell)
    plant = address.make_plant(cell)
    if plant is None:
        raise ConfigError(f"nobody can build an arm at {address.text!r}")
    return LocalArm(
        plant,
        cell.loaded_robot(),
        settings.osc,
        settings.limits,
        settings.task,
        settings.period,
        address=address.text,
    )


def fri_arm(
    address: FriAddress,
    cell: Workcell,
    settings: ControllerSettings,
    watchdog: WatchdogConfig | None = None,
) -> FriArm:
    """Listen for a cabinet; see `arm_from_address`.

    Args:
        address: Where to listen.
        cell: What stands around the arm.
        settings: Of the controller.
        watchdog: When the arm must not follow; None is as usual.
    """
    require_period(settings.period, address.period_name, address.periods)
    if address.cabinet.control is None:
        # A robot: T1's limit is one of the velocity's norm.
        limits = settings.limits
        limits = limits.having(dx_max=limits.tool.dx_max / np.sqrt(3.0))
        settings = replace(settings, limits=limits)
    return FriArm(address, cell.loaded_robot(), settings, watchdog=watchdog)
