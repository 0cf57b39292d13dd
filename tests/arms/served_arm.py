"""A RemoteArm with its service in threads of the same process."""

import pytest

from dovetail.errors import install_command

pytest.importorskip("grpc", reason=install_command("rpc"))

from dovetail.arms.remote_arm import GrpcAddress, RemoteArm
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.server import ArmServer

from .given_plant import GivenPlant


class ServedArm(RemoteArm):
    """Closes its service with itself."""

    def __init__(self, plant, robot, osc, limits, task, period):
        offered = OfferedArm(GivenPlant(text="test", plant=plant), plant.cell)
        self._server = ArmServer(offered, "127.0.0.1:0")
        self._server.start()
        try:
            address = GrpcAddress.parse(self._server.url)
            spec = TaskSpec.parse(task) if isinstance(task, str) else task
            settings = ControllerSettings(
                osc=osc, limits=limits, task=spec, period=period
            )
            super().__init__(address, settings, robot=robot)
        except BaseException:
            self._server.close()
            raise

    def close(self):
        super().close()
        self._server.close()
