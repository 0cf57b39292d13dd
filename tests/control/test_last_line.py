"""The last line in closed loop: a loop that a delay drives ends, and comes to rest.

What it sees of one joint's motion is tested in cpp/tests/test_last_line.cpp.
"""

import json
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import make
from dovetail.envs.unwrapped import require_contact_env
from dovetail.plants.plant import FLAG_MASK
from dovetail.poses import quat_from_vector, quat_multiply
from dovetail.tasks.shipped import DEFAULT_ENV

TASK = "XYZ:force ABC:hold"
DELAY = 0.010  # s
PUSH = np.array([20.0, 10.0, -10.0])  # N


class LateLoop:
    """The exact arm, whose torques arrive late, pushed from 0.1 s on."""

    def __init__(self, robot, q, period, **settings):
        wide = {"x_min": -2.0, "x_max": 2.0, "delay": DELAY, "hardware": False}
        self.limits = LimitConfig.for_period(robot, period, **(wide | settings))
        osc = OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3)
        self.controller = make_controller(robot, osc, self.limits, TASK, period)
        self.plant = _core.RigidPlant(
            robot.chain(),
            damping=self.limits.damping,
            armature=self.limits.armature,
        )
        self.plant.reset(q, np.zeros(7))
        pose = robot.tool_pose(q)
        self.controller.reset(q, pose.position, pose.quat_wxyz)
        self.period, self.time = period, 0.0
        self.late = deque([np.zeros(7)] * round(DELAY / period))

    def run(self, time):
        """Return the flags and the joint speeds [rad/s] of each cycle."""
        flags, speeds = [], []
        for _ in range(round(time / self.period)):
            self.time += self.period
            is_pushed = 0.1 < self.time < 1.0
            self.plant.set_external_force(PUSH if is_pushed else np.zeros(3))
            q, dq = self.plant.read()
            result = self.controller.step(q, dq, _core.Target())
            flags.append(result.flags)
            speeds.append(np.abs(dq).max())
            self.late.append(result.tau)
            self.plant.apply(self.late.popleft(), self.period)
        return flags, np.array(speeds)


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_an_estimate_that_is_too_quick_for_the_delay_is_ended(robot, q_home, period):
    loop = LateLoop(robot, q_home, period, estimate_rate=400.0)
    flags, _ = loop.run(4.0)
    ended = [f.ended for f in flags]
    assert any(ended)
    first = ended.index(True)
    assert all(ended[first:])
    assert [f.packed >> 46 & 1 for f in flags] == ended
    cause, joint, value, limit = loop.controller.end
    assert cause in ("oscillation", "energy", "force", "speed")
    assert -1 <= joint <= 6
    assert abs(value) > limit > 0.0
    _, speeds = loop.run(0.5)
    assert speeds.max() < 0.02  # at rest
    pose = robot.tool_pose(loop.plant.read()[0])
    loop.controller.reset(loop.plant.read()[0], pose.position, pose.quat_wxyz)
    assert loop.controller.end[0] == "none"


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_a_target_whose_rotation_jumps_to_and_fro_explains_the_swing(
    robot, rest_at, q_home, period
):
    """It is turned to at `turn_speed`, not at once."""
    limits = LimitConfig.for_period(robot, period, x_min=-2.0, x_max=2.0)
    osc = OscConfig.for_period(period, force_damping=[40.0] * 3 + [0.0] * 3)
    task = "XYZ:force ABC:pose"
    controller, plant, pose = rest_at(q_home, osc, limits, task, period)
    target = _core.Target()
    target.position_d = pose.position
    swings = 0.0
    for action in range(60):
        turn = quat_from_vector((-1) ** action * np.array([0.0, 0.0, 0.1]))  # rad
        target.quat_wxyz_d = quat_multiply(turn, pose.quat_wxyz)
        for _ in range(round(0.05 / period)):
            q, dq = plant.read()
            result = controller.step(q, dq, target)
            assert not result.flags.ended, controller.end
            plant.apply(result.tau, period)
            swings = max(swings, float(abs(dq[6] / robot.limits.dq_max[6])))
    assert 2.0 * swings > 0.105  # a swing that the last line would count


@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_the_declared_delay_gives_a_loop_that_needs_no_end(robot, q_home, period):
    loop = LateLoop(robot, q_home, period)
    flags, speeds = loop.run(2.0)
    assert not any(f.ended for f in flags)
    assert speeds.max() > 0.02  # it was pushed
    assert loop.controller.end == ("none", -1, 0.0, 0.0)


def test_switched_off_it_ends_nothing(robot, q_home):
    loops = [
        LateLoop(robot, q_home, 1e-3, estimate_rate=400.0, last_line=is_on)
        for is_on in (True, False)
    ]
    (_, ended), (flags, goes_on) = (loop.run(1.0) for loop in loops)
    assert not any(f.ended for f in flags)
    # Pushed on, the hold gives way, but smoothly.
    assert np.abs(np.diff(ended[500:])).max() < 5e-3
    assert np.abs(np.diff(goes_on[500:])).max() > 2e-2


def test_an_implausible_sample_has_its_bit(robot, q_home):
    loop = LateLoop(robot, q_home, 1e-3)
    jumped = q_home + 0.5 * np.eye(7)[2]
    flags = loop.controller.step(jumped, np.zeros(7), _core.Target()).flags
    assert flags.implausible
    assert flags.packed >> 45 & 1
    assert not flags.bad_input  # one is bridged, the second is a damped hold
    flags = loop.controller.step(jumped, np.zeros(7), _core.Target()).flags
    assert flags.packed >> 45 & 1
    assert flags.bad_input


def free_arm(robot, q, task="XYZABC:force", dq=None, **limits):
    """A controller at q and the exact arm."""
    dq = np.zeros(7) if dq is None else dq
    settings = LimitConfig.for_period(robot, 1e-3, **limits)
    controller = make_controller(robot, OscConfig(), settings, task, 1e-3)
    plant = _core.RigidPlant(
        robot.chain(),
        damping=settings.damping,
        armature=settings.armature,
    )
    plant.reset(q, dq)
    pose = robot.tool_pose(q)
    controller.reset(q - 1e-3 * dq, pose.position, pose.quat_wxyz, dq)
    return controller, plant


def ended(controller, plant, target, cycles):
    """What the last line ended the motion for within some cycles."""
    for _ in range(cycles):
        plant.apply(controller.step(*plant.read(), target).tau, 1e-3)
    return controller.end[0]


def outside_a_joint_limit(robot, q):
    q_max = robot.limits.q_max.copy()
    q_max[1] = q[1] - 0.1
    return free_arm(robot, q, q_max=q_max)


def test_work_of_limiters_is_seen(robot, q_home):
    """Outside a joint's limit nothing but a limiter drives the arm."""
    assert ended(*outside_a_joint_limit(robot, q_home), _core.Target(), 100) == "energy"


def test_the_way_of_a_joint_target_is_no_limiters_work(robot, q_home):
    """The power in the last cycle before it must not count on and on."""
    J = robot.chain().jacobian(q_home)
    dq = np.linalg.pinv(J) @ (0.2 * np.eye(6)[1])
    controller, plant = free_arm(robot, q_home, dq=dq, ddx_max=1.0, x_max=2.0)
    brake = _core.Target(f_star=-10.0 * np.eye(6)[1])
    assert ended(controller, plant, brake, 5) == "none"
    there = _core.Target(joint_mode=True, q_d=q_home + 0.3 * np.eye(7)[1])
    assert ended(controller, plant, there, 300) == "none"
    assert plant.read()[0][1] > q_home[1] + 0.01


def test_less_braking_than_was_asked_for_is_no_drive(robot, q_home):
    J = robot.chain().jacobian(q_home)
    dq = np.linalg.pinv(J) @ (0.3 * np.eye(6)[1])
    arm = free_arm(robot, q_home, dq=dq, ddq_max=1.0, walls=False)
    brake = _core.Target(f_star=-10.0 * np.eye(6)[1])
    assert ended(*arm, brake, 100) == "none"
    assert 0.0 < (J @ arm[1].read()[1])[1] < 0.3  # it does brake


def test_a_tare_that_changes_explains_what_it_changes(robot, q_home):
    """Near contact f* is cut to what the tare leaves: another tare, another motion."""
    period, half = 1e-3, 40
    wide = {"x_min": -2.0, "x_max": 2.0, "dx_max": 5.0, "near_speed": 0.1}
    limits = LimitConfig.for_period(robot, period, hardware=False, **wide)
    controller = make_controller(robot, OscConfig(), limits, TASK, period)
    plant = _core.RigidPlant(
        robot.chain(),
        damping=limits.damping,
        armature=limits.armature,
    )
    plant.reset(q_home, np.zeros(7))
    pose = robot.tool_pose(q_home)
    controller.reset(q_home, pose.position, pose.quat_wxyz)
    target = _core.Target(f_star=30.0 * np.eye(6)[1])
    target.near_plane = np.array([0.0, 0.0, 1.0, 9.0])
    for cycle in range(400):
        target.f_tare = 30.0 * (cycle // half % 2) * np.eye(6)[1]
        result = controller.step(*plant.read(), target)
        assert not result.flags.ended, controller.end
        plant.apply(result.tau, period)


def test_a_try_that_turned_the_peg_to_and_fro_is_not_ended():
    """It leaned on the rim, told 2 mm and 0.05 rad beside: 0.30 of 0.29 rad/s.

    The file has what a policy did there.
    """
    done = json.loads((Path(__file__).parent / "leaning_try.json").read_text())
    env = require_contact_env(make(DEFAULT_ENV, **done["settings"]))
    fixture = env.task.trial_poses[0].pose()
    env.reset(seed=1754190249, options={"fixture": fixture})
    for action in done["actions"]:
        env.step(np.array(action, dtype=np.float32))
        assert not env.state.flags & FLAG_MASK["ended"]
    env.close()
