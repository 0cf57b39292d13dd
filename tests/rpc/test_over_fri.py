"""The whole road: learner, gRPC, controller process, FRI, simulated cabinet, plant."""

import signal
import time

import numpy as np
import pytest

from arms.loopback import LOOPBACK, free_port, make_cabinet
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.server import ArmServer
from states import state_numbers

from .conftest import HOLE, PERIOD, push


class UnloggedAddress(FriAddress):
    """Of an arm that writes no file when a motion ends."""

    def build(self, cell, settings):
        return FriArm(self, cell.loaded_robot(), settings, log_folder=None)


@pytest.fixture(params=["lockstep", "wall"])
def clock(request):
    return request.param


@pytest.fixture
def over_fri(cell, clock, news):
    """Builder of an arm over FRI; the cabinet runs beside it."""
    port = free_port()
    plant = make_plant("mujoco", cell, DynamicsConfig())
    with make_cabinet(plant, port, PERIOD, clock=clock) as cabinet:
        address = UnloggedAddress(
            host=LOOPBACK,
            port=port,
            clock=clock,
            control=str(cabinet.control_address),
        )
        yield OfferedArm(address, cell)
    plant.close()


def run(arm, start):
    states = [arm.reset(start, HOLE)]
    rng = np.random.default_rng(5)
    pushes = rng.uniform(-2.0, 1.0, (30, 3))
    return states + [arm.step(push(*f_star)) for f_star in pushes]


@pytest.mark.parametrize("clock", ["lockstep"], indirect=True)
def test_over_grpc_and_fri_the_arm_moves_as_over_fri(
    over_fri, settings, start, connect
):
    with ArmServer(over_fri, f"{LOOPBACK}:0") as server:
        remote = run(connect(server), start)
    osc, limits, task, period = settings
    arm = over_fri.build(
        ControllerSettings(
            osc=osc, limits=limits, task=TaskSpec.parse(task), period=period
        )
    )
    direct = run(arm, start)
    arm.close()
    for one, other in zip(remote, direct, strict=True):
        others = state_numbers(other)
        for name, a in state_numbers(one).items():
            np.testing.assert_array_equal(a, others[name], err_msg=name)


def test_the_next_learner_takes_over_from_one_that_was_killed(
    over_fri, start, connect, spawn_learner
):
    with ArmServer(over_fri, f"{LOOPBACK}:0") as server:
        for _ in range(2):
            learner = spawn_learner(server, "0.05")
            time.sleep(0.3)
            learner.send_signal(signal.SIGKILL)
            end = time.monotonic() + 10.0
            while server.service.leases.holder is not None:
                assert time.monotonic() < end
                time.sleep(0.01)
            time.sleep(0.5)
            if over_fri.address.is_real_time:
                assert np.abs(over_fri.arm.monitoring().dq).max() < 0.02
        successor = connect(server)
        successor.reset(start, HOLE)
        states = [successor.step(push(0.0, 0.0, -1.0)) for _ in range(5)]
        assert states[-1].tool.position[2] < states[0].tool.position[2]
