"""An arm over FRI by the clock: the watchdog, stops, resets that move, logs."""

import resource
import time
from contextlib import suppress

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.reset_motion import LIFT, plan_reset
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.errors import ArmError
from dovetail.plants.plant import COLUMN, FLAG_MASK
from dovetail.poses import Pose, matrix_from_quat, quat_from_vector
from dovetail.robots.iiwa14 import iiwa14
from dovetail.tasks.peg_in_hole.task import PegInHole

from .test_fri_session import CELL, HOLE, START, TOOL_DOWN, make_arm, push, wait_until

LATE, STOPPED = FLAG_MASK["target_late"], FLAG_MASK["stopped"]
PATIENT = {
    "stop_slots": 400,
    "hold_slots": 100,
    "fair_from": 0.0,
    "good_from": 0.05,
    "misses_max": 400,
}
"""The machine may be busy: the cabinet forgives 2 s without an answer."""


@pytest.fixture
def arm(tmp_path):
    arm = make_arm(clock="wall", cabinet=PATIENT, log_folder=tmp_path / "logs")
    yield arm
    arm.close()


def flags_since(arm, row):
    log = arm._servo.rows(row, arm.monitoring().rows, len(COLUMN))
    return log[:, COLUMN["flags"]].astype(np.int64), log


def test_a_step_takes_as_long_as_it_says(arm):
    arm.reset(START, HOLE)
    begin = time.monotonic()
    for _ in range(10):
        state = arm.step(push(0.5))
    assert 0.4 < time.monotonic() - begin < 2.0
    assert state.stamp == pytest.approx(0.5, abs=0.1)
    assert state.tool.position[0] > 0.6


def test_a_long_step_is_no_missing_target(arm):
    arm.reset(START, HOLE)
    state = arm.step(push(0.2), duration=0.4)
    assert not state.flags & LATE


def test_a_learner_that_vanishes_leaves_the_arm_held(arm):
    arm.reset(START, HOLE)
    for _ in range(6):
        arm.step(push(1.5))
    row = arm.monitoring().rows
    wait_until(lambda: arm.monitoring().is_at_rest)
    flags, log = flags_since(arm, row)
    late = np.flatnonzero(flags & LATE)
    assert late.size
    # 150 ms after the Target came, which was 50 ms before the step's end
    assert log[late[0], 0] - log[0, 0] == pytest.approx(0.10, abs=0.06)
    assert np.abs(arm.monitoring().dq).max() < 0.05
    rest = arm.monitoring().q
    time.sleep(0.5)
    np.testing.assert_allclose(arm.monitoring().q, rest, atol=5e-3)
    assert arm.statistics()["counts"]["holds"] == 1
    state = arm.step(push(0.5))  # the next learner goes on
    assert not arm.monitoring().is_held
    assert state.log.shape[0] >= 10


def test_stop_brakes_and_holds_until_cleared(arm, tmp_path):
    arm.reset(START, HOLE)
    for _ in range(6):
        arm.step(push(1.5))
    arm.stop()
    with pytest.raises(ArmError, match="a stop was asked for") as error:
        arm.step(push(1.5))
    assert error.value.reason == "requested"
    wait_until(lambda: arm.monitoring().is_at_rest)
    with pytest.raises(ArmError, match="clear"):
        arm.step(push(1.5))
    arm.clear()
    wait_until(lambda: not arm.monitoring().is_stopped)
    state = arm.step(push(0.5))
    assert state.flags & STOPPED  # of the cycles since the step before
    assert not int(state.log[-1, COLUMN["flags"]]) & STOPPED
    wait_until(lambda: list((tmp_path / "logs").glob("fri-*-requested.csv")))
    path = next((tmp_path / "logs").glob("fri-*-requested.csv"))
    head = path.read_text().splitlines()
    assert head[0] == "# a stop was asked for"
    assert head[1].split(",") == _core.servo_columns()
    assert any(str(path) in note for note in arm.statistics()["notes"])


FAR = START + 0.6 * np.eye(7)[6]
ASIDE = Pose(np.array([0.76, 0.0, 0.2]), quat_from_vector(np.array([0, np.pi / 2, 0])))
"""A fixture that opens away from the arm: out of it the way leaves the arm's reach."""
IN_IT = CELL.loaded_robot().inverse_kinematics(
    Pose(np.array([0.74, 0.0, 0.2]), TOOL_DOWN), START
)
NO_POSE = Pose(HOLE.position, np.zeros(4))


@pytest.mark.parametrize(
    ("way", "start", "fixture", "reason"),
    [
        ("place", START, NO_POSE, "refused"),
        ("move", FAR, HOLE, "far"),
        ("move", IN_IT, ASIDE, "reset"),
    ],
)
def test_a_reset_that_is_refused_does_not_end_a_stop(way, start, fixture, reason):
    arm = make_arm(clock="wall", reset=way, cabinet=PATIENT)
    arm.reset(START, HOLE)
    arm.stop()
    wait_until(lambda: arm.monitoring().is_at_rest)
    arm._left = None  # as where it was pushed since then
    if start is IN_IT:  # where no simulated fixture can be
        arm._approach, arm._control = True, None
    with pytest.raises(ArmError) as refused:
        arm.reset(start, fixture)
    assert refused.value.reason == reason
    with pytest.raises(ArmError) as stopped:
        arm.step(push(0.0))
    assert stopped.value.reason == "requested"
    arm.reset(START, HOLE)
    arm.step(push(0.0))
    arm.close()


@pytest.mark.parametrize("way", ["place", "move"])
def test_a_stop_while_a_reset_begins_holds(way, monkeypatch):
    arm = make_arm(clock="wall", reset=way, cabinet=PATIENT)
    arm.reset(START, HOLE)
    asked = arm._control.request

    def stopped_meanwhile(do, **what):
        arm.stop()
        return asked(do, **what)

    monkeypatch.setattr(arm._control, "request", stopped_meanwhile)
    with suppress(ArmError):  # one that moves the arm says so at once
        arm.reset(START, HOLE)
    with pytest.raises(ArmError) as stopped:
        arm.step(push(0.0))
    assert stopped.value.reason == "requested"
    arm.close()


def test_a_push_stops_the_arm(tmp_path):
    watchdog = WatchdogConfig(external_torque=0.1)
    arm = make_arm(clock="wall", cabinet=PATIENT, watchdog=watchdog)
    arm.reset(START, HOLE)
    arm.step(push(0.0))
    arm.ask("push", force=[60.0, 0.0, 0.0], duration=0.3)
    with pytest.raises(ArmError, match=r"external torque of A\d is .* Nm") as error:
        arm.step(push(0.0), duration=1.0)
    assert error.value.reason == "external_torque"
    wait_until(lambda: arm.monitoring().is_at_rest)
    arm.reset(START, HOLE)
    assert not arm.monitoring().is_stopped
    arm.close()


def test_a_reset_that_moves_arrives_below_the_limits():
    arm = make_arm(clock="lockstep", reset="move")
    arm.reset(START, HOLE)
    for _ in range(20):
        arm.step(push(1.0, 1.0, -0.5))
    row = arm.monitoring().rows
    state = arm.reset(START, HOLE)
    np.testing.assert_allclose(state.q, START, atol=0.02)
    assert state.stamp == 0.0
    log = arm._servo.rows(row, arm.monitoring().rows, len(COLUMN))
    assert (np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]) < 0.6).all()
    assert arm.monitoring().motion == 1
    assert arm.step(push(0.0)).log[0, 0] == pytest.approx(0.0, abs=1e-9)
    arm.close()


def test_the_way_back_goes_straight_up_out_of_the_hole():
    from dovetail.envs.registered import find_cell
    from dovetail.poses import Pose

    robot = find_cell().loaded_robot()
    inserted = robot.inverse_kinematics(
        Pose(HOLE.position - np.array([0.0, 0.0, 0.02]), np.array([0, 1.0, 0, 0])),
        START,
    )
    start = robot.inverse_kinematics(
        Pose(np.array([0.55, 0.08, 0.14]), np.array([0, 1.0, 0, 0])), START
    )
    path = plan_reset(robot, inserted, start, HOLE)
    tips = np.array([robot.tool_pose(q).position for q in path])
    assert np.abs(np.diff(path, axis=0)).max() < 0.05
    below = tips[tips[:, 2] < HOLE.position[2] + 0.5 * LIFT]
    np.testing.assert_allclose(below[:, :2], np.tile([0.6, 0.0], (len(below), 1)),
                               atol=1e-4)  # fmt: skip
    assert tips[:, 2].max() > HOLE.position[2] + 0.9 * LIFT
    np.testing.assert_allclose(path[-1], start)


@pytest.mark.parametrize("facing", ["up", "robot"])
def test_out_of_a_fixture_that_does_not_open_upwards_it_goes_along_its_axis(facing):
    task = PegInHole(facing=facing, tilt=0.2)
    robot = task.workcell(iiwa14()).loaded_robot()
    fixture = task.trial_poses[0].pose()
    axis = matrix_from_quat(fixture.quat_wxyz)[:, 2]
    goal, posture = task.goal(fixture), robot.posture(task.posture)
    inserted = robot.inverse_kinematics(Pose(goal.position, goal.quat_wxyz), posture)
    start = task.draw_start(np.random.default_rng(0), fixture)
    q_start = robot.inverse_kinematics(start, posture)
    path = plan_reset(robot, inserted, q_start, fixture)
    assert np.abs(np.diff(path, axis=0)).max() < 0.05
    ways = np.array([robot.tool_pose(q).position for q in path]) - fixture.position
    heights = ways @ axis
    in_front = int(np.argmax(heights > 0.5 * LIFT))
    beside = np.linalg.norm(ways - np.outer(heights, axis), axis=1)
    assert beside[:in_front].max() < 1e-4
    assert heights[in_front:].max() > 0.9 * LIFT
    np.testing.assert_allclose(path[-1], q_start)


def test_real_time_that_is_refused_is_a_note_and_no_error(no_privileges):
    arm = make_arm(clock="lockstep", realtime=True, processor=0)
    arm.reset(START, HOLE)
    assert arm.step(push(0.0)).log.shape[0] == 10
    notes = arm.statistics()["notes"]
    if resource.getrlimit(resource.RLIMIT_RTPRIO)[0] == 0:
        assert any("SCHED_FIFO priority" in note for note in notes)
    for note in notes:
        assert "going on without it" in note
    arm.close()
