"""What an arm over FRI does when the cabinet, the network or the learner fails."""

import errno
import socket
import time
from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.fri_arm import FriAddress, FriArm, servo_params
from dovetail.arms.fri_errors import socket_error
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError, ConfigError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, DynamicsConfig
from dovetail.poses import Pose, quat_about_z
from dovetail.settings import names_in
from facts import about

from .loopback import LOOPBACK, CabinetArm, free_port, make_cabinet

TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
TASK = "XYZ:force A:pose BC:hold"
PERIOD = 0.005
CELL = find_cell()
SETTINGS = ControllerSettings(
    osc=OscConfig(),
    limits=LimitConfig.for_period(CELL.loaded_robot(), PERIOD),
    task=TaskSpec.parse(TASK),
    period=PERIOD,
)
START = CELL.loaded_robot().inverse_kinematics(
    Pose(np.array([0.60, 0.0, 0.20]), TOOL_DOWN), Q_SEED
)
HOLD = _core.Target(joint_mode=True, q_d=START)


def end_of(arm):
    """The error with which the arm's steps end."""
    try:
        for _ in range(100):
            arm.step(HOLD)
    except ArmError as error:
        return error
    return pytest.fail("the arm's steps do not end")


def make_arm(**options):
    period = options.pop("period", PERIOD)
    osc = OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3)
    limits = LimitConfig.for_period(CELL.loaded_robot(), period)
    plant = make_plant("mujoco", CELL, DynamicsConfig())
    plant.reset(START, HOLE)
    return CabinetArm(plant, osc, limits, TASK, period, **options)


def alone(port=0, **options):
    """An arm without a cabinet."""
    names = set(names_in(FriAddress))
    where = {name: options.pop(name) for name in names & options.keys()}
    address = FriAddress(**{"host": LOOPBACK, "port": port, **where})
    return FriArm(address, CELL.loaded_robot(), SETTINGS, log_folder=None, **options)


def push(x, y=0.0, z=0.0):
    f_star = np.array([x, y, z, 0.0, 0.0, 0.0])
    return _core.Target(f_star=f_star, quat_wxyz_d=TOOL_DOWN)


@pytest.fixture
def arm(request):
    arm = make_arm(**getattr(request, "param", {}))
    yield arm
    arm.close()


def wait_until(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


# -- errors name their likely cause ---------------------------------------------------


def test_no_cabinet_says_what_to_check_in_order():
    arm = alone(timeout=0.2)
    with pytest.raises(
        ArmError, match=r"not one datagram.*1\..*2\..*3\..*4\."
    ) as error:
        arm.connect()
    assert error.value.reason == "no_cabinet"
    arm.close()


def test_port_in_use_is_said():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((LOOPBACK, 0))
        port = other.getsockname()[1]
        with pytest.raises(ArmError, match=f"UDP port {port} is in use") as error:
            alone(port)
    assert error.value.reason == "port_in_use"


def test_a_port_that_is_not_permitted_is_said(forbidden_port):
    with pytest.raises(ArmError, match="no permission to listen") as error:
        alone(forbidden_port)
    assert error.value.reason == "no_permission"


@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (errno.EADDRINUSE, "port_in_use"),
        (errno.EACCES, "no_permission"),
        (errno.EPERM, "no_permission"),
        (errno.EADDRNOTAVAIL, "no_address"),
    ],
)
def test_a_socket_error_is_told_by_its_number_in_any_language(number, reason):
    error = socket_error(OSError(number, "Die Adresse wird verwendet"), "10.0.0.1", 1)
    assert isinstance(error, ArmError)
    assert error.reason == reason


def test_any_other_socket_error_is_passed_on():
    error = socket_error(OSError(errno.EMFILE, "no more in use"), "10.0.0.1", 30200)
    assert isinstance(error, ConfigError)
    assert "10.0.0.1:30200: no more in use" in str(error)


def test_address_of_another_machine_is_refused():
    for host, words in (("192.0.2.1", "no address of this"), ("robot", "not of the")):
        with pytest.raises((ArmError, ConfigError), match=words):
            alone(host=host)


def test_wrong_version_is_named():
    arm = make_arm(version="1.15", cabinet={"version": "2.7"}, timeout=0.5)
    with pytest.raises(ArmError, match=r"none is FRI 1\.15.*2\.7") as error:
        arm.connect()
    assert error.value.reason == "version"
    arm.close()


def test_strangers_beside_a_pinned_cabinet_are_named():
    port = free_port()
    arm = alone(port, timeout=0.5, peer="127.0.0.2")
    plant = make_plant("mujoco", CELL, DynamicsConfig())
    plant.reset(START, HOLE)
    named = pytest.raises(ArmError, match=r"last from 127\.0\.0\.1:.*peer=")
    with make_cabinet(plant, port, PERIOD), named as error:
        arm.connect()
    assert error.value.reason == "foreign"
    arm.close()


def test_another_period_is_named_and_never_commanded():
    port = free_port()
    arm = alone(port, timeout=2.0)
    plant = make_plant("mujoco", CELL, DynamicsConfig())
    plant.reset(START, HOLE)
    with make_cabinet(plant, port, 0.01) as cabinet:
        with pytest.raises(ArmError, match=r"every 10 ms x 1.*made for 5 ms") as error:
            arm.connect()
        assert cabinet.request({"do": "status"})["stop_reason"] == ""
    assert error.value.reason == "period"
    arm.close()


def test_a_cabinet_that_starts_no_motion_is_named(arm):
    arm._timeout = 1.0
    arm.ask("pause")
    with pytest.raises(ArmError, match="MONITORING_READY") as error:
        arm.connect()
    assert error.value.reason == "session"


def servo_with(**values):
    servo = servo_params(PERIOD)
    for name, value in values.items():
        setattr(servo, name, value)
    return servo


def test_settings_are_refused_by_name():
    for options, words in (
        ({"version": "3.0"}, "version is '3.0'; known: 1.15, 2.5, 2.7"),
        ({"timeout": "3s"}, "timeout is '3s'"),
        ({"timeout": -1.0}, "timeout is -1 s"),
        ({"approach": "no"}, "approach is 'no'"),
        ({"realtime": 1}, "realtime is 1"),
        ({"measured_sign": 2}, "measured_sign is 2"),
        ({"margins": "none"}, "margins is 'none'"),
        ({"clock": "sundial"}, "known: wall, lockstep"),
        ({"reset": "place"}, "needs control=HOST:PORT"),
        ({"servo": servo_with(observer_gain=2.0)}, "observer gain is 2"),
        ({"servo": servo_with(position_filter=0.0)}, "position_filter is 0"),
    ):
        with pytest.raises(ConfigError, match=words):
            alone(**options)
    with pytest.raises(ConfigError, check=about("external_torque")):
        WatchdogConfig(external_torque=0.0)


def test_step_before_reset_is_refused(arm):
    with pytest.raises(ArmError, match="call reset first"):
        arm.step(push(0.0))


# -- motions end and begin ------------------------------------------------------------


def test_a_motion_that_ends_is_an_error_and_reset_goes_on(arm):
    arm.reset(START, HOLE)
    arm.step(push(1.0))
    arm.ask("pause")
    with pytest.raises(ArmError, match="the motion has ended") as error:
        arm.step(push(1.0))
    assert error.value.reason == "motion_ended"
    arm.ask("resume")
    arm.reset(START, HOLE)
    assert arm.step(push(1.0)).log.shape[0] == 10


def test_a_new_session_needs_no_new_arm(arm):
    arm.reset(START, HOLE)
    arm.step(push(1.0))
    arm.ask("stop")
    wait_until(lambda: arm.monitoring().session == 0)
    arm.ask("resume")
    arm.reset(START, HOLE)
    state = arm.step(push(1.0))
    assert state.stamp == pytest.approx(0.05)


def test_a_motion_that_ends_while_the_arm_is_placed_is_not_stepped_in():
    """Messages came late on a busy machine: the motion before still seemed to run."""
    for _ in range(5):
        arm = make_arm(clock="wall", cabinet={"clock": "wall"})
        place = arm._control.place

        def place_in_motion(*where, arm=arm, place=place):
            wait_until(lambda: arm.monitoring().session == 4)
            arm.ask("fault", text="delay=4.5ms,direction=to_client")
            answer = place(*where)
            arm.ask("fault", text="none")
            return answer

        arm._control.place = place_in_motion
        try:
            arm.reset(START, HOLE)
            arm.step(push(1.0))
        finally:
            arm.close()


def test_a_new_motion_begins_without_the_old_target(arm):
    arm.reset(START, HOLE)
    for _ in range(10):
        arm.step(push(2.0))
    before = arm.reset(START, HOLE)
    np.testing.assert_allclose(before.q, START, atol=1e-9)
    assert np.abs(before.dq).max() == 0.0
    after = arm.step(push(0.0))
    np.testing.assert_allclose(after.q, START, atol=1e-4)


@pytest.mark.parametrize("version", ["2.5", "2.7"])
def test_other_versions_move_alike(version):
    logs = []
    for v in ("1.15", version):
        arm = make_arm(version=v, cabinet={"version": v})
        arm.reset(START, HOLE)
        logs.append(np.concatenate([arm.step(push(1.0)).log for _ in range(5)]))
        arm.close()
    np.testing.assert_array_equal(logs[0], logs[1])


def test_a_receive_multiplier_gives_the_period_of_two_messages():
    arm = make_arm(period=0.004)
    arm.close()
    osc = OscConfig.for_period(0.004, force_damping=[16.0] * 3 + [0.0] * 3)
    limits = LimitConfig.for_period(CELL.loaded_robot(), 0.004)
    plant = make_plant("mujoco", CELL, DynamicsConfig())
    plant.reset(START, HOLE)
    port = free_port()
    settings = {"receive_multiplier": 2, "clock": "lockstep"}
    with make_cabinet(plant, port, 0.002, **settings) as cabinet:
        address = FriAddress(
            host=LOOPBACK,
            port=port,
            clock="lockstep",
            control=str(cabinet.control_address),
        )
        four = replace(SETTINGS, osc=osc, limits=limits, period=0.004)
        arm = FriArm(address, CELL.loaded_robot(), four, log_folder=None)
        before = arm.reset(START, HOLE)
        for _ in range(10):
            state = arm.step(push(2.0), duration=0.04)
        assert state.log.shape[0] == 10
        np.testing.assert_allclose(np.diff(state.log[:, 0]), 0.004, atol=1e-9)
        assert state.tool.position[0] - before.tool.position[0] > 0.02
        arm.close()


def test_a_learner_that_thinks_for_long_finds_its_motion_again():
    arm = make_arm(silence=0.2)
    arm.reset(START, HOLE)
    time.sleep(0.5)
    assert arm.step(push(1.0)).log.shape[0] == 10
    time.sleep(0.5)
    assert arm.step(push(1.0)).log.shape[0] == 10
    assert arm.statistics()["counts"]["silences"] == 0
    arm.close()


# -- the network ----------------------------------------------------------------------


def test_foreign_datagrams_are_counted_and_change_nothing(arm):
    arm.reset(START, HOLE)
    arm.step(push(1.0))
    message = _core.FriMonitoring()
    version = _core.fri_version("1.15")
    before = arm.monitoring()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for payload in (b"", b"\x00" * 3000, b"hello", message.encode(version)):
            for _ in range(5):
                stranger.sendto(payload, (LOOPBACK, arm.port))
        wait_until(lambda: arm.statistics()["counts"]["foreign"] == 20)
        stranger.settimeout(0.05)
        with pytest.raises(TimeoutError):
            stranger.recv(2000)
    after = arm.monitoring()
    assert (after.tick, after.session) == (before.tick, before.session)
    assert arm.step(push(1.0)).log.shape[0] == 10
    counts = arm.statistics()["counts"]
    assert counts["undecodable"] == 0
    assert counts["motions"] == 1


def test_lost_doubled_and_late_messages_leave_time_right():
    arm = make_arm(cabinet={"patience": 0.05, "stop_slots": 50})
    arm.reset(START, HOLE)
    arm.ask("fault", text="loss=0.05,duplicate=0.05,reorder=0.05")
    rows = [arm.step(push(0.5)).log for _ in range(20)]
    arm.ask("fault", text="")
    log = np.concatenate(rows)
    counts = arm.statistics()["counts"]
    assert counts["missed"] > 0
    assert counts["duplicates"] > 0
    steps = np.diff(log[:, 0]) / PERIOD
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert steps.max() > 1.5
    speed = np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1])
    assert (speed < CELL.loaded_robot().limits.dq_max).all()
    arm.close()
