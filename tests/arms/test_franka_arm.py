"""A Franka's address, the load that is set on it, and the words of its errors."""

import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.address import parse_address
from dovetail.arms.franka import arm as franka
from dovetail.arms.franka.reflexes import MODES, motion_ended, names_in, not_connected
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError, ConfigError
from dovetail.poses import Pose, quat_from_vector
from dovetail.robots.fr3 import fr3

from .stand_in import use_stand_in

AWAY = Pose(np.array([0.6, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))


def settings_for(robot):
    return ControllerSettings(
        osc=OscConfig(),
        limits=LimitConfig.for_period(robot, 1e-3, walls=False),
        task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
        period=1e-3,
    )


def test_an_address_says_all_but_the_period():
    address = parse_address("franka://172.16.0.2?realtime=yes&load=no&recover=yes")
    assert isinstance(address, franka.FrankaAddress)
    assert (address.host, address.period) == ("172.16.0.2", 1e-3)
    assert (address.realtime, address.load, address.recover) == (True, False, True)
    assert not address.approach
    assert address.is_real_time
    assert address.may_be_robot
    assert not address.places_fixture


@pytest.mark.parametrize(
    "text",
    [
        "franka://",
        "franka://h?speed=9",
        "franka://h?load=some",
        "franka://h?period=2ms",
    ],
)
def test_wrong_addresses_are_refused(text):
    with pytest.raises(ConfigError):
        parse_address(text)


@pytest.mark.parametrize("robot", ["iiwa14", "panda"])
def test_an_arm_that_is_no_research_3_is_refused(connect, robot):
    cell = find_cell(robot=robot)
    with pytest.raises(ConfigError, match="fr3"):
        parse_address("franka://127.0.0.1").build(
            cell, settings_for(cell.loaded_robot())
        )


def test_a_reflex_is_named_with_its_cause():
    text = (
        "libfranka: Move command aborted: motion aborted by reflex! "
        '["controller_torque_discontinuity"]'
    )
    assert names_in(text) == ["controller_torque_discontinuity"]
    error = motion_ended(text, 0.97)
    assert error.reason == "controller_torque_discontinuity"
    assert "97" in str(error)
    assert motion_ended("something else", 1.0).reason == "motion_ended"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("libfranka: Connection to FCI refused. Please install FCI", "fci_off"),
        ("libfranka: Incompatible library version", "version"),
        ("libfranka: Connection timeout", "no_route"),
        ("Poco: No route to host", "no_route"),
        ("something new", "no_arm"),
    ],
)
def test_a_connection_that_fails_says_which_step_is_missing(text, reason):
    error = not_connected(text, "172.16.0.2")
    assert error.reason == reason
    assert "172.16.0.2" in str(error)


def test_every_mode_without_motion_has_a_remedy_of_its_own():
    assert len({remedy for _, remedy in MODES.values()}) == len(MODES)


@pytest.fixture
def connect(monkeypatch):
    """Return a function that connects to libfranka's stand-in, at a host."""
    use_stand_in(monkeypatch)
    arms = []

    def make(host="127.0.0.1", approach="yes"):
        address = parse_address(f"franka://{host}?approach={approach}")
        arms.append(franka.FrankaArm(address, fr3(), settings_for(fr3())))
        return arms[-1]

    yield make
    for arm in arms:
        arm.close()


def test_a_learner_is_answered_within_some_cycles(connect):
    arm = connect()
    robot = arm.facts.robot
    state = arm.reset(robot.posture("down"), AWAY)
    target = _core.Target(quat_wxyz_d=state.tool.quat_wxyz)
    target.f_star = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    before = arm.statistics()["counts"].copy()
    for _ in range(10):
        state = arm.step(target)
        assert len(state.log) >= 50
    after = arm.statistics()["counts"]
    # Each step is 50 cycles, and what lies between two of them is a few.
    assert after["cycles"] - before["cycles"] < 10 * 150
    assert after["held"] == before["held"]
    assert np.isnan(state.contact_force).all()


def test_a_killed_learner_leaves_the_loop_ended_and_the_cause_named(connect, capfd):
    arm = connect()
    loop = arm._loop
    arm._pipe.close()  # as where its process is gone
    assert loop.wait(5.0) == 0
    assert capfd.readouterr().err.startswith("learner_gone: ")


def test_a_connection_that_is_lost_in_a_motion_has_a_name(connect):
    with pytest.raises(ArmError) as lost:
        connect("127.0.0.8").reset(fr3().posture("down"), AWAY)
    assert lost.value.reason == "connection_lost"


def hold_of(arm):
    """Reset the arm, and return a Target that keeps it there."""
    state = arm.reset(fr3().posture("down"), AWAY)
    return _core.Target(quat_wxyz_d=state.tool.quat_wxyz)


def test_a_loop_that_is_stopped_is_missed_and_another_one_begins(connect, monkeypatch):
    arm = connect()
    target = hold_of(arm)
    arm._loop.send_signal(signal.SIGSTOP)
    begin = time.monotonic()
    with monkeypatch.context() as patch:
        patch.setattr(franka, "_SILENCE", 0.5)
        with pytest.raises(ArmError) as missed:
            arm.step(target)
    assert missed.value.reason == "silence"
    assert time.monotonic() - begin < 2.5  # not the address's 10 s
    assert arm._loop.poll() is not None
    assert len(arm.step(hold_of(arm)).log) >= 50


def test_a_loop_that_hangs_says_where(connect, capfd):
    with pytest.raises(ArmError) as missed:
        hold_of(connect("127.0.0.9"))
    assert missed.value.reason == "silence"
    assert "in readOnce" in capfd.readouterr().err


def test_an_answer_that_came_while_the_learner_had_no_time_is_taken(
    connect, monkeypatch
):
    arm = connect()
    target, pipe = hold_of(arm), arm._pipe

    class Busy:
        has_slept = False

        def poll(self, timeout=0.0):
            if timeout == 0.0 or self.has_slept:
                return pipe.poll(timeout)
            self.has_slept = True
            time.sleep(1.0)
            return False

        def __getattr__(self, name):
            return getattr(pipe, name)

    monkeypatch.setattr(franka, "_SILENCE", 0.5)
    arm._pipe = Busy()
    assert len(arm.step(target).log) >= 50
    assert arm._pipe.has_slept


@pytest.mark.parametrize("how", ["killed", "closed"])
def test_an_arm_whose_loop_is_gone_says_so(connect, how):
    arm = connect()
    target = hold_of(arm)
    if how == "killed":
        arm._loop.send_signal(signal.SIGSTOP)
        arm.stop()  # an order that nobody reads
        arm._loop.kill()
        arm._loop.wait()
    else:
        arm.close()
    with pytest.raises(ArmError) as gone:
        arm.step(target)
    assert gone.value.reason == "loop_ended"


def test_ctrl_c_in_the_first_hold_leaves_no_loop(connect, monkeypatch):
    loops = []

    def interrupt(arm):
        loops.append(arm._loop)
        raise KeyboardInterrupt

    monkeypatch.setattr(franka.FrankaArm, "_hold", interrupt)
    with pytest.raises(KeyboardInterrupt):
        connect()
    assert loops[0].poll() is not None


FAR = fr3().posture("down") + np.array([1.0, 0, 0, 0, 0, 0, 0])
ASIDE = Pose(np.array([0.76, 0.0, 0.3]), quat_from_vector(np.array([0, np.pi / 2, 0])))
"""A fixture that opens away from the arm: out of it the way leaves the arm's reach."""
IN_IT = fr3().inverse_kinematics(
    Pose(np.array([0.74, 0.0, 0.3]), AWAY.quat_wxyz[[1, 0, 2, 3]]),
    fr3().posture("down"),
)


@pytest.mark.parametrize("is_anew", [False, True])
@pytest.mark.parametrize(
    ("q", "fixture", "reason"),
    [(FAR, AWAY, "far"), (IN_IT, ASIDE, "reset")],
)
def test_a_reset_that_is_refused_does_not_end_a_stop(
    connect, q, fixture, reason, is_anew
):
    arm = connect()
    hold_of(arm)
    if reason == "far":
        arm._address = replace(arm._address, approach=False)
    arm.stop()
    arm._left = None  # as where it was pushed since then
    if is_anew:  # the refused reset starts another loop
        arm._loop.kill()
        arm._loop.wait()
    with pytest.raises(ArmError) as refused:
        arm.reset(q, fixture)
    assert refused.value.reason == reason
    with pytest.raises(ArmError) as stopped:
        arm._follow(_core.Target(joint_mode=True, q_d=arm._seen.q), 50)
    assert stopped.value.reason == "stopped"
    assert hold_of(arm) is not None  # it is not refused


@pytest.mark.parametrize("is_anew", [False, True])
def test_a_stop_while_a_reset_begins_holds(connect, monkeypatch, is_anew):
    arm = connect()
    hold_of(arm)
    if is_anew:
        arm._loop.kill()
        arm._loop.wait()
    plan, known = franka.plan_reset, franka.require_known_load

    def stopped_meanwhile(*given):
        arm.stop()
        return known(*given) if is_anew else plan(*given)

    name = "require_known_load" if is_anew else "plan_reset"
    monkeypatch.setattr(franka, name, stopped_meanwhile)
    with pytest.raises(ArmError) as stopped:
        arm.reset(fr3().posture("down"), AWAY)
    assert stopped.value.reason == "stopped"
    assert arm._is_alive()


def test_a_second_loop_that_cannot_connect_says_what_the_first_would(connect):
    arm = connect()
    hold_of(arm)
    arm.close()
    arm._address = replace(arm._address, host="127.0.0.2")
    with pytest.raises(ArmError) as refused:
        hold_of(arm)
    assert refused.value.reason == "no_route"
    assert "counts" not in arm.statistics()


@pytest.mark.parametrize(
    ("host", "reason"), [("127.0.0.2", "no_route"), ("127.0.0.3", "user_stopped")]
)
def test_an_arm_that_cannot_be_had_says_why(connect, host, reason):
    with pytest.raises(ArmError) as refused:
        connect(host)
    assert refused.value.reason == reason
