"""The arm that an address names: here, behind a cabinet, or behind a service."""

from dovetail.arms.arm import Arm
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.transport import part_of_transport
from dovetail.control.settings import ControllerSettings
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
    return part_of_transport(address.transport, "build_arm")(address, cell, settings)
