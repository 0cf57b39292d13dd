"""An arm that is moved while no Target is usable goes on from where it is then."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.config import LimitConfig, OscConfig


@pytest.mark.parametrize("period", [1e-3, 2e-3, 2.5e-3, 5e-3])
def test_a_target_where_the_tool_was_moved_to_pulls_it_nowhere(
    robot, rest_at, q_home, period
):
    """The desired position was still on its way from the place of before."""
    limits = LimitConfig.for_period(robot, period, x_min=-2.0, x_max=2.0)
    osc = OscConfig.for_period(period)
    controller, plant, start = rest_at(q_home, osc, limits, "XYZABC:pose", period)

    def run(seconds, position, quat, push=0.0):
        plant.set_external_force(np.array([0.0, push, 0.0]))
        target = _core.Target(position_d=position, quat_wxyz_d=quat)
        way = []
        for _ in range(round(seconds / period)):
            q, dq = plant.read()
            plant.apply(controller.step(q, dq, target).tau, period)
            way.append(robot.tool_pose(q).position)
        return np.array(way)

    run(0.5, *start)
    run(2.0, np.full(3, np.nan), start.quat_wxyz, push=40.0)  # N
    run(1.0, np.full(3, np.nan), start.quat_wxyz)
    moved = robot.tool_pose(plant.read()[0])
    assert np.linalg.norm(moved.position - start.position) > 0.05  # m
    way = run(1.0, *moved)
    assert np.abs(way - moved.position).max() < 2e-3  # m
    assert controller.end[0] == "none"
