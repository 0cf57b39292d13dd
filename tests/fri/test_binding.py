import numpy as np
import pytest

from dovetail import _core

V1_15, V2_5, V2_7 = (
    _core.FriVersion.V1_15,
    _core.FriVersion.V2_5,
    _core.FriVersion.V2_7,
)

# Bytes of KUKA's own client, not of this encoder.
Q_BYTES = (
    "09 0000000000000000 09 9a9999999999b93f 09 9a9999999999c93f 09 343333333333d33f"
    "09 9a9999999999d93f 09 000000000000e03f 09 343333333333e33f"
)
Z_BYTES = "09 0000000000000000" * 7
TORQUE = "0a0a 0881800d 108301 188301 128201 0a3f" + Q_BYTES + "1a3f" + Z_BYTES
MONITORING = (
    "0a09 08c2a29101 1000 1800 1216 0807 1000" + "2800" * 7 + "3002 3803"
    "1ad302 0a3f"
    + Q_BYTES
    + "123f"
    + Z_BYTES
    + "1a3f"
    + Q_BYTES
    + "223f"
    + Z_BYTES
    + "2a3f"
    + Z_BYTES
    + "7a0c 0887d683d806 10e389fba603"
    "2208 0801 1000 1805 2001 2a0d 5000 5800 61 0000000000000000"
)
Q = np.array([0.0, 0.1, 0.2, 3 * 0.1, 0.4, 0.5, 2 * (3 * 0.1)])


def test_the_golden_command_is_written_and_read():
    command = _core.FriCommand()
    command.sequence = command.reflected = 131
    command.q, command.tau = Q, np.zeros(7)
    assert command.encode(V1_15) == bytes.fromhex(TORQUE)
    framed = bytes.fromhex("91000000" + TORQUE + "ea09d3bb")
    assert command.encode(V2_7) == framed
    read = _core.FriCommand.decode(V2_7, framed)
    assert read == command
    assert read.q.tolist() == Q.tolist()
    assert read.wrench is None


def test_the_golden_monitoring_message_is_read_and_written_again():
    data = bytes.fromhex(MONITORING)
    assert len(data) == 402
    message = _core.FriMonitoring.decode(V1_15, data)
    assert message.encode(V1_15) == data
    assert message.q_commanded.tolist() == Q.tolist()
    assert message.stamp == (1795222279, 887014627)
    assert message.state == _core.FriState.MONITORING_WAIT == 1
    assert (message.send_period_ms, message.receive_multiplier) == (5, 1)
    assert message.drive_states == [0] * 7
    assert message.operation_mode == _core.FriOperationMode.AUT
    assert message.ipo_q is None
    assert message.tracking == 0.0


def test_plain_numbers_and_none_are_taken():
    message = _core.FriMonitoring()
    assert message.state is None
    message.state, message.quality, message.command_mode = 4, 3, 3
    message.q_measured = list(range(7))
    message.q_measured = None
    message.drive_states = [2] * 7
    message.io = [_core.FriIo("FRI.Out", 2, 1, analog=1.5)]
    message.requested_transformations = [_core.FriTransformation("tool")]
    read = _core.FriMonitoring.decode(V2_5, message.encode(V2_5))
    assert read == message
    assert read.io[0].name == "FRI.Out"
    assert read.io[0].analog == 1.5
    assert read.requested_transformations[0].name == "tool"
    message.state = None
    assert message.quality is None


@pytest.mark.parametrize("count", [0, 6, 8])
def test_seven_joint_values_are_needed(count):
    command = _core.FriCommand()
    with pytest.raises(ValueError, match=f"tau has {count} values, 7 are needed"):
        command.tau = np.zeros(count)


def test_what_cannot_be_sent_is_refused():
    command = _core.FriCommand()
    command.q = np.full(7, np.nan)
    with pytest.raises(ValueError, match="not finite"):
        command.encode(V1_15)
    with pytest.raises(ValueError, match="state is 5, allowed is 0 to 4"):
        _core.FriMonitoring().state = 5
    with pytest.raises(ValueError, match="64 bytes, at most 63"):
        _core.FriTransformation("x" * 64)
    with pytest.raises(ValueError, match="io has 11 elements, at most 10"):
        command.io = [_core.FriIo("a", 0, 1)] * 11


def test_another_versions_datagram_is_recognised():
    command = _core.FriCommand()
    with pytest.raises(ValueError, match=r"looks like FRI 2\.7"):
        _core.FriCommand.decode(V1_15, command.encode(V2_7))
    with pytest.raises(ValueError, match=r"looks like FRI 1\.15 or 2\.5"):
        _core.FriCommand.decode(V2_7, command.encode(V1_15))
    with pytest.raises(ValueError, match="a command, not a monitoring message"):
        _core.FriMonitoring.decode(V1_15, command.encode(V1_15))
    with pytest.raises(ValueError, match="an empty datagram"):
        _core.FriMonitoring.decode(V1_15, b"")


def test_versions_are_known_by_name():
    assert _core.fri_version("1.16") == V1_15
    assert _core.fri_version("2.7") == V2_7
    with pytest.raises(ValueError, match=r"'3\.0' is unknown: 1\.11, 1\.14"):
        _core.fri_version("3.0")
