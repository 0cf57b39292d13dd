"""An arm that stood still for a while answers the newest message, and that alone."""

import os
import select
import signal
import socket
import subprocess
import sys

import pytest

from dovetail import _core

STALLED = 100  # messages that wait when the arm goes on
PERIOD_MS = 5
READY, C_WAIT, ACTIVE = 2, 3, 4
Q = [0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0]
ZERO = [0.0] * 7

CLIENT = """
import sys
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell

robot = find_cell().loaded_robot()
settings = ControllerSettings(
    osc=OscConfig(), limits=LimitConfig.for_period(robot, 0.005),
    task=TaskSpec.parse("XYZ:force A:pose BC:hold"), period=0.005,
)
address = FriAddress(host="127.0.0.1", port=0)
arm = FriArm(address, robot, settings, log_folder=None)
print(arm.port, flush=True)
for line in sys.stdin:
    state, counts = arm.monitoring(), arm.statistics()["counts"]
    print(state.tick, counts["answered"], counts["superseded"], flush=True)
"""


@pytest.fixture
def client():
    process = subprocess.Popen(
        [sys.executable, "-c", CLIENT],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    yield process
    process.kill()
    process.communicate()


class FalseCabinet:
    """Sends messages of a session, whatever comes back."""

    def __init__(self, port):
        self.version = _core.fri_version("1.15")
        self.sequence = 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))

    def send(self, state):
        message = _core.FriMonitoring()
        message.num_joints, message.send_period_ms = 7, PERIOD_MS
        message.receive_multiplier = 1
        message.state, message.quality, message.sequence = state, 2, self.sequence
        message.q_measured = Q
        message.tau_measured = message.tau_external = message.tau_commanded = ZERO
        if state >= C_WAIT:
            message.ipo_q, message.command_mode, message.overlay = Q, 3, 1
        self.socket.send(message.encode(self.version))
        self.sequence += 1

    def answers(self, wait):
        """The reflected counters of what comes until nothing does for a time [s]."""
        found = []
        while select.select([self.socket], [], [], wait)[0]:
            data = self.socket.recv(2000)
            found.append(_core.FriCommand.decode(self.version, data).reflected)
        return found


def ask(client):
    print("", file=client.stdin, flush=True)
    return [int(word) for word in client.stdout.readline().split()]


@pytest.mark.parametrize("state", [READY, ACTIVE])
def test_after_a_stall_only_the_newest_message_is_answered(client, state):
    cabinet = FalseCabinet(int(client.stdout.readline()))
    for before in (1, READY, C_WAIT, ACTIVE)[: state if state == READY else 4]:
        for _ in range(25):  # the client may be at its start still
            cabinet.send(before)
            if cabinet.answers(0.2)[-1:] == [cabinet.sequence - 1]:
                break
        else:
            pytest.fail(f"state {before} was not answered")
    tick, answered, superseded = ask(client)
    client.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, client.pid, os.WSTOPPED)
    for _ in range(STALLED):
        cabinet.send(state)
    client.send_signal(signal.SIGCONT)
    assert cabinet.answers(0.3) == [cabinet.sequence - 1]
    after = ask(client)
    assert after[1] == answered + 1
    if state == ACTIVE:
        assert after[0] == tick + STALLED  # the time has passed all the same
        assert after[2] == superseded + STALLED - 1
    cabinet.send(state)
    assert cabinet.answers(0.2) == [cabinet.sequence - 1]
    cabinet.socket.close()
