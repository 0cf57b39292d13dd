"""What near_press leaves of f*: at its plane, above it, and of the weight held."""

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
