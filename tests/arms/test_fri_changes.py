"""What an arm over FRI does when the cabinet says something new in a motion."""

import re
import struct

import numpy as np
import pytest

from dovetail import _core
from dovetail.errors import ArmError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, FLAG_MASK, DynamicsConfig

from .loopback import free_port, make_cabinet
from .test_fri_session import CELL, HOLD, HOLE, PERIOD, START, alone, end_of, make_arm

VERSION = _core.fri_version("1.15")
ACTIVE = 4
OFF = 0
WRENCH = 2


def doctor(cabinet, change):
    """Let a function change each message of a cabinet, at the last moment."""
    port = cabinet._exchange.port
    send = port.send

    def send_changed(payload):
        message = _core.FriMonitoring.decode(VERSION, payload)
        change(message)
        send(message.encode(VERSION))

    port.send = send_changed


@pytest.fixture
def arm():
    arm = make_arm()
    arm.reset(START, HOLE)
    arm.step(HOLD)
    yield arm
    arm.close()


def once_active(change, count=10**9):
    """Change so many messages of COMMANDING_ACTIVE."""
    left = [count]

    def changed(message):
        if int(message.state) == ACTIVE and left[0] > 0:
            left[0] -= 1
            change(message)

    return changed


def say(**values):
    def change(message):
        for name, value in values.items():
            setattr(message, name, value)

    return change


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"safety": 1, "drive_states": [OFF] * 7}, "safety_stop"),
        ({"safety": 3}, "safety_stop"),
        ({"drive_states": [OFF] * 7}, "drives_off"),
    ],
)
def test_a_stop_of_the_cabinet_stops_the_arm_in_that_message(arm, said, reason):
    before = arm.monitoring().rows
    doctor(arm.cabinet, once_active(say(**said)))
    error = end_of(arm)
    assert error.reason == reason
    assert error.state.is_stopped
    rows = arm.monitoring().rows - before
    flags = arm.recent(rows * PERIOD)[:, COLUMN["flags"]].astype(np.int64)
    assert (flags[1:] & FLAG_MASK["stopped"]).all()  # one was on its way
    with pytest.raises(ArmError) as again:
        arm.step(HOLD)
    assert again.value.reason == reason


@pytest.mark.parametrize("count", [1, 10**9])
@pytest.mark.parametrize(
    ("said", "cause", "what", "before", "after"),
    [
        ({"send_period_ms": 10}, "period", "send period", "5 ms", "10 ms"),
        ({"receive_multiplier": 3}, "period", "multiplier", "5 ms", "15 ms"),
        ({"command_mode": WRENCH}, "problem", "clientCommandMode", "TORQUE", "WRENCH"),
        ({"q_measured": None}, "problem", "measuredJointPosition", "there", "missing"),
        ({"ipo_q": None}, "problem", "ipoData.jointPosition", "there", "missing"),
        ({"num_joints": 6}, "problem", "numberOfJoints", "7", "6"),
    ],
)
def test_what_changed_in_a_motion_is_said(arm, count, said, cause, what, before, after):
    doctor(arm.cabinet, once_active(say(**said), count))
    error = end_of(arm)
    assert error.reason == "motion_ended"
    end = error.state.end
    assert (end.cause, end.before, end.after) == (cause, before, after)
    assert what in end.what
    assert end.what in str(error)
    assert "emergency" not in str(error)


def test_a_motion_that_the_program_ends_is_no_emergency_stop(arm):
    arm.ask("pause")
    error = end_of(arm)
    assert error.reason == "motion_ended"
    assert error.state.end.cause == "session"
    assert error.state.end.safety == 0
    assert "emergency" not in str(error)


def test_a_motion_that_a_safety_stop_ends_is_said_to_be(arm):
    arm.ask("fault", text="stop_at=0s,stop=2,stop_time=5s")
    error = end_of(arm)
    assert error.state.end.safety == 2 or error.reason == "safety_stop"
    assert "safetyState 2" in str(error)


def spoil(cabinet, joint):
    """Make the position of a joint in each message a NaN."""
    port = cabinet._exchange.port
    send = port.send
    array = re.compile(rb"(?s)(?:\x09.{8}){7}")

    def send_spoilt(payload):
        found = array.search(payload)
        at = found.start() + 9 * joint + 1
        send(payload[:at] + struct.pack("<d", np.nan) + payload[at + 8 :])

    port.send = send_spoilt


@pytest.mark.parametrize("clock", ["lockstep", "wall"])
def test_positions_that_never_were_numbers_are_named_by_joint(clock):
    port = free_port()
    arm = alone(port, clock=clock, timeout=1.0)
    plant = make_plant("mujoco", CELL, DynamicsConfig())
    plant.reset(START, HOLE)
    cabinet = make_cabinet(plant, port, PERIOD, clock=clock)
    spoil(cabinet, 2)
    with cabinet, pytest.raises(ArmError) as error:
        arm.connect()
    arm.close()
    plant.close()
    assert error.value.reason == "unreadable"
    assert "measuredJointPosition of A3" in str(error.value)
    assert "version=" not in str(error.value)
