"""Arms behind a simulated cabinet on this machine's loopback."""

import socket
from contextlib import contextmanager

from dovetail.arms.fri_arm import FriArm
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint

LOOPBACK = "127.0.0.1"


def free_port():
    """A UDP port that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return probe.getsockname()[1]


@contextmanager
def fri_arm(plant, osc, limits, task, period, *, cabinet=None, **options):
    """A FriArm on a cabinet over the plant, in lockstep unless told otherwise."""
    port = free_port()
    clock = options.setdefault("clock", "lockstep")
    config = CabinetConfig(
        period=period,
        clock=clock,
        client=Endpoint(LOOPBACK, port),
        bind=Endpoint(LOOPBACK, 0),
        control=Endpoint(LOOPBACK, 0),
        **(cabinet or {}),
    )
    with Cabinet(plant, config) as running:
        options.setdefault("control", str(running.control_address))
        options.setdefault("log_folder", None)
        options.setdefault("version", config.version)
        robot = plant.scene.robot()
        arm = FriArm(robot, osc, limits, task, period, bind=(LOOPBACK, port), **options)
        arm.cabinet = running
        try:
            yield arm
        finally:
            arm.close()
    plant.close()
