"""A kick makes a joint too fast before a torque acts, and is learned at once."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.config import LimitConfig, OscConfig

WRIST = 5
SLOW = np.full(7, 0.6)  # rad/s


def learned(robot, rest_at, q, period, force):
    """Return the estimate over what pushes [1], after each of the first 20 ms."""
    limits = LimitConfig.for_period(robot, period, dq_max=SLOW)
    osc = OscConfig.for_period(period)
    controller, plant, _ = rest_at(q, osc, limits, "XYZABC:force", period)
    plant.set_external_force(np.array([force, 0.0, 0.0]))
    target = _core.Target()
    shares = []
    for _ in range(round(0.02 / period)):
        state = plant.read()
        result = controller.step(*state, target)
        push = robot.chain().jacobian(state[0])[0, WRIST] * force
        shares.append(controller.disturbance[WRIST] / push)
        plant.apply(result.tau, period)
    return np.array(shares[1:])


@pytest.mark.parametrize("period", [1e-3, 2e-3, 2.5e-3, 5e-3])
def test_a_kick_is_learned_at_once_and_a_push_is_not(robot, rest_at, q_home, period):
    rate = LimitConfig.for_period(robot, period).disturbance.estimate_rate
    usual = 1.0 - np.exp(-rate * period * np.arange(1, round(0.02 / period)))
    pushed = learned(robot, rest_at, q_home, period, 10.0)
    assert pushed == pytest.approx(usual, abs=0.05)
    kicked = learned(robot, rest_at, q_home, period, 32.0)
    more = kicked - usual
    first = int(np.argmax(more > 0.2))  # the cycle in which it was seen
    assert more[first] > 0.4 * (1.0 - usual[first])
    assert (np.abs(more[:first]) < 0.05).all()
    assert (kicked < 1.1).all()
