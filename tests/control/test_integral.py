"""The integral term removes a steady offset, and in contact presses little harder."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.config import LimitConfig, OscConfig

PERIODS = [1e-3, 2e-3, 2.5e-3, 5e-3]
OSC = OscConfig()
NO_INTEGRAL = {"integral_clamp_linear": 0.0, "integral_clamp_angular": 0.0}


class Held:
    """An exact arm that holds a pose, with a force at the tool's place."""

    def __init__(self, robot, rest_at, q, period, task="XYZABC:pose", **settings):
        self.robot, self.period = robot, period
        limits = LimitConfig.for_period(robot, period)
        osc = OscConfig.for_period(period, **settings)
        self.controller, self.plant, self.start = rest_at(q, osc, limits, task, period)
        M = robot.chain().inertia_matrix(q) + np.diag(limits.armature)
        J = robot.chain().jacobian(q)
        self.mobility = J @ np.linalg.solve(M, J.T)  # 1/kg

    def run(self, seconds, force, below=0.0, tare=None):
        """Return the tool's way from the start [m]; force [N] at a way [m]."""
        wanted = self.start.position - np.array([0.0, 0.0, below])
        command = _core.Target(position_d=wanted, quat_wxyz_d=self.start.quat_wxyz)
        if tare is not None:
            command.f_star = command.f_tare = tare
        way = np.zeros(3)
        for _ in range(round(seconds / self.period)):
            q, dq = self.plant.read()
            way = self.robot.tool_pose(q).position - self.start.position
            self.plant.set_external_force(force(way))
            self.plant.apply(self.controller.step(q, dq, command).tau, self.period)
        return way


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("mode", ["pose", "hold"])
def test_a_pull_within_the_bound_leaves_no_offset(robot, rest_at, q_home, period, mode):
    def pull(_):
        return np.array([0.0, 0.4, -1.0])  # N

    plain = Held(robot, rest_at, q_home, period, f"XYZABC:{mode}", **NO_INTEGRAL).run(
        2.0, pull
    )
    way = Held(robot, rest_at, q_home, period, f"XYZABC:{mode}").run(2.0, pull)
    assert np.abs(plain).max() > 0.15e-3  # m
    assert np.abs(way).max() < 2e-5


@pytest.mark.parametrize("period", PERIODS)
def test_a_larger_pull_leaves_what_is_over_the_bound(robot, rest_at, q_home, period):
    arm = Held(robot, rest_at, q_home, period)
    force = np.array([0.0, 0.0, -15.0])  # N
    asked = arm.mobility[:3, :3] @ force  # m/s2
    assert asked[2] < -2.0 * OSC.integral_clamp_linear
    way = arm.run(3.0, lambda _: force)
    left = asked - np.clip(asked, -OSC.integral_clamp_linear, OSC.integral_clamp_linear)
    assert way == pytest.approx(left / OSC.stiffness[:3], abs=1e-4)


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("spring", [1e3, 3e3])  # N/m
def test_in_contact_it_presses_harder_by_its_bound_and_no_more(
    robot, rest_at, q_home, period, spring
):
    def surface(way):
        return np.array([0.0, 0.0, spring * max(0.0, -way[2])])

    arm = Held(robot, rest_at, q_home, period)
    plain = Held(robot, rest_at, q_home, period, **NO_INTEGRAL).run(10.0, surface, 0.02)
    way = arm.run(10.0, surface, 0.02)
    harder = spring * (plain[2] - way[2])  # N
    mass = 1.0 / arm.mobility[2, 2]  # kg, of a tool that does not turn either: more
    whole = np.linalg.inv(arm.mobility)[2, 2]
    assert (
        0.2 * mass * OSC.integral_clamp_linear
        < harder
        < 1.02 * whole * OSC.integral_clamp_linear
    )
    assert arm.controller.end[0] == "none"


def test_what_a_tare_takes_off_is_not_integrated(robot, rest_at, q_home):
    arm, force = Held(robot, rest_at, q_home, 1e-3), np.array([0.0, 0.0, -15.0])
    tare = -arm.mobility[:, :3] @ force
    way = arm.run(3.0, lambda _: force, tare=tare)
    assert np.abs(way).max() < 2e-5  # m


def test_force_axes_have_no_spring_and_no_integral(robot, rest_at, q_home):
    """A push that is followed must not be worked against."""

    def push(_):
        return np.array([2.0, 0.0, 0.0])

    ways = [
        Held(robot, rest_at, q_home, 1e-3, "XYZ:force ABC:hold", **kind).run(0.5, push)
        for kind in ({}, {"integral_clamp_linear": 0.0})
    ]
    assert ways[0][0] > 5e-3
    assert ways[0] == pytest.approx(ways[1], abs=1e-9)
