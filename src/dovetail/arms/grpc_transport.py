"""Builder of an arm behind a service, from its address."""

from dovetail.arms.grpc_address import GrpcAddress
from dovetail.arms.remote_arm import RemoteArm
from dovetail.control.settings import ControllerSettings
from dovetail.workcell.workcell import Workcell

parse = GrpcAddress.parse


def build_arm(
    address: GrpcAddress, cell: Workcell, settings: ControllerSettings
) -> RemoteArm:
    """Take the lease of the arm; see `RemoteArm`."""
    return RemoteArm(address, settings, robot=cell.loaded_robot(), cell=cell)
