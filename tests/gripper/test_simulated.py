"""The simulated gripper's own side of the text protocol, spoken by hand."""

import socket
import time

import pytest

from dovetail.errors import GripperError
from dovetail.gripper.simulated import SimulatedWsg50


@pytest.fixture
def talk(server):
    """Sends bytes and returns the lines that come back within a while."""
    with socket.create_connection((server.host, server.port)) as client:

        def talk(data, count=1):
            client.sendall(data)
            client.settimeout(2.0)
            received = b""
            while received.count(b"\n") < count:
                received += client.recv(4096)
            return received.decode().splitlines()

        yield talk


def test_a_motion_is_acknowledged_and_then_finished(talk):
    assert talk(b"HOME()\n", 2) == ["ACK HOME", "FIN HOME"]
    assert talk(b"MOVE(50,400)\n", 2) == ["ACK MOVE", "FIN MOVE"]
    assert talk(b"POS?\n") == ["POS=50.000"]


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (b"MOVE(50)", "ERR MOVE 3"),
        (b"MOVE()", "ERR MOVE 13"),
        (b"MOVE(111)", "ERR MOVE 28"),
        (b"MOVE(-1)", "ERR MOVE 28"),
        (b"MOVE(nan)", "ERR MOVE 28"),
        (b"MOVE(abc)", "ERR MOVE 15"),
        (b"MOVE(50,0)", "ERR MOVE 28"),
        (b"GRIP(1)", "ERR GRIP 28"),
        (b"FLY()", "ERR FLY 14"),
        (b"\xff\xfe", "ERR ? 14"),
        (b"MOVE(50", "ERR MOVE 14"),
        (b"NAME?", "ERR NAME 14"),
        (b"SYSFLAGS[12]?", "SYSFLAGS[12]=0"),
        (b"SYSFLAGS[99]?", "ERR SYSFLAGS[99] 14"),
        (b'AUTOSEND("X",1)', "ERR AUTOSEND 24"),
        (b"AUTOSEND()", "ERR AUTOSEND 13"),
        (b"PWT=3", "PWT=3"),
        (b"PWT=x", "ERR PWT 15"),
        (b"FSACK()", "ACK FSACK"),
        (b"BYE()", "ACK BYE"),
        (b"x" * 600, "ERR ? 14"),
    ],
)
def test_every_line_has_an_answer(talk, line, answer):
    assert talk(line + b"\n")[0] == answer


def test_commands_may_come_together(talk):
    lines = talk(b"VERBOSE=1\nVERBOSE?\r\n\nPWT?\n", 3)
    assert lines == ["VERBOSE=1", "VERBOSE=1", "PWT=2.000"]


def test_verbose_answers_in_words(talk):
    talk(b"HOME(1)\n", 2)
    talk(b"VERBOSE=1\n")
    assert talk(b"RELEASE()\n") == ["ERR RELEASE E_CMD_FAILED"]
    assert talk(b"GRIP(20,20)\n", 2) == ["ACK GRIP", "ERR GRIP E_AXIS_BLOCKED"]


def test_a_fast_stop_aborts_the_motion_under_way(talk):
    talk(b"HOME(1)\n", 2)
    talk(b"MOVE(50,1)\n")
    assert talk(b"FASTSTOP()\n", 2) == ["ERR MOVE 19", "ACK FASTSTOP"]
    assert talk(b"HOME()\n") == ["ERR HOME 16"]


def test_a_width_tolerance_decides_what_is_a_part(talk):
    talk(b"HOME(1)\n", 2)
    talk(b"PWT=5\n")
    talk(b"CLT=6\n")
    assert talk(b"GRIP(20,33)\n", 2) == ["ACK GRIP", "FIN GRIP"]
    assert talk(b"GRIPSTATE?\n") == ["GRIPSTATE=4"]


def test_it_serves_again_after_every_kind_of_end(server):
    for data in (b"", b"BYE()\n", b"MOVE(", b"\xff" * 2000):
        with socket.create_connection((server.host, server.port)) as client:
            client.sendall(data)
            time.sleep(0.02)
    deadline = time.monotonic() + 2.0
    while server.num_fast_stops < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert server.num_fast_stops == 3
    with socket.create_connection((server.host, server.port)) as client:
        client.sendall(b"POS?\n")
        client.settimeout(2.0)
        assert client.recv(100).startswith(b"POS=")


def test_a_port_in_use_is_said(server):
    with pytest.raises(GripperError, match=r"in use.*choose another port"):
        SimulatedWsg50(port=server.port)
