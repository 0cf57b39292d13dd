"""A jam on which limiters press ever harder, without a motion: the last line ends it.

The tool is in a stiff spring, a joint stands at its limit, and the rotation that is
asked for cannot be had. With the cure off (`passive=False`, `estimate_rate=300`) the
limiters cancel what the spring answers, and so they press against themselves.
"""

from typing import NamedTuple

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.poses import quat_from_vector, quat_multiply

STIFFNESS, DAMPING = 5e4, 300.0  # N/m, Ns/m: of the jam
STEP = 0.25e-3  # s, of the physics
TASK = "XYZ:force ABC:pose"
NO_CURE = {"passive": False, "estimate_rate": 300.0}


class Jam(NamedTuple):
    """What is asked for, and which joint stands at a limit."""

    f_star: list[float]  # m/s2
    joint: int
    side: str
    tilt: list[float]  # rad


JAMS = [
    Jam([1.1, -1.8, -3.7], 0, "q_min", [0.13, 0.17, 0.04]),
    Jam([1.5, 1.2, 1.5], 4, "q_min", [-0.15, 0.09, 0.01]),
    Jam([2.7, 2.3, -2.1], 5, "q_max", [-0.18, -0.07, -0.14]),
    Jam([4.0, 2.2, -0.1], 0, "q_min", [0.15, -0.17, 0.08]),
]


def press(robot, rest_at, q, jam, period, **settings):
    """Return the forces on the tool [N] over 1.5 s, and what the last line saw."""
    delta = LimitConfig.for_period(robot, period).delta_q
    end = getattr(robot.limits, jam.side).copy()
    end[jam.joint] = q[jam.joint] + (delta if jam.side == "q_max" else -delta)
    wide = {"x_min": -2.0, "x_max": 2.0, "near_speed": 0.025, jam.side: end}
    limits = LimitConfig.for_period(robot, period, **(wide | settings))
    osc = OscConfig.for_period(period, force_damping=[40.0] * 3 + [0.0] * 3)
    controller, plant, pose = rest_at(q, osc, limits, TASK, period)
    target = _core.Target(f_star=np.array([*jam.f_star, 0.0, 0.0, 0.0]))
    target.near_plane = np.array([0.0, 0.0, 1.0, 9.0])
    target.position_d = pose.position
    turn = quat_from_vector(np.array(jam.tilt))
    target.quat_wxyz_d = quat_multiply(turn, pose.quat_wxyz)
    forces = []
    for _ in range(round(1.5 / period)):
        tau = controller.step(*plant.read(), target).tau
        for _ in range(round(period / STEP)):
            q, dq = plant.read()
            velocity = (robot.chain().jacobian(q) @ dq)[:3]
            way = pose.position - robot.tool_pose(q).position
            force = STIFFNESS * way - DAMPING * velocity
            plant.set_external_force(force)
            plant.apply(tau, STEP)
        forces.append(float(np.linalg.norm(force)))
    return np.array(forces), controller.end


@pytest.mark.parametrize("period", [1e-3, 2e-3, 2.5e-3, 5e-3])
@pytest.mark.parametrize("jam", JAMS)
def test_a_press_that_grows_at_rest_is_ended(robot, rest_at, q_home, jam, period):
    calm, end = press(robot, rest_at, q_home, jam, period)
    assert end[0] == "none"
    grown, _ = press(robot, rest_at, q_home, jam, period, **NO_CURE, last_line=False)
    assert grown.max() > 6.0 * calm.max()  # else there is nothing to end
    ended, (cause, joint, value, limit) = press(
        robot, rest_at, q_home, jam, period, **NO_CURE
    )
    assert cause == "force"
    assert joint == -1
    assert value > limit == 20.0  # N
    assert ended.max() < 3.0 * calm.max()
    assert ended[-1] < 2.0 * calm.max()
