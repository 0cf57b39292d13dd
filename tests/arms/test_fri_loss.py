"""What is said when a cabinet that was there is there no more."""

import os
import re
import signal
import struct
import subprocess
import sys

import numpy as np
import pytest

from dovetail import _core
from dovetail.errors import ArmError

from .loopback import LOOPBACK, free_port
from .test_fri_session import HOLD, alone, end_of, make_arm, wait_until


@pytest.fixture
def arm():
    """By the clock, so that time passes when nothing comes."""
    arm = make_arm(clock="wall", silence=0.4, timeout=20.0, reset="move")
    arm.connect()
    arm._timeout = 1.0
    arm.step(HOLD)
    yield arm
    arm.close()


def datagrams_in(error):
    return int(re.search(r"(\d+) datagrams came from 127.0.0.1:", str(error))[1])


def test_a_cable_that_is_pulled_is_not_taken_for_a_cabinet_that_never_was(arm):
    arm.ask("fault", text="loss=1")
    error = end_of(arm)
    assert error.reason == "motion_ended"
    assert "fallen silent without closing its session" in str(error)
    assert re.search(r"in [A-Z_]+ with quality (GOOD|EXCELLENT)", str(error)), error
    assert "Usually the cable is out" in str(error)
    assert datagrams_in(error) >= 10
    with pytest.raises(ArmError, match=r"the last [1-9]\.\d s ago") as again:
        arm.connect()
    assert again.value.reason == "silence"
    problem = arm.statistics()["problem"]
    assert "no datagram has come" not in problem
    assert re.search(r"nothing has come for \d\.\d+ s, after \d\d+ datagrams", problem)


def test_a_link_that_loses_too_much_is_named_and_no_emergency_stop():
    arm = make_arm(clock="lockstep", cabinet={"patience": 0.02}, reset="move")
    arm.connect()
    arm.ask("fault", text="loss=0.15")
    error = end_of(arm)
    arm.close()
    assert error.reason == "motion_ended"
    assert "too few answers came to the cabinet in time" in str(error)
    missed, came = re.search(r" (\d+) of its .* here, (\d+) came", str(error)).groups()
    assert 0 < int(missed) < int(came)
    assert "emergency" not in str(error)


def test_a_cable_that_is_put_back_is_no_loss(arm):
    arm.ask("fault", text="loss=1")
    end_of(arm)
    arm.ask("fault", text="none")
    arm._timeout = 20.0
    arm.connect()
    assert arm.step(HOLD).log.shape[0] > 0


def test_a_session_that_was_closed_is_told_from_a_cable(arm):
    arm.ask("stop")
    error = end_of(arm)
    assert "the cabinet has closed its FRI session" in str(error)
    assert "with quality" in str(error)
    assert "the Java application has ended" in str(error)
    with pytest.raises(ArmError, match="has closed its FRI session") as again:
        arm.connect()
    assert again.value.reason == "session_closed"


def test_values_that_are_no_numbers_are_no_wrong_version(arm):
    spoil(arm)
    error = end_of(arm)
    assert error.reason == "motion_ended"
    assert "values that are no numbers" in str(error)
    assert "measuredJointPosition" in str(error)
    assert "The FRI version is right" in str(error)
    assert "Set version" not in str(error)
    with pytest.raises(ArmError, match="no numbers") as again:
        arm.connect()
    assert again.value.reason == "unreadable"


def test_values_that_never_were_numbers_are_no_wrong_version():
    arm = make_arm(clock="wall", timeout=1.0, cabinet={"ready_slots": 1000})
    spoil(arm)
    wait_until(lambda: arm.statistics()["counts"]["undecodable"] > 3)
    with pytest.raises(ArmError, match="no numbers") as error:
        arm.connect()
    assert error.value.reason == "unreadable"
    arm.close()


def test_a_cabinet_that_was_killed_is_a_silence():
    port = free_port()
    words = f"cabinet --client {LOOPBACK}:{port} --port 0 --control none --period 5ms"
    program = [sys.executable, "-m", "dovetail.cli", *words.split()]
    cabinet = subprocess.Popen(program, stdout=subprocess.DEVNULL)
    arm = alone(port, silence=0.4, timeout=60.0)
    try:
        arm.connect()
        q = arm.monitoring().q
        arm.step(_core.Target(joint_mode=True, q_d=q))
        os.kill(cabinet.pid, signal.SIGKILL)
        error = end_of(arm)
    finally:
        cabinet.kill()
        cabinet.wait()
        arm.close()
    assert "fallen silent without closing its session" in str(error)
    assert "its program killed" in str(error)


def spoil(arm):
    """Make the first value of the first joint array of each message a NaN."""
    port = arm.cabinet._exchange.port
    send = port.send
    array = re.compile(rb"(?s)(?:\x09.{8}){7}")

    def send_spoilt(payload):
        found = array.search(payload)
        if found:
            at = found.start() + 1
            payload = payload[:at] + struct.pack("<d", np.nan) + payload[at + 8 :]
        send(payload)

    port.send = send_spoilt
