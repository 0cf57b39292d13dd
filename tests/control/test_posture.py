"""The redundant joint: the elbow goes back to where the task began and stays there."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig

PERIOD = 2e-3
TASKS = ("XYZ:hold ABC:hold", "XYZ:hold A:free BC:hold")
WIDE = {"x_min": -2.0, "x_max": 2.0, "hardware": False}


class Loop:
    """An arm whose gravity compensation may be wrong, holding its tool."""

    def __init__(self, robot, q, task=TASKS[0], **osc):
        limits = LimitConfig.for_period(robot, PERIOD, **WIDE)
        self.robot, self.q_start = robot, q
        law = OscConfig(**osc)
        self.controller = make_controller(robot, law, limits, task, PERIOD)
        self.plant = _core.RigidPlant(
            robot.chain(), damping=limits.damping, armature=limits.armature
        )
        self.plant.reset(q, np.zeros(7))
        self.hold(q)

    def hold(self, q):
        pose = self.robot.tool_pose(q)
        self.controller.reset(q, pose.position, pose.quat_wxyz)

    def run(self, time, tau=0.0):
        """Run for a time [s] under a constant torque on every joint [Nm]."""
        for _ in range(round(time / PERIOD)):
            result = self.controller.step(*self.plant.read(), _core.Target())
            self.plant.apply(result.tau + tau, PERIOD)
        return self.plant.read()[0]


def null_motion(robot, q):
    """Unit joint motion that leaves the tool where it is."""
    return np.linalg.svd(robot.chain().jacobian(q))[2][-1]


@pytest.mark.parametrize("task", TASKS)
def test_a_pushed_elbow_comes_back(robot, q_home, task):
    loop = Loop(robot, q_home, task)
    n = null_motion(robot, q_home)
    pushed = loop.run(0.5, 12.0 * n)
    assert np.abs(n @ (pushed - q_home)) > 0.02
    back = loop.run(3.0)
    # In the metric of the inertia nothing is left of the way in the null space: a free
    # axis stays where it was pushed to.
    M = robot.chain().inertia_matrix(back) + 0.1 * np.eye(7)
    left = null_motion(robot, back) @ M @ (back - q_home)
    assert abs(left) < 0.01 * abs(n @ M @ (pushed - q_home))
    if "free" not in task:
        assert np.abs(back - q_home).max() < 2e-3


def test_without_it_the_elbow_stays_where_it_was_pushed(robot, q_home):
    loop = Loop(robot, q_home, posture_stiffness=0.0)
    n = null_motion(robot, q_home)
    pushed = loop.run(0.5, 12.0 * n)
    assert np.abs(n @ (loop.run(2.0) - pushed)) < np.abs(n @ (pushed - q_home))
    assert np.abs(loop.run(0.0) - q_home).max() > 0.05


def test_a_constant_torque_moves_it_by_what_the_stiffness_says(robot, q_home):
    n = null_motion(robot, q_home)
    moved = {
        k: abs(n @ (Loop(robot, q_home, posture_stiffness=k).run(6.0, n) - q_home))
        for k in (50.0, 200.0)
    }
    assert moved[50.0] < 0.2
    assert 0.2 < moved[200.0] / moved[50.0] < 0.3


@pytest.mark.parametrize("how", ["reset", "hold_at", "joint target"])
def test_it_is_latched_anew_where_a_task_begins(robot, q_home, how):
    loop = Loop(robot, q_home)
    loop.run(0.02)
    q_next = q_home + 0.1 * null_motion(robot, q_home)
    if how == "joint target":
        target = _core.Target(joint_mode=True, q_d=q_next)
        for _ in range(1500):
            result = loop.controller.step(*loop.plant.read(), target)
            loop.plant.apply(result.tau, PERIOD)
        pose = robot.tool_pose(loop.plant.read()[0])
        q_next = loop.plant.read()[0]
    else:
        pose = robot.tool_pose(q_next)
        loop.plant.reset(q_next, np.zeros(7))
        loop.controller.reset(q_home, pose.position, pose.quat_wxyz)
        loop.controller.step(q_home, np.zeros(7), _core.Target())
        if how == "reset":
            loop.hold(q_next)
        else:
            for _ in range(60):  # the arm is there after all
                loop.controller.step(q_next, np.zeros(7), _core.Target())
            loop.controller.hold_at(pose.position, pose.quat_wxyz)
    assert np.abs(loop.run(2.0) - q_next).max() < 5e-3
