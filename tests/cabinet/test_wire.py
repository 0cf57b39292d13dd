"""What is on the wire: signs, signals, transformations, and broken messages."""

import math

import numpy as np
import pytest

from dovetail import _core
from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.protocol import SessionState
from dovetail.cabinet.robot_controller import RobotController
from dovetail.cabinet.signals import parse_signal
from dovetail.cabinet.wire import Wire
from dovetail.cabinet.wrong_values import with_joint_values

from .client import ZERO, mirror, wait_until
from .conftest import Q_START, LightPlant

IDLE, WAIT, READY, C_WAIT, ACTIVE = SessionState
VERSIONS = ["1.15", "2.5", "2.7"]
TAU = [1.0, -2.0, 3.0, -4.0, 5.0, -0.5, 0.25]


class Direct:
    """A controller and a client without a network: one call is one period."""

    def __init__(self, plant=None, **changes):
        self.config = CabinetConfig(**changes)
        self.controller = RobotController(plant or LightPlant(), self.config)
        self.wire = Wire(self.controller)
        self.version = _core.fri_version(self.config.version)

    def pass_period(self, answer=mirror):
        self.controller.begin()
        message = _core.FriMonitoring.decode(self.version, self.wire.encode((7, 9)))
        command = answer(message)
        if command is not None:
            command.reflected = message.sequence
            bytes_ = command.encode(self.version)
            self.controller.receive(self.wire.decode(bytes_))
        self.controller.finish()
        return message

    def run_until(self, state, answer=mirror):
        for _ in range(1000):
            message = self.pass_period(answer)
            if int(message.state) == state:
                return message
        raise AssertionError(f"{SessionState(int(message.state)).name} after 1000")


def push_with(tau):
    def answer(message):
        command = mirror(message)
        if int(message.state) == ACTIVE:
            command.tau = tau
        return command

    return answer


def test_ready_takes_80_replies_and_active_follows():
    direct = Direct()
    direct.run_until(READY)
    assert direct.controller.sequence == 80
    direct.run_until(C_WAIT)
    assert direct.controller.sequence == 80 + 10
    direct.run_until(ACTIVE)
    assert direct.controller.sequence == 80 + 10 + 10


def test_measured_torque_is_the_load_and_external_torque_the_push():
    direct = Direct()
    message = direct.pass_period()
    gravity = direct.controller.body.gravity
    assert Q_START[1] > 0.0
    assert message.tau_measured[1] > 10.0  # leaning forward reads positive
    np.testing.assert_allclose(message.tau_measured, -gravity)
    np.testing.assert_allclose(message.tau_external, ZERO)
    direct.controller.push(np.array([0.0, 10.0, 0.0]), 1.0)
    direct.pass_period()
    message = direct.pass_period()
    assert message.tau_external[0] > 3.0  # +y at x > 0 turns A1 in + direction
    np.testing.assert_allclose(message.tau_external, message.tau_measured + gravity)


def test_commanded_torque_falls_when_the_command_rises():
    direct = Direct()
    direct.run_until(ACTIVE)
    direct.pass_period(push_with(TAU))
    message = direct.pass_period(push_with(TAU))
    np.testing.assert_allclose(message.tau_commanded, -np.array(TAU))


def test_signs_and_content_of_torques_are_settings():
    plain = Direct(measured_sign=1, commanded_sign=1, external_sign=-1)
    plain.run_until(ACTIVE)
    plain.pass_period(push_with(TAU))
    message = plain.pass_period()
    np.testing.assert_allclose(message.tau_commanded, TAU)
    assert message.tau_measured[1] < 0.0
    total = Direct(commanded_torque="total")
    total.run_until(ACTIVE)
    total.pass_period(push_with(TAU))
    gravity = total.controller.body.gravity
    message = total.pass_period()
    np.testing.assert_allclose(message.tau_commanded, -(np.array(TAU) + gravity))


def test_the_commanded_torque_is_the_overlay_alone_where_an_impedance_acts_too():
    stiff = {"stiffness": (200.0,) * 7, "damping": (0.7,) * 7}
    for content in ("overlay", "total"):
        plant = LightPlant()
        direct = Direct(plant, commanded_torque=content, **stiff)
        direct.run_until(ACTIVE)
        plant.q[:] += 0.01  # the impedance pulls back by 2 Nm
        for _ in range(2):
            direct.pass_period(push_with(TAU))
        overlay = direct.pass_period(push_with(TAU)).tau_commanded
        is_overlay = np.allclose(overlay, -np.array(TAU))
        assert is_overlay == (content == "overlay")


def test_a_command_accelerates_the_joint_in_its_direction():
    plant = LightPlant()
    direct = Direct(plant)
    direct.run_until(ACTIVE)
    before = plant.dq.copy()
    direct.pass_period(push_with(TAU))
    np.testing.assert_allclose(plant.dq - before, np.array(TAU) / 2.0 * 0.005)


def test_each_command_acts_from_its_message_to_the_next():
    plant = LightPlant()
    direct = Direct(plant)
    direct.run_until(C_WAIT)
    assert plant.applied == []
    direct.run_until(ACTIVE)
    torques = [[0.1 * i] * 7 for i in range(5)]
    for tau in torques:
        direct.pass_period(push_with(tau))
    np.testing.assert_array_equal([tau for tau, _ in plant.applied[1:]], torques)


def test_missed_commands_are_held_slow_the_arm_and_stop_the_motion():
    plant = LightPlant()
    direct = Direct(plant, hold_slots=3, stop_slots=6)
    direct.run_until(ACTIVE)
    direct.pass_period(push_with(TAU))
    plant.applied.clear()
    for _ in range(3):
        direct.pass_period(lambda message: None)
    assert [tau.tolist() for tau, _ in plant.applied] == [TAU] * 3
    for _ in range(3):
        assert direct.controller.application.has_motion
        before = plant.dq
        direct.pass_period(lambda message: None)
        assert np.linalg.norm(plant.dq) < np.linalg.norm(before)  # slowed down
    assert not direct.controller.application.has_motion
    message = direct.pass_period()
    assert int(message.state) == READY
    assert [int(d) for d in message.drive_states] == [0] * 7


def test_the_first_active_slot_without_a_command_acts_with_no_torque():
    plant = LightPlant()
    direct = Direct(plant)
    direct.run_until(C_WAIT, push_with(TAU))
    silent = push_with(TAU)
    direct.run_until(ACTIVE, lambda m: None if int(m.state) == ACTIVE else silent(m))
    (tau, _), *_ = plant.applied
    assert tau.tolist() == ZERO


def test_a_joint_over_its_speed_stops_the_motion():
    plant = LightPlant()
    direct = Direct(plant)
    direct.run_until(ACTIVE)
    plant.dq[:] = 2.5
    direct.pass_period()
    assert "joint speed: A1" in direct.controller.application.stop_reason
    for _ in range(20):
        direct.pass_period()
    assert direct.controller.body.is_braked
    assert direct.controller.status()["category"] == 0


def test_a_joint_over_its_limit_stops_the_motion():
    plant = LightPlant()
    direct = Direct(plant)
    direct.run_until(ACTIVE)
    plant.q[5] = 2.2
    direct.pass_period()
    assert "joint limit: A6" in direct.controller.application.stop_reason


def test_a_motion_starts_only_from_rest():
    plant = LightPlant()
    direct = Direct(plant, restart_delay=0.0, ready_slots=0)
    direct.run_until(ACTIVE)
    plant.dq[:] = 1.0
    direct.controller.stop_motion("for this test")
    while not direct.controller.body.is_braked:
        message = direct.pass_period()
        assert int(message.state) <= READY or plant.dq.max() == 1.0
    direct.run_until(ACTIVE)


@pytest.mark.parametrize(
    ("mode", "given", "missing"),
    [
        ("position", {}, {}),
        ("wrench", {"wrench": [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]}, {"wrench": None}),
    ],
)
def test_other_modes_want_other_commands(mode, given, missing):
    direct = Direct(mode=mode, stiffness=(200.0,) * 7, damping=(0.7,) * 7)

    def answer(message, values=given):
        command = _core.FriCommand()
        if int(message.state) >= C_WAIT:
            command.q = message.ipo_q
            for name, value in values.items():
                setattr(command, name, value)
        return command

    message = direct.run_until(ACTIVE, answer)
    assert _core.FriCommandMode(int(message.command_mode)).name == mode.upper()
    for _ in range(20):
        direct.pass_period(answer)
    assert direct.controller.state == ACTIVE
    if missing:
        direct.pass_period(lambda m: answer(m, missing))
        assert "without wrench" in direct.controller.application.stop_reason


@pytest.mark.parametrize("version", VERSIONS)
def test_signals_are_listed_read_and_written(version):
    texts = [
        "FRI.In_Bool_Clock_Enabled:boolean:input=1",
        "FRI.Out_Integer_Seconds:digital:output",
        "FRI.Out_Analog_Deci_Seconds:analog:output",
    ]
    direct = Direct(version=version, io=tuple(parse_signal(text) for text in texts))

    def write(message):
        command = _core.FriCommand()  # as KUKA's sample: no position at all
        command.io = [
            _core.FriIo("FRI.Out_Analog_Deci_Seconds", 2, 1, analog=1.5),
            _core.FriIo("FRI.Out_Integer_Seconds", 1, 1, digital=60),
        ]
        return command

    message = direct.pass_period(write)
    assert [signal.name for signal in message.io] == [t.split(":")[0] for t in texts]
    assert message.io[0].digital == 1
    message = direct.pass_period(write)
    assert message.io[1].digital == 60
    assert message.io[2].analog == 1.5
    assert direct.controller.signals.writes == 4
    direct.controller.signals.set("FRI.In_Bool_Clock_Enabled", 0)
    assert direct.pass_period().io[0].digital == 0


@pytest.mark.parametrize(
    ("write", "reason"),
    [
        (("FRI.Nothing", 1, 1, 5, None), "unknown signal 'FRI.Nothing'; registered"),
        (("FRI.In", 0, 1, 1, None), "which is an input"),
        (("FRI.Out", 1, 0, 5, None), "which is an input"),
        (("FRI.Out", 2, 1, None, 1.0), "as type 2, it is DIGITAL"),
        (("FRI.Out", 1, 1, None, None), "None"),
    ],
)
def test_a_wrong_write_is_refused(write, reason):
    signals = (
        parse_signal("FRI.In:boolean:input"),
        parse_signal("FRI.Out:digital:output"),
    )
    direct = Direct(io=signals)
    name, kind, direction, digital, analog = write

    def answer(message):
        command = _core.FriCommand()
        command.io = [_core.FriIo(name, kind, direction, digital, analog)]
        return command

    direct.pass_period(answer)
    assert reason in direct.controller.signals.last_refusal
    assert direct.controller.signals.values == {"FRI.In": 0.0, "FRI.Out": 0.0}
    assert direct.controller.signals.rejected == 1


@pytest.mark.parametrize("version", VERSIONS)
def test_transformations_are_requested_and_taken(version):
    direct = Direct(version=version, transformations=("tool", "camera"))
    numbers = [float(i) for i in range(12 if version == "1.15" else 7)]

    def answer(message):
        command = _core.FriCommand()
        command.transformations = [
            _core.FriTransformation(t.name, numbers, (1, 2))
            for t in message.requested_transformations
        ] + [_core.FriTransformation("stranger", numbers, (1, 2))]
        return command

    message = direct.pass_period(answer)
    assert [t.name for t in message.requested_transformations] == ["tool", "camera"]
    assert direct.controller.transformations == {"tool": numbers, "camera": numbers}
    assert direct.controller.counts["unknown_transformations"] == 1


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("count", [0, 6, 8, 14])
def test_another_number_of_values_is_refused_by_the_client(version, count):
    direct = Direct(version=version)
    direct.run_until(ACTIVE)
    direct.controller.begin()
    good = direct.wire.encode((7, 9))
    framed = version == "2.7"
    assert with_joint_values(good, 7, is_framed=framed) == good
    bad = with_joint_values(good, count, is_framed=framed)
    with pytest.raises(ValueError, match="values"):
        _core.FriMonitoring.decode(direct.version, bad)


def test_a_client_survives_messages_with_six_values(make, client):
    client.start()
    with make() as cabinet:
        client.wait_for(ACTIVE)
        cabinet.request({"do": "fault", "text": "values=6"})
        wait_until(lambda: client.undecodable > 0)
        cabinet.request({"do": "fault", "text": "none"})
        client.wait_for(ACTIVE)
        np.testing.assert_allclose(client.messages[-1].q_measured, Q_START, atol=1e-9)


def test_counters_wrap_as_on_the_wire():
    direct = Direct()
    direct.controller.next_sequence = 2**32 - 3
    for _ in range(6):
        direct.pass_period()
    assert direct.controller.sequence == 2
    assert direct.controller.counts["missed"] == 0


def test_default_axis_delta_is_ten_degrees():
    assert CabinetConfig().axis_delta_max == pytest.approx(math.radians(10.0))
