"""Builder of an arm in this process, from its address."""

from dovetail.arms.local_address import LocalAddress
from dovetail.arms.local_arm import LocalArm
from dovetail.control.settings import ControllerSettings
from dovetail.workcell.workcell import Workcell


def build_arm(
    address: LocalAddress, cell: Workcell, settings: ControllerSettings
) -> LocalArm:
    """Build the plant, and the controller over it."""
    return LocalArm(
        address.make_plant(cell),
        cell.loaded_robot(),
        settings.osc,
        settings.limits,
        settings.task,
        settings.period,
        address=address.text,
    )
