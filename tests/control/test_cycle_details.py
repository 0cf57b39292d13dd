"""Details of a cycle that closed loops forgive: memory, sides of flags, instants."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig

TASK = "XYZ:force A:pose BC:hold"
PERIOD = 5e-3  # the instants of a cycle are furthest apart


class Loop:
    """A controller on the exact arm."""

    def __init__(self, robot, q, limits, *, dq=None):
        self.robot = robot
        self.controller = make_controller(
            robot, OscConfig.for_period(PERIOD), limits, TASK, PERIOD
        )
        self.plant = _core.RigidPlant(
            robot.chain(),
            damping=limits.damping,
            armature=limits.armature,
        )
        self.plant.reset(q, np.zeros(7) if dq is None else dq)
        self.hold = robot.tool_pose(q)
        self.reset()

    def reset(self):
        q, dq = self.plant.read()
        pose = self.hold
        # where it was a period ago: the first sample is then what is expected
        self.controller.reset(q - PERIOD * dq, pose.position, pose.quat_wxyz, dq)

    def run(self, cycles, f_star=(0.0, 0.0, 0.0), *, lose=False, stay=0):
        target = _core.Target(f_star=np.append(f_star, np.zeros(3)))
        target.quat_wxyz_d = self.hold.quat_wxyz
        target.stay = stay
        taus = []
        for _ in range(cycles):
            q, dq = self.plant.read()
            if lose:
                q = np.full(7, np.nan)
            tau = self.controller.step(q, dq, target).tau
            self.plant.apply(tau, PERIOD)
            taus.append(tau)
        return np.array(taus)


@pytest.fixture
def limits(robot):
    return LimitConfig.for_period(robot, PERIOD)


@pytest.fixture
def open_space(limits):
    return replace(limits, walls=False)


def test_a_reset_leaves_nothing_of_what_was(robot, q_home, limits):
    """It once kept the disturbance, and only the arms' own tests saw it."""
    away = np.array([0.1, -0.1, 0.2, 0.0, 0.1, 0.0, 0.1])  # another posture, too
    used = Loop(robot, q_home + away, limits)
    used.run(20, stay=7)
    used.plant.set_external_force(np.array([0.0, 20.0, -30.0]))
    used.run(100, (2.0, -1.0, 1.0))
    assert np.abs(used.controller.disturbance).max() > 5.0  # Nm
    used.plant.set_external_force(np.zeros(3))
    used.run(40, stay=7)
    fresh = Loop(robot, q_home, limits)
    used.plant.reset(q_home, np.zeros(7))
    used.hold = fresh.hold
    used.reset()
    np.testing.assert_array_equal(used.controller.disturbance, np.zeros(7))
    for order in ({"stay": 7}, {"f_star": (1.0, 0.0, 0.0)}):
        np.testing.assert_array_equal(used.run(10, **order), fresh.run(10, **order))


def test_a_hold_after_a_reset_begins_without_what_pushed_before(robot, q_home, limits):
    """The last line's hold begins with the slow part of what pushed."""
    used, fresh = (Loop(robot, q_home, limits) for _ in range(2))
    used.plant.set_external_force(np.array([0.0, 20.0, -30.0]))
    used.run(100)
    too_fast = 1.1 * limits.dq_max * np.eye(7)[6]
    torques = []
    for loop in (used, fresh):
        pose = loop.hold
        elsewhere = q_home + 0.2  # in motion from where it was, it would go on
        loop.controller.reset(elsewhere, pose.position, pose.quat_wxyz, too_fast)
        result = loop.controller.step(elsewhere, too_fast, _core.Target())
        assert result.flags.ended
        torques.append(result.tau)
    np.testing.assert_array_equal(*torques)


@pytest.mark.parametrize("lost", [1, 2, 5])
def test_cycles_without_a_measurement_teach_the_estimate_nothing(
    robot, q_home, limits, lost
):
    """The first measurement after them once met the torque from before them."""
    loop = Loop(robot, q_home, limits)
    loop.run(30, (3.0, 2.0, -3.0))
    before = loop.controller.disturbance
    loop.run(lost, (-3.0, 2.0, 3.0), lose=True)
    np.testing.assert_array_equal(loop.controller.disturbance, before)
    loop.run(1, (-3.0, 2.0, 3.0))
    np.testing.assert_allclose(loop.controller.disturbance, before, atol=0.2)  # Nm


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("joint", range(7))
def test_a_joint_target_is_flagged_for_what_bounds_it_on_its_side(
    robot, q_home, open_space, joint, side
):
    """Beyond a limit the position bounds it; the other side has the acceleration."""
    q = q_home.copy()
    open_space = replace(open_space, delta_v=0.0)  # no speed bounds an arm at rest
    joints = open_space
    end = joints.q_max if side > 0 else joints.q_min
    q[joint] = end[joint] - side * (joints.delta_q + 0.01)
    target = _core.Target(joint_mode=True, q_d=q)
    q_d = q.copy()
    q_d[joint] = end[joint] + side * 1.0
    target.q_d = q_d
    loop = Loop(robot, q, open_space)
    flags = loop.controller.step(q, np.zeros(7), target).flags
    assert flags.joint_position == 1 << joint
    assert flags.joint_acceleration == 0
    q_d[joint] = end[joint] - side * 2.0  # away from it: nothing but A is in the way
    target.q_d = q_d
    flags = loop.controller.step(q, np.zeros(7), target).flags
    assert flags.joint_position == 0
    assert flags.joint_acceleration == 1 << joint


def test_bounds_are_those_of_the_measured_state(robot, q_home, limits, rng):
    """Half a period later the tool is up to 1 mm further: that is the margin's."""
    chain = robot.chain()
    near_wall = 0
    for _ in range(100):
        q = q_home + rng.uniform(-0.1, 0.1, 7)
        dq = rng.uniform(-0.3, 0.3, 7)
        p, v = chain.pose(q)[0], (chain.jacobian(q) @ dq)[:3]
        # walls where the tool is about to be
        low, high = np.array([0.03, 0.02, 0.04]), np.array([0.02, 0.04, 0.03])
        box = replace(limits, x_min=p - low, x_max=p + high)
        loop = Loop(robot, q, box, dq=dq)
        terms = loop.controller.osc_terms(q, dq)
        joints = tool = box
        shape = {"dt": PERIOD, "kappa": box.kappa}
        shape["authority"] = box.authority
        for low, high, x, speed, lowest, highest, most, a, eta, margin in (
            *zip(terms["cl"], terms["cu"], p, v, tool.x_min, tool.x_max, tool.dx_max,
                 tool.ddx_max, [tool.eta_wall] * 3, [tool.delta_x] * 3, strict=True),
            *zip(terms["lb"], terms["ub"], q, dq, joints.q_min, joints.q_max,
                 joints.dq_max, joints.ddq_max, [joints.eta] * 7, [joints.delta_q] * 7,
                 strict=True),
        ):  # fmt: skip
            bounds = _core.acceleration_bounds(
                x, speed, lowest, highest, most, a, **shape,
                eta=eta, delta_x=margin, delta_v=joints.delta_v,
            )  # fmt: skip
            np.testing.assert_allclose((low, high), bounds, atol=1e-6)
        near_wall += (terms["cu"] < tool.ddx_max).any()
    assert near_wall > 50
