"""Loose limits, and pushes towards one of them: for test_limits_enumerated.py."""

from dataclasses import replace

import numpy as np

from dovetail.control.config import LimitConfig
from dovetail.settings import values_of

TASK = "XYZ:force ABC:force"
HOLD = "XYZ:force ABC:hold"
WALLS = {"x_min": [-2.0, -2.0, -2.0], "x_max": [2.0, 2.0, 2.0], "dx_max": 5.0}
WALLS["near_speed"] = 5.0
LOOSE = {"ddx_max": 100.0, "delta_x": 0.0, "delta_q": 0.0, "delta_v": 0.0, **WALLS}
LOOSE |= {"hardware": False, "last_line": False}
PERIOD = 1e-3
SLACK = 1e-9  # of values that the controller commands exactly
REAL = 2e-3  # m, m/s, rad, rad/s: the motion against the command, over 1 ms


class Bench:
    """Loose limits, and a push of every joint or axis towards one of them."""

    def __init__(self, robot, run_loop, q_home):
        self.robot, self.run_loop, self.q = robot, run_loop, q_home
        self.chain = robot.chain()
        self.loose = LimitConfig.for_period(robot, PERIOD, **LOOSE)

    def declared(self, **values):
        return LimitConfig.for_period(
            self.robot, PERIOD, **{**WALLS, "hardware": False, **values}
        )

    def joint(self, limits, i, sign=1.0, gain=6.0, **options):
        def f_star(q):
            return sign * gain * self.chain.jacobian(q)[:, i]

        return self.run_loop(limits, f_star, TASK, **options)

    def axis(self, limits, i, sign=1.0, gain=2.0, **options):
        f = np.zeros(6)
        f[i] = sign * gain
        return self.run_loop(limits, lambda q: f, HOLD, **options)

    def with_element(self, name, i, value):
        array = np.array(values_of(self.loose)[name])
        array[i] = value
        return replace(self.loose, **{name: array})


NEAR_CONTACT = {"near_plane": [0.0, 0.0, 1.0, 9.0], "gain": 0.0}
PUSHED = np.array([15.0, 0.0, 0.0])


def moving_along_x(bench, speed):
    J = bench.chain.jacobian(bench.q)
    return np.linalg.pinv(J) @ (speed * np.eye(6)[0])


def check_near_press(bench):  # test_near_press.py has where it begins and what is left
    everywhere = [0.0, 0.0, 1.0, 9.0]  # z below 9 m
    soft = replace(bench.loose, near_press=0.5)

    def gone(limits, sign, **options):
        run = bench.axis(limits, 2, sign=sign, gain=2.0, cycles=100, **options)
        return np.abs(run.position[-1, 2] - run.position[0, 2])

    free = gone(bench.loose, -1.0, near_plane=everywhere)
    held = gone(soft, -1.0, near_plane=everywhere)
    assert 0.24 * free < held < 0.26 * free
    assert 0.99 * free < gone(soft, -1.0) < 1.01 * free  # no plane: no limit
    up = gone(bench.loose, 1.0, near_plane=everywhere)
    assert 0.99 * up < gone(soft, 1.0, near_plane=everywhere) < 1.01 * up
