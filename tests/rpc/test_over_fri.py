"""The whole road: learner, gRPC, controller process, FRI, simulated cabinet, plant."""

import signal
import socket
import time

import numpy as np
import pytest

from dovetail.arms.fri_arm import FriArm
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.control.task_spec import TaskSpec
from dovetail.plants.plant import DynamicsConfig, make_plant
from dovetail.rpc.builders import RebuiltArm
from dovetail.rpc.server import ArmServer
from dovetail.rpc.settings import Settings

from .conftest import HOLE, PERIOD, push

HOST = "127.0.0.1"


def free_port():
    """A UDP port that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]


@pytest.fixture(params=["lockstep", "wall"])
def clock(request):
    return request.param


@pytest.fixture
def over_fri(scene, clock, news):
    """Builder of an arm over FRI; the cabinet runs beside it."""
    port = free_port()
    plant = make_plant("mujoco", scene, DynamicsConfig())
    config = CabinetConfig(
        period=PERIOD,
        clock=clock,
        client=Endpoint(HOST, port),
        bind=Endpoint(HOST, 0),
        control=Endpoint(HOST, 0),
    )
    with Cabinet(plant, config) as cabinet:

        def make(settings):
            return FriArm(
                scene.robot(),
                *(settings.osc, settings.limits, settings.task, settings.period),
                bind=(HOST, port),
                clock=clock,
                control=str(cabinet.control_address),
                log_folder=None,
            )

        yield RebuiltArm("fri", scene, make, is_real_time=clock == "wall")
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
    with ArmServer(over_fri, f"{HOST}:0") as server:
        remote = run(connect(server), start)
    osc, limits, task, period = settings
    arm = over_fri.build(
        Settings(osc=osc, limits=limits, task=TaskSpec.parse(task), period=period)
    )
    direct = run(arm, start)
    arm.close()
    for one, other in zip(remote, direct, strict=True):
        for name, a, b in zip(one._fields, one, other, strict=True):
            np.testing.assert_array_equal(a, b, err_msg=name)


def test_the_next_learner_takes_over_from_one_that_was_killed(
    over_fri, start, connect, spawn_learner
):
    with ArmServer(over_fri, f"{HOST}:0") as server:
        for _ in range(2):
            learner = spawn_learner(server, "0.05")
            time.sleep(0.3)
            learner.send_signal(signal.SIGKILL)
            end = time.monotonic() + 10.0
            while server.service.leases.holder is not None:
                assert time.monotonic() < end
                time.sleep(0.01)
            time.sleep(0.5)
            if over_fri.is_real_time:
                assert np.abs(over_fri._arm.monitoring().dq).max() < 0.02
        successor = connect(server)
        successor.reset(start, HOLE)
        states = [successor.step(push(0.0, 0.0, -1.0)) for _ in range(5)]
        assert states[-1].position[2] < states[0].position[2]
