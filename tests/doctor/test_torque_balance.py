"""A joint's torque balance finds what a finely integrated joint was made of."""

import numpy as np
import pytest

from dovetail.doctor.held_torque import held_torque
from dovetail.doctor.loop_delay import estimate_delay
from dovetail.doctor.torque_balance import TorqueBalance

from .single_joint import move


def test_a_held_torque_is_what_second_differences_of_a_free_body_show():
    period, mass = 0.002, 2.5
    q, tau = move(period=period, delay=0.0, inertia=mass, cycles=300)
    shown = mass * (q[2:, 0] - 2.0 * q[1:-1, 0] + q[:-2, 0]) / period**2
    np.testing.assert_allclose(held_torque(tau[:, 0], period, 0.0), shown, atol=1e-6)


def test_a_held_torque_that_is_late_by_whole_periods_is_shifted():
    rng = np.random.default_rng(0)
    tau = rng.normal(size=50)
    now, late = held_torque(tau, 0.001, 0.0), held_torque(tau, 0.001, 0.003)
    np.testing.assert_allclose(late[5:], now[2:-3], atol=1e-9)


@pytest.mark.parametrize("period", [0.001, 0.002, 0.005])
@pytest.mark.parametrize("delay", [0.0, 0.0013, 0.0075, 0.015])
def test_a_delay_is_found_at_fractions_of_a_period(period, delay):
    q, tau = move(
        period=period, delay=delay, cycles=round(2.0 / period), damping=2.0, noise=1e-5
    )
    found = estimate_delay([TorqueBalance(q, tau, 0, np.eye(7), period)])
    assert found.is_bracketed
    assert found.delay == pytest.approx(delay, abs=1e-4)


def test_friction_spring_and_gravity_error_are_told_apart():
    made = {"damping": 3.0, "coulomb": 0.4, "stiffness": 60.0, "gravity": 5.0}
    q, tau = move(period=0.001, delay=0.004, inertia=1.2, **made)
    fit = TorqueBalance(q, tau, 0, np.eye(7), 0.001).solve(0.004)
    assert fit.inertia == pytest.approx(1.2, abs=0.01)
    assert fit.damping == pytest.approx(3.0, abs=0.2)
    assert fit.coulomb == pytest.approx(0.4, abs=0.05)
    assert fit.stiffness == pytest.approx(60.0, abs=2.0)
    # the offset is that of the mean position
    assert fit.offset == pytest.approx(5.0 + 60.0 * q[:, 0].mean(), abs=0.02)
    assert fit.sent_spring == 0.0
    assert fit.rms < 0.05


@pytest.mark.parametrize("delay", [0.002, 0.0025, 0.0075, 0.01])
def test_a_spring_to_the_sent_position_is_measured_by_leaning(delay):
    """Of 200 Nm/rad 1 to 11 were missed with the delay rounded to cycles of 5 ms."""
    sides = np.random.default_rng(0).choice([-0.01, 0.01], 40)
    lean = np.repeat(sides, 10)
    q, tau = move(period=0.005, delay=delay, cycles=400, spring=200.0, lean=lean)
    fit = TorqueBalance(q, tau, 0, np.eye(7), 0.005, lean).solve(delay)
    assert fit.sent_spring == pytest.approx(200.0, abs=0.1)


def test_what_is_said_of_the_spread_is_not_too_little():
    found = []
    for seed in range(8):
        q, tau = move(period=0.002, delay=0.004, cycles=700, noise=3e-5, seed=seed)
        found.append(TorqueBalance(q, tau, 0, np.eye(7), 0.002).solve(0.004))
    for name in ("inertia", "stiffness", "offset"):
        values = np.array([getattr(fit, name) for fit in found])
        said = np.mean([fit.spread_of(name) for fit in found])
        assert values.std() < 2.0 * said


def test_the_joint_that_moves_tells_the_delay_and_one_that_is_stuck_says_nothing():
    q, tau = move(period=0.001, delay=0.006, noise=1e-5)
    rng = np.random.default_rng(5)
    stuck_q = q * 0.0 + 1e-5 * rng.normal(size=q.shape)
    stuck = TorqueBalance(stuck_q, tau, 0, np.eye(7), 0.001)
    found = estimate_delay([TorqueBalance(q, tau, 0, np.eye(7), 0.001), stuck])
    assert found.delay == pytest.approx(0.006, abs=2e-4)
