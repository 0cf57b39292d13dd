"""The driver against the simulated gripper: every command, every fault."""

import socket
import threading
import time

import pytest

from dovetail.errors import ConfigError, GripperError
from dovetail.gripper.facts import MEANINGS, Code, Flag, GripState, describe
from dovetail.gripper.simulated import SimulatedWsg50
from dovetail.gripper.wsg50 import Wsg50


def wait_until(is_reached, seconds=5.0):
    deadline = time.monotonic() + seconds
    while not is_reached():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_home_is_needed_before_any_motion(gripper):
    with pytest.raises(
        GripperError, match=r"not initialised \(code 3\): home it first"
    ):
        gripper.move(0.05)
    assert not gripper.flag(Flag.REFERENCED)
    gripper.home("open")
    assert gripper.flag(Flag.REFERENCED)
    assert gripper.state().width == pytest.approx(0.110)


@pytest.mark.parametrize(("towards", "width"), [("closed", 0.0), ("open", 0.110)])
def test_home_goes_to_the_end_that_was_asked(towards, width):
    with (
        SimulatedWsg50(speed_up=20.0) as server,
        Wsg50(server.host, server.port) as gripper,
    ):
        gripper.home(towards)
        assert gripper.state().width == pytest.approx(width)


def test_move_goes_there_in_metres(homed):
    homed.move(0.0425, speed=0.2)
    state = homed.state()
    assert state == pytest.approx((0.0425, 0.0, 0.0, GripState.IDLE), abs=1e-6)


def test_grip_holds_a_part_with_the_force_and_release_lets_it_go(homed):
    assert homed.grip(force=25.0, width=0.030) == GripState.HOLDING
    state = homed.state()
    assert state.width == pytest.approx(0.030)
    assert state.force == pytest.approx(25.0)
    homed.release(pullback=0.02)
    state = homed.state()
    assert state.width == pytest.approx(0.050)
    assert (state.force, state.grip) == (0.0, GripState.IDLE)


def test_grip_says_when_there_is_no_part(homed, server):
    server.fingers.remove_part()
    assert homed.grip(force=25.0, width=0.030) == GripState.NO_PART
    homed.release()


def test_without_a_width_the_gripper_cannot_tell_part_from_none(homed, server):
    server.fingers.remove_part()
    assert homed.grip() == GripState.HOLDING
    assert homed.state().width == pytest.approx(0.0)


def test_a_part_of_another_width_blocks(homed):
    with pytest.raises(GripperError, match="axis blocked") as error:
        homed.grip(width=0.020)
    assert error.value.code == Code.AXIS_BLOCKED
    assert homed.state().grip == GripState.ERROR


def test_a_part_in_the_way_blocks_a_move(homed):
    with pytest.raises(GripperError, match="something is between the fingers"):
        homed.move(0.010)
    assert homed.state().width == pytest.approx(0.030)


def test_no_second_grip_while_holding(homed):
    homed.grip(width=0.030)
    with pytest.raises(GripperError, match="release before a new grip"):
        homed.grip(width=0.030)


def test_release_only_after_a_grip(homed):
    with pytest.raises(GripperError, match="nothing to release"):
        homed.release()


def test_a_lost_part_is_seen(homed, server):
    homed.grip(width=0.030)
    server.fingers.remove_part()
    assert homed.state().grip == GripState.PART_LOST
    homed.release()


def test_stop_gives_up_the_motion_where_it_is(homed):
    homed.start_move(0.060, speed=0.02)
    with pytest.raises(GripperError, match="MOVE is still under way"):
        homed.start_move(0.050)
    homed.stop()
    width = homed.state().width
    assert 0.060 < width < 0.110
    homed.move(0.100, speed=0.4)
    assert homed.state().width == pytest.approx(0.100)


def test_a_motion_can_be_begun_and_waited_for(homed):
    homed.start_move(0.060, speed=0.1)
    assert homed.flag(Flag.MOVING)
    homed.wait()
    assert homed.state().width == pytest.approx(0.060)


def test_fast_stop_refuses_motion_until_acknowledged(homed):
    homed.start_move(0.060, speed=0.02)
    homed.fast_stop()
    assert homed.flag(Flag.FAST_STOP)
    with pytest.raises(GripperError, match="look why, then acknowledge it"):
        homed.move(0.05)
    homed.acknowledge()
    homed.move(0.05)
    assert homed.state().width == pytest.approx(0.05)


def test_a_client_that_vanishes_stops_the_gripper_fast(server):
    first = Wsg50(server.host, server.port)
    first.home("open")
    first.start_move(0.060, speed=0.001)
    first._line.close()  # no goodbye
    wait_until(lambda: server.num_fast_stops == 1)
    with Wsg50(server.host, server.port) as second:
        with pytest.raises(GripperError, match="acknowledge"):
            second.move(0.05)
        second.acknowledge()
        second.move(0.05)


def test_a_client_that_says_goodbye_does_not(server):
    for _ in range(3):
        with Wsg50(server.host, server.port) as gripper:
            gripper.state()
            gripper.close()  # harmless when repeated
    time.sleep(0.02)
    assert server.num_fast_stops == 0


def test_one_client_at_a_time(gripper, server):
    gripper.state()
    with pytest.raises(GripperError, match=r"connection .* is lost"):
        Wsg50(server.host, server.port).state()
    gripper.state()


def test_values_come_by_themselves(homed):
    homed.autosend("POS", 0.005)
    homed.autosend("FORCE", 0.005)
    homed.move(0.050, speed=0.1)
    time.sleep(0.02)
    homed.state()
    assert homed.latest["POS"] == pytest.approx(0.050)
    assert homed.latest["FORCE"] == 0.0
    homed.autosend("POS", 0.0)
    homed.autosend("FORCE", 0.0)


def test_any_value_can_be_asked_by_name(gripper):
    assert gripper.query("DEVTYPE") == "simulated WSG 50-110"
    with pytest.raises(GripperError, match="unknown command"):
        gripper.query("NOSUCH")


@pytest.mark.parametrize("segment_size", [1, 3])
def test_lines_may_come_in_pieces(server, segment_size):
    server.segment_size = segment_size
    with Wsg50(server.host, server.port) as gripper:
        gripper.home("open")
        gripper.move(0.05)
        assert gripper.state().width == pytest.approx(0.05)


def test_lines_may_come_together(gripper, server):
    server.send(b"@POS=1.0\r\n\n@FORCE=2.5\n@SPEED=oops\n@POS=3.0\n")
    wait_until(lambda: gripper.state() and "FORCE" in gripper.latest)
    assert gripper.latest == {"POS": pytest.approx(0.003), "FORCE": 2.5}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"hello\n", "no line of the text protocol"),
        (b"\xff\xfe\n", "which is no text"),
        (b"\xaa\xaa\xaa\x40\x00\x00", "speaks the binary protocol"),
        (b"x" * 600, "lines of more than 512 bytes"),
    ],
)
def test_what_is_no_line_is_refused_with_the_remedy(data, message):
    with fake_peer(data) as (host, port):
        gripper = Wsg50(host, port, timeout=1.0)
        with pytest.raises(GripperError, match=message):
            gripper.state()
        gripper.close()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"GRIPSTATE=9\n", "known: 0 to 7"),
        (b"GRIPSTATE=x\n", "known: 0 to 7"),
        (b"GRIPSTATE=0\nPOS=nan\n", "POS=nan, which is no number"),
        (b"GRIPSTATE=0\nPOS=1\nSPEED=a\n", "SPEED=a, which is no number"),
        (b"ERR GRIPSTATE 7\n", r"timeout \(code 7\)"),
        (b"ERR 16\n", r"access denied \(code 16\)"),
        (b"ERR GRIPSTATE 99\n", "gripper GRIPSTATE: 99"),
        (b"ERR GRIPSTATE E_OTHER\n", "E_OTHER"),
    ],
)
def test_a_wrong_answer_is_an_error_not_a_number(data, message):
    with fake_peer(data) as (host, port):
        gripper = Wsg50(host, port, timeout=1.0)
        with pytest.raises(GripperError, match=message):
            gripper.state()
        gripper.close()


class fake_peer:  # noqa: N801
    """A port that sends fixed bytes to whoever connects, and nothing else."""

    def __init__(self, data):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.data = data
        self.connections = []
        self.thread = threading.Thread(target=self.serve, daemon=True)

    def serve(self):
        connection, _ = self.listener.accept()
        self.connections.append(connection)
        connection.sendall(self.data)

    def __enter__(self):
        self.thread.start()
        return self.listener.getsockname()

    def __exit__(self, *_):
        self.thread.join()
        for connection in self.connections:
            connection.close()
        self.listener.close()


def test_a_gripper_that_hangs_is_an_error_after_the_timeout(server):
    gripper = Wsg50(server.host, server.port, timeout=0.1)
    server.is_mute = True
    with pytest.raises(GripperError, match=r"did not answer within 0.1 s"):
        gripper.state()
    gripper.close()


def test_an_answer_that_came_too_late_is_not_taken_for_another(server):
    with Wsg50(server.host, server.port, timeout=0.3) as gripper:
        gripper.home("open")
        server.send(b"VERSION=old\nACK STOP\nFIN HOME\nERR HOME 19\n")
        gripper.move(0.05)
        assert gripper.state().width == pytest.approx(0.05)


def test_nobody_there_says_what_to_check():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(GripperError, match="check its power, its address, its port"):
        Wsg50("127.0.0.1", port)


def test_a_gripper_that_goes_away_is_an_error(server):
    gripper = Wsg50(server.host, server.port)
    server.close()
    with pytest.raises(GripperError, match="lost"):
        gripper.state()
    gripper.close()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda g: g.move(0.111), r"width is 0.111 m; allowed: 0 to 0.11 m"),
        (lambda g: g.move(-0.001), "width is -0.001 m"),
        (lambda g: g.move(float("nan")), "width is nan m"),
        (lambda g: g.move(0.05, speed=0.0), "above 0"),
        (lambda g: g.move(0.05, speed=0.5), "0 to 0.42 m/s"),
        (lambda g: g.grip(force=4.0), "force is 4 N; allowed: 5 to 80 N"),
        (lambda g: g.grip(force=81.0), "force is 81 N"),
        (lambda g: g.grip(width=0.2), "width is 0.2 m"),
        (lambda g: g.release(pullback=0.2), "pullback is 0.2 m"),
        (lambda g: g.home("up"), "known: default, closed, open"),
        (lambda g: g.autosend("TEMP", 0.1), "known: POS, SPEED, FORCE"),
        (lambda g: g.autosend("POS", 60.0), "0.001 to 10 s"),
        (lambda g: Wsg50("127.0.0.1", timeout=0.0), "timeout is 0.0 s"),
    ],
)
def test_a_value_out_of_range_never_reaches_the_gripper(gripper, call, message):
    with pytest.raises(ConfigError, match=message):
        call(gripper)
    assert gripper.state().grip == GripState.IDLE


def test_every_code_has_a_meaning():
    assert len(MEANINGS) == 31
    assert MEANINGS[Code.ABORTED] == "aborted"
    assert MEANINGS[Code.RANGE] == "range"
    assert MEANINGS[26] == "pending"
    for code in range(31):
        assert f"(code {code})" in describe(code, "")
    assert describe(31, "31") == "31"
