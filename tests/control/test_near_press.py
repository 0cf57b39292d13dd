"""Part of f* that near_press leaves: at its plane, above it, and beside a weight."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig

PERIOD = 1e-3
PRESS = 1.5  # m/s2
BAND = 0.002  # m, in which it comes to act whole


@pytest.fixture(scope="module")
def limits(robot):
    return LimitConfig.for_period(
        robot, PERIOD, hardware=False, x_min=-2.0, x_max=2.0, near_press=PRESS
    )


def asked(robot, limits, q, height, f_star, normal=(0.0, 0.0, 1.0), tare=0.0):
    """f* of the tool [m/s2] that one cycle asks for at a height over the plane."""
    controller = make_controller(
        robot, OscConfig(), limits, "XYZ:force ABC:hold", PERIOD
    )
    pose = robot.tool_pose(q)
    controller.reset(q, pose.position, pose.quat_wxyz)
    weight = np.array([0.0, 0.0, tare, 0.0, 0.0, 0.0])
    d = np.dot(normal, pose.position) - height
    target = _core.Target(f_star=np.append(f_star, np.zeros(3)) + weight)
    target.f_tare, target.near_plane = weight, np.append(normal, d)
    result = controller.step(q, np.zeros(7), target)
    return (robot.chain().jacobian(q) @ result.a0)[:3]


@pytest.mark.parametrize("tare", [0.0, 0.6])
@pytest.mark.parametrize(
    ("height", "down"), [(-0.01, -1.5), (0.0, -1.5), (0.5 * BAND, -2.25), (0.01, -3.0)]
)
def test_f_star_is_cut_below_the_plane_and_less_above_it(
    robot, limits, q_home, height, down, tare
):
    def f(limits, z):
        return asked(robot, limits, q_home, height, [0.5, -0.5, z], tare=tare)

    free = replace(limits, near_press=1000.0)
    np.testing.assert_allclose(f(limits, -3.0), f(free, down), atol=1e-9)
    np.testing.assert_array_equal(f(limits, 3.0), f(free, 3.0))  # away from it


def test_along_a_plane_that_is_tilted_nothing_is_cut(robot, limits, q_home):
    normal = np.array([0.6, 0.0, 0.8])
    free = replace(limits, near_press=1000.0)
    along = 3.0 * np.array([0.8, 0.0, -0.6])
    pressing = along - 2.5 * normal
    for f_star, left in ((along, along), (pressing, along - PRESS * normal)):
        np.testing.assert_allclose(
            asked(robot, limits, q_home, -0.01, f_star, normal),
            asked(robot, free, q_home, -0.01, left, normal),
            atol=1e-9,
        )


def test_without_walls_it_does_not_hold(robot, limits, q_home):
    off = replace(limits, walls=False)
    free = replace(off, near_press=1000.0)
    down = [0.0, 0.0, -3.0]
    np.testing.assert_array_equal(
        asked(robot, off, q_home, -0.01, down), asked(robot, free, q_home, -0.01, down)
    )


class Loaded:
    """An arm of the model, held still, whose tool a weight accelerates."""

    def __init__(self, robot, limits, q, weight):
        self.controller = make_controller(
            robot, OscConfig(), limits, "XYZ:force ABC:hold", PERIOD
        )
        self.chain, self.limits = robot.chain(), limits
        self.q, self.weight = q.copy(), np.array([0.0, 0.0, weight])
        self.pose = robot.tool_pose(q)
        self.controller.reset(q, self.pose.position, self.pose.quat_wxyz)

    def target(self, height, down, tare=0.0):
        """Press down beyond what holds the weight, at a height over the plane."""
        f_star = np.append([0.0, 0.0, -down] - self.weight, np.zeros(3))
        target = _core.Target(f_star=f_star)
        target.f_tare = np.array([0.0, 0.0, tare, 0.0, 0.0, 0.0])
        level = self.pose.position[2] - height
        target.near_plane = np.array([0.0, 0.0, 1.0, level])
        return target

    def stand(self, cycles, height):
        """Stand still under the weight."""
        target, dq = self.target(height, 0.0), np.zeros(7)
        M = self.chain.inertia_matrix(self.q) + np.diag(self.limits.armature)
        J = self.chain.jacobian(self.q)
        pull = J[:3].T @ np.linalg.solve(
            J[:3] @ np.linalg.solve(M, J[:3].T), self.weight
        )
        for _ in range(cycles):
            tau = self.controller.step(self.q, dq, target).tau
            dq = np.linalg.solve(M, tau + pull) * PERIOD
            self.q += dq * PERIOD

    def pressing(self, down, tare=0.0):
        """Acceleration into the plane below it, the weight's included [m/s2]."""
        target = self.target(-0.01, down, tare)
        result = self.controller.step(self.q, np.zeros(7), target)
        return -(self.chain.jacobian(self.q) @ result.a0)[2]


@pytest.mark.parametrize(("down", "left"), [(3.0, PRESS), (0.5, 0.5)])
@pytest.mark.parametrize("weight", [-3.0, -1.0, 1.75, 4.0])
def test_it_counts_from_what_holds_a_weight_that_was_felt_in_free_air(
    robot, limits, q_home, weight, down, left
):
    """An arm whose weight is missed presses as hard as one whose is not."""
    arm = Loaded(robot, limits, q_home, weight)
    arm.stand(1000, height=0.05)
    assert arm.pressing(down) == pytest.approx(left, abs=0.01)


def test_what_pulls_below_the_plane_is_contact_and_no_weight(robot, limits, q_home):
    arm = Loaded(robot, limits, q_home, 1.0)
    arm.stand(1000, height=-0.01)
    assert arm.pressing(3.0) == pytest.approx(PRESS - 1.0, abs=0.01)


def test_a_tare_is_taken_for_the_weight(robot, limits, q_home):
    arm = Loaded(robot, limits, q_home, 1.75)
    arm.stand(1000, height=0.05)
    assert arm.pressing(3.0, tare=-1.0) == pytest.approx(PRESS + 1.0 - 1.75, abs=0.01)


def test_a_weight_is_forgotten_where_the_arm_is_put_elsewhere(robot, limits, q_home):
    arm = Loaded(robot, limits, q_home, 1.75)
    arm.stand(1000, height=0.05)
    arm.controller.reset(q_home, arm.pose.position, arm.pose.quat_wxyz)
    assert arm.pressing(3.0) == pytest.approx(PRESS, abs=0.05)


def test_the_most_that_counts_as_weight_is_bounded(robot, limits, q_home):
    """A strong hand on the tool must not let it press without limit."""
    arm = Loaded(robot, limits, q_home, 8.0)
    arm.stand(1000, height=0.05)
    assert arm.pressing(20.0) == pytest.approx(PRESS + 5.0 - 8.0, abs=0.1)
