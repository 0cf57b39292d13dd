"""A simulated gripper with a part of 30 mm, twenty times faster than a real one."""

import pytest

from dovetail.gripper.simulated import SimulatedWsg50
from dovetail.gripper.wsg50 import Wsg50


@pytest.fixture
def server():
    with SimulatedWsg50(part_width=0.030, speed_up=20.0) as server:
        yield server


@pytest.fixture
def gripper(server):
    with Wsg50(server.host, server.port, timeout=2.0) as gripper:
        yield gripper


@pytest.fixture
def homed(gripper):
    gripper.home("open")
    return gripper
