"""A client made of the specification's bytes alone, as KUKA's programs send them.

Nothing here comes from our codec but the reading of state and counter, so that both
ends cannot agree on the same mistake.
"""

import struct
import zlib

import numpy as np
import pytest

from dovetail import _core
from dovetail.cabinet.protocol import SessionState
from dovetail.cabinet.signals import parse_signal

from .client import wait_until
from .conftest import FIXTURE, LightPlant

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
POSITION = [0.0, 0.1, 0.2, 3 * 0.1, 0.4, 0.5, 6 * 0.1]
Q = bytes.fromhex(
    "090000000000000000 099a9999999999b93f 099a9999999999c93f 09343333333333d33f"
    "099a9999999999d93f 09000000000000e03f 09343333333333e33f"
)
Z = bytes.fromhex("090000000000000000" * 7)
GOLDEN_131 = (
    bytes.fromhex("0a0a0881800d108301188301")
    + bytes.fromhex("1282010a3f")
    + Q
    + bytes.fromhex("1a3f")
    + Z
)
IO_WRITE = (
    bytes.fromhex("0a080881800d10001800124d2a2a0a1b")
    + b"FRI.Out_Analog_Deci_Seconds"
    + bytes.fromhex("1002180129000000000000f03f2a1f0a17")
    + b"FRI.Out_Integer_Seconds"
    + bytes.fromhex("10011801203c")
)


def varint(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def header(sequence, reflected):
    body = b"\x08\x81\x80\x0d\x10" + varint(sequence) + b"\x18" + varint(reflected)
    return b"\x0a" + varint(len(body)) + body


def with_body(head, body):
    return head + b"\x12" + varint(len(body)) + body


class GoldenClient:
    """Mirrors the interpolator's position, which is Q, and sends zero torque."""

    def __init__(self, client, version, echoes):
        self.client, self.version, self.echoes = client, version, echoes
        self.sent = {}
        self.sequence = 0
        client.version = _core.fri_version(version)
        client.step = self.step

    def step(self):
        data, cabinet = self.client.socket.recvfrom(2000)
        message = _core.FriMonitoring.decode(self.client.version, data)
        self.client.messages.append(message)
        state = SessionState(int(message.state))
        if not self.client.states or self.client.states[-1] is not state:
            self.client.states.append(state)
        if state is IDLE:
            return
        reply = header(self.sequence, message.sequence)
        if state >= C_WAIT:
            reply = with_body(reply, b"\x0a\x3f" + Q + b"\x1a\x3f" + Z)
        elif self.echoes:
            reply = with_body(reply, b"\x0a\x3f" + Q)
        self.sent[self.sequence] = reply
        if self.version == "2.7":
            checksum = struct.pack("<I", zlib.crc32(reply))
            reply = struct.pack("<I", len(reply)) + reply + checksum
        self.client.socket.sendto(reply, cabinet)
        self.sequence += 1


@pytest.fixture
def plant():
    plant = LightPlant()
    plant.reset(np.array(POSITION), FIXTURE)
    return plant


@pytest.mark.parametrize(
    ("version", "echoes"),
    [("1.15", True), ("1.15", False), ("2.5", False), ("2.7", False)],
)
def test_the_specifications_client_gets_to_commanding_active(
    make, client, plant, version, echoes
):
    golden = GoldenClient(client, version, echoes)
    client.start()
    with make(plant, version=version, sync_slots=60) as cabinet:
        client.wait_for(ACTIVE)
        counts = cabinet.status()["counts"]
        assert client.states == [WAIT, READY, C_WAIT, ACTIVE]
        assert counts.get("undecodable", 0) == counts.get("stops", 0) == 0
    # Message 131 fell into COMMANDING_WAIT: its answer is the specification's, exactly.
    if 131 in golden.sent and golden.sent[131][:12] == GOLDEN_131[:12]:
        assert golden.sent[131] == GOLDEN_131
        assert len(GOLDEN_131) == 145


def test_datagrams_have_the_sizes_of_real_ones(make, client, plant):
    sizes = {}

    def step():
        data, cabinet = client.socket.recvfrom(2000)
        message = _core.FriMonitoring.decode(client.version, data)
        sizes.setdefault(SessionState(int(message.state)), set()).add(len(data))
        client.cabinet = cabinet
        if int(message.state):
            command = _core.FriCommand()
            if int(message.state) >= C_WAIT:
                command.q, command.tau = message.ipo_q, [0.0] * 7
            client.send(command, message.sequence)

    client.step = step
    client.start()
    with make(plant):
        wait_until(lambda: ACTIVE in sizes)
    assert sizes[WAIT] <= set(range(398, 408))
    assert sizes[READY] <= set(range(398, 408))
    assert sizes[C_WAIT] <= set(range(463, 475))


def test_kukas_io_sample_is_understood(make, client, plant):
    def step():
        data, cabinet = client.socket.recvfrom(2000)
        client.messages.append(_core.FriMonitoring.decode(client.version, data))
        if len(client.messages) == 1:
            client.socket.sendto(IO_WRITE, cabinet)

    client.step = step
    client.start()
    signals = (
        "FRI.In_Bool_Clock_Enabled:boolean:input=1",
        "FRI.Out_Integer_Seconds:digital:output",
        "FRI.Out_Analog_Deci_Seconds:analog:output",
    )
    with make(plant, io=tuple(parse_signal(text) for text in signals)) as cabinet:
        wait_until(lambda: cabinet.status()["io"]["FRI.Out_Integer_Seconds"] == 60)
        assert cabinet.status()["io"]["FRI.Out_Analog_Deci_Seconds"] == 1.0
        assert cabinet.status()["counts"]["received"] == 1
