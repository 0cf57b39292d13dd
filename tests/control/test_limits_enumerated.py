"""Every setting of LimitConfig shows in the motion: what is declared is enforced.

Each has one check that changes it alone. A setting without a check fails.
"""

from dataclasses import replace

import numpy as np
import pytest

from control.limit_bench import (
    NEAR_CONTACT,
    PERIOD,
    PUSHED,
    REAL,
    SLACK,
    Bench,
    check_near_press,
    moving_along_x,
)
from dovetail.control.config import LimitConfig
from dovetail.control.proven import DECLARED
from dovetail.settings import names_in


@pytest.fixture(scope="module")
def bench(robot, run_loop, q_home):
    return Bench(robot, run_loop, q_home)


def require_joint_position(bench, name, sign):
    for i in range(7):
        free = bench.joint(bench.loose, i, sign)
        limit = free.q[0, i] + 0.3 * (free.q[-1, i] - free.q[0, i])
        assert not free.bits("joint_position")
        held = bench.joint(bench.with_element(name, i, limit), i, sign)
        assert held.bits("joint_position") >> i & 1, f"{name}[A{i + 1}]"
        assert (sign * (held.q[:, i] - limit)).max() < REAL, f"{name}[A{i + 1}]"


def check_q_min(bench):
    require_joint_position(bench, "q_min", -1.0)


def check_q_max(bench):
    require_joint_position(bench, "q_max", 1.0)


def check_dq_max(bench):
    for i in range(7):
        free = bench.joint(bench.loose, i, cycles=150)
        limit = 0.4 * np.abs(free.dq[:, i]).max()
        assert not free.bits("joint_velocity") >> i & 1
        held = bench.joint(bench.with_element("dq_max", i, limit), i, cycles=150)
        assert held.bits("joint_velocity") >> i & 1, f"dq_max[A{i + 1}]"
        assert np.abs(held.dq[:, i]).max() < limit + REAL, f"dq_max[A{i + 1}]"


def check_taper_brake(bench):
    limit = bench.q[0] + 0.3
    limits = replace(
        bench.with_element("q_max", 0, limit), taper_offset=np.full(7, 0.1)
    )
    free = bench.joint(limits, 0, gain=10.0, cycles=800)
    for brake in (1.0, 3.0):
        slow = replace(limits, taper_brake=np.full(7, brake))
        run = bench.joint(slow, 0, gain=10.0, cycles=800)
        falls = np.sqrt(0.01 + 2.0 * brake * np.maximum(limit - run.q[:, 0], 0.0)) - 0.1
        assert (run.dq[:, 0] - falls).max() < REAL
        assert run.dq[:, 0].max() < 0.9 * free.dq[:, 0].max()


def check_taper_offset(bench):
    limit = bench.q[0] + 0.3
    limits = bench.with_element("q_max", 0, limit)
    limits = replace(limits, taper_brake=np.full(7, 3.0))
    speeds = []
    for offset in (0.0, 0.4):
        slow = replace(limits, taper_offset=np.full(7, offset))
        run = bench.joint(slow, 0, gain=10.0, cycles=800)
        falls = np.sqrt(offset**2 + 6.0 * np.maximum(limit - run.q[:, 0], 0.0)) - offset
        assert (run.dq[:, 0] - falls).max() < 2.0 * REAL
        speeds.append(run.dq[:, 0].max())
    assert speeds[1] < 0.8 * speeds[0]


def check_dtau_max(bench):
    def overlay(run):
        return run.motor - np.array([bench.chain.gravity(q) for q in run.q])

    free = bench.joint(bench.loose, 0, cycles=50)
    most = 0.1 * np.abs(overlay(free)[0]).max() / PERIOD  # the first comes at once
    slow = replace(bench.loose, dtau_max=np.full(7, most))
    run = bench.joint(slow, 0, cycles=50)
    changes = np.diff(np.vstack([np.zeros(7), overlay(run)]), axis=0)
    assert np.abs(changes).max() / PERIOD == pytest.approx(most, rel=1e-6)
    assert run.bits("torque")


def check_jerk_max(bench):
    limits = bench.with_element("q_max", 0, bench.q[0] + 0.2)
    free = bench.joint(limits, 0, gain=10.0, cycles=600)
    slow = bench.joint(
        replace(limits, jerk_max=np.full(7, 60.0)), 0, gain=10.0, cycles=600
    )
    # What brakes on a ramp begins earlier.
    assert slow.dq[:, 0].max() < 0.9 * free.dq[:, 0].max()
    assert slow.bits("joint_position") & 1


def check_jerk_wall(bench):
    start = bench.chain.pose(bench.q)[0]
    limits = bench.with_element("x_max", 0, start[0] + 0.05)
    free = bench.axis(limits, 0, cycles=400)
    slow = bench.axis(replace(limits, jerk_wall=20.0), 0, cycles=400)
    assert np.abs(slow.speed[:, 0]).max() < 0.95 * np.abs(free.speed[:, 0]).max()
    assert slow.bits("wall_position") & 1


def check_ddq_max(bench):
    for i in range(7):
        free = bench.joint(bench.loose, i)
        limit = 0.4 * np.abs(free.a[:, i]).max()
        assert not free.bits("joint_acceleration")
        held = bench.joint(bench.with_element("ddq_max", i, limit), i)
        assert held.bits("joint_acceleration") >> i & 1, f"ddq_max[A{i + 1}]"
        push = np.abs(held.a - held.asked)[:, i]  # may be resisted beyond the limit
        over = np.abs(held.asked[:, i]) - limit - push
        assert over.max() <= SLACK, f"ddq_max[A{i + 1}]"
        assert push.max() < 0.1 * limit
        assert np.abs(held.a[:, i]).max() <= 1.1 * limit  # exact plant: no push


def check_tau_max(bench):
    for i in range(7):
        free = bench.joint(bench.loose, i, cycles=50)
        gravity = np.abs(bench.chain.gravity(bench.q)[i])
        most = np.abs(free.motor[:, i]).max()
        sign = 1.0
        if most < gravity + 0.05:  # the push relieves the motor: push the other way
            sign = -1.0
            free = bench.joint(bench.loose, i, sign, cycles=50)
            most = np.abs(free.motor[:, i]).max()
        limit = gravity + 0.5 * (most - gravity)
        assert not free.bits("torque")
        held = bench.joint(bench.with_element("tau_max", i, limit), i, sign, cycles=50)
        assert held.bits("torque") >> i & 1, f"tau_max[A{i + 1}]"
        assert not held.bits("unsafe")
        assert np.abs(held.motor[:, i]).max() <= limit + SLACK, f"tau_max[A{i + 1}]"


def require_wall_position(bench, name, sign):
    for i in range(3):
        free = bench.axis(bench.loose, i, sign)
        limit = free.position[0, i] + 0.3 * (free.position[-1, i] - free.position[0, i])
        assert not free.bits("wall_position")
        held = bench.axis(bench.with_element(name, i, limit), i, sign)
        assert held.bits("wall_position") >> i & 1, f"{name}[{i}]"
        assert (sign * (held.position[:, i] - limit)).max() < REAL, f"{name}[{i}]"


def check_x_min(bench):
    require_wall_position(bench, "x_min", -1.0)


def check_x_max(bench):
    require_wall_position(bench, "x_max", 1.0)


def check_dx_max(bench):
    for i in range(3):
        free = bench.axis(bench.loose, i, cycles=150)
        limit = 0.4 * np.abs(free.speed[:, i]).max()
        assert not free.bits("wall_velocity")
        held = bench.axis(bench.with_element("dx_max", i, limit), i, cycles=150)
        assert held.bits("wall_velocity") >> i & 1
        assert np.abs(held.speed[:, i]).max() < limit + REAL


def check_near_speed(bench):  # test_near_contact.py has its other axes and cases
    everywhere = [0.0, 0.0, 1.0, 9.0]  # z below 9 m
    for i in range(3):
        free = bench.axis(bench.loose, i, near_plane=everywhere)
        assert not free.bits("wall_velocity")
        slow = replace(bench.loose, near_speed=0.02)
        held = bench.axis(slow, i, near_plane=everywhere)
        assert held.bits("wall_velocity") >> i & 1
        assert np.abs(held.speed[:, i]).max() < 0.02 + REAL
        assert not bench.axis(slow, i).bits("wall_velocity")  # no plane: no limit


def check_ddx_max(bench):
    for i in range(3):
        free = bench.axis(bench.loose, i, cycles=100)
        assert not free.bits("wall_acceleration")
        held = bench.axis(bench.with_element("ddx_max", i, 0.8), i, cycles=100)
        assert held.bits("wall_acceleration") >> i & 1
        assert np.abs(held.asked_x[:, i]).max() <= 0.8 + 1e-5  # soft: rho
        assert np.abs(held.ddx[:, i]).max() <= 1.1 * 0.8  # exact plant: no push


def peak_braking(run, name, values):
    """The largest deceleration while the position limit bounds the motion."""
    active = [getattr(f, name) & 1 == 1 for f in run.flags]
    return float(-values[np.array(active)].min())


def check_eta(bench):
    limits = bench.with_element("q_max", 0, bench.q[0] + 0.1)
    A = limits.ddq_max[0]
    run = bench.joint(limits, 0, cycles=600)
    hard = peak_braking(run, "joint_position", run.a[:, 0])
    run = bench.joint(replace(limits, eta=0.2), 0, cycles=600)
    soft = peak_braking(run, "joint_position", run.a[:, 0])
    assert 0.4 * A < hard < 0.65 * A
    assert soft < 0.25 * A


def check_eta_wall(bench):
    limits = replace(bench.with_element("x_max", 0, 0.62), ddx_max=[5.0] * 3)
    hard = peak_braking(r := bench.axis(limits, 0), "wall_position", r.ddx[:, 0])
    soft_limits = replace(limits, eta_wall=0.15)
    soft = peak_braking(r := bench.axis(soft_limits, 0), "wall_position", r.ddx[:, 0])
    assert 2.0 < hard < 2.8
    assert soft < 1.0


def check_kappa(bench):
    limits = bench.with_element("dq_max", 0, 0.3)
    for kappa in (1.0, 30.0):
        run = bench.joint(replace(limits, kappa=kappa), 0)
        assert run.bits("joint_velocity") & 1
        room = (0.3 - run.dq[:, 0]) / (kappa * PERIOD)
        assert (run.a[:, 0] <= room + 1e-6).all()
    jump = np.abs(np.diff(run.a[:, 0])).max()
    sharp = bench.joint(replace(limits, kappa=1.0), 0)
    assert jump < 0.3 * np.abs(np.diff(sharp.a[:, 0])).max()


def check_delta_q(bench):
    limits = bench.with_element("q_max", 0, bench.q[0] + 0.1)
    for margin in (0.0, 0.03):
        run = bench.joint(replace(limits, delta_q=margin), 0, cycles=600)
        closest = (limits.q_max[0] - run.q[:, 0]).min()
        assert run.bits("joint_position") & 1
        assert closest == pytest.approx(margin, abs=REAL)


def check_delta_v(bench):
    limits = bench.with_element("dq_max", 0, 0.3)
    for margin in (0.0, 0.3):
        run = bench.joint(replace(limits, delta_v=margin), 0)
        assert run.bits("joint_velocity") & 1
        assert run.dq[:, 0].max() == pytest.approx(0.3 * (1 - margin), abs=REAL)


def check_delta_x(bench):
    limits = replace(bench.with_element("x_max", 0, 0.64), ddx_max=[5.0] * 3)
    for margin in (0.0, 0.02):
        run = bench.axis(replace(limits, delta_x=margin), 0, cycles=800)
        closest = (0.64 - run.position[:, 0]).min()
        assert run.bits("wall_position") & 1
        assert closest == pytest.approx(margin, abs=REAL)


def check_walls(bench):
    limits = bench.with_element("x_max", 0, 0.60)
    on, off = bench.axis(limits, 0), bench.axis(replace(limits, walls=False), 0)
    assert on.bits("wall_position") & 1
    assert on.position[:, 0].max() < 0.60 + REAL
    assert off.bits("wall_position") == 0
    assert off.position[:, 0].max() > 0.60 + 10 * REAL


def check_rho(bench):
    # A free axis drifts towards the wall: only the QP's row can hold it.
    start = bench.chain.pose(bench.q)[0][0]
    limits = replace(bench.with_element("x_max", 0, start + 0.02), ddx_max=5.0)
    J = bench.chain.jacobian(bench.q)
    dq = np.linalg.pinv(J) @ np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    for rho, is_displaced in ((1e6, 0), (1.0, 1)):
        run = bench.run_loop(
            replace(limits, rho=rho), lambda q: np.zeros(6), "YZ:force ABC:hold", dq=dq
        )
        assert run.bits("wall_position") & 1
        assert run.bits("wall_displaced") & 1 == is_displaced


def check_s0_wall(bench):
    limits = replace(bench.with_element("x_max", 0, 0.62), ddx_max=5.0, scheme="paper")
    assert not bench.axis(limits, 0).bits("wall_displaced")
    assert bench.axis(replace(limits, s0_wall=5.0), 0).bits("wall_displaced") & 1


def check_estimate_rate(bench):
    push, cycles = np.array([8.0, -5.0, 6.0]), 41
    expected = bench.chain.jacobian(bench.q)[:3].T @ push
    for rate in (0.0, 15.0, 60.0):
        limits = replace(bench.loose, estimate_rate=rate)
        run = bench.axis(limits, 0, gain=0.0, cycles=cycles, push=push)
        share = 1.0 - np.exp(-rate * (cycles - 1) * PERIOD)
        np.testing.assert_allclose(
            run.disturbance[-1], share * expected, atol=0.06 * np.abs(expected).max()
        )


def require_margins_for(bench, name):
    """What is declared acts through the margins that are made for it."""
    q_max = np.array(bench.loose.q_max)
    q_max[0] = bench.q[0] + 0.1
    for value in (0.0, DECLARED[name]):
        limits = bench.declared(**{name: value}, q_max=q_max)
        run = bench.joint(limits, 0, cycles=800)
        assert run.bits("joint_position") & 1
        closest = (q_max[0] - run.q[:, 0]).min()
        assert closest == pytest.approx(0.030 if value else 0.002, abs=REAL)


def check_delay(bench):
    require_margins_for(bench, "delay")


def check_mass_error(bench):
    require_margins_for(bench, "mass_error")


def check_payload_error(bench):
    require_margins_for(bench, "payload_error")


def check_passive(bench):
    # Moving against a push: a limiter that takes the push off would drive the arm.
    powers = {}
    for passive in (True, False):
        limits = replace(bench.loose, passive=passive, near_speed=0.02)
        run = bench.axis(
            limits, 0, cycles=60, push=PUSHED, dq=moving_along_x(bench, -0.1),
            **NEAR_CONTACT,
        )  # fmt: skip
        tau = run.motor - np.array([bench.chain.gravity(q) for q in run.q])
        powers[passive] = float((tau * run.dq).sum(axis=1)[20:].max())
    assert powers[True] < 0.05  # W
    assert powers[False] > 0.5


def check_brake_rate(bench):
    asked = {}
    for rate in (5.0, 60.0):
        limits = replace(bench.loose, brake_rate=rate, near_speed=0.05)
        run = bench.axis(
            limits, 0, cycles=60, push=PUSHED, dq=moving_along_x(bench, 0.1),
            **NEAR_CONTACT,
        )  # fmt: skip
        speed, asked[rate] = run.speed[:, 0], run.asked_x[:, 0]
        least = np.minimum((0.05 - speed) / 0.04, -rate * speed) - 0.02
        assert (asked[rate] > least)[run.speed[:, 0] > 0.0].all()
    assert asked[60.0].min() < asked[5.0].min() - 0.5


def check_authority(bench):
    limits = bench.with_element("q_max", 6, bench.q[6] - 0.02)
    limits = replace(limits, ddq_max=5.0, dq_max=5.0)
    for authority in (1.0, 3.0):
        run = bench.axis(replace(limits, authority=authority), 0, gain=0.0, cycles=5)
        assert -run.asked[:, 6].min() == pytest.approx(5.0 * authority)


def check_last_line(bench):
    dq = 0.5 * np.eye(7)[0]
    limits = bench.with_element("dq_max", 0, 0.4)
    for is_on in (True, False):
        run = bench.axis(replace(limits, last_line=is_on), 0, gain=0.0, dq=dq)
        assert run.bits("ended") == is_on
        assert run.flags[-1].packed >> 46 & 1 == is_on


def prediction_error(run):
    return float(np.abs(run.ddq - run.a).max())


def check_damping(bench):
    limits = replace(bench.loose, estimate_rate=0.0)
    speed = {"dq": np.full(7, 0.5), "cycles": 20, "damping": 2.0}
    without = bench.axis(replace(limits, damping=0.0), 0, **speed)
    known = bench.axis(replace(limits, damping=2.0), 0, **speed)
    assert prediction_error(known) < 0.1 * prediction_error(without)


def check_armature(bench):
    limits = replace(bench.loose, estimate_rate=0.0)
    without = bench.axis(replace(limits, armature=0.0), 0, cycles=20)
    known = bench.axis(replace(limits, armature=0.1), 0, cycles=20)
    assert prediction_error(known) < 0.1 * prediction_error(without)


def check_mid_interval(bench):
    limits = replace(
        bench.loose, estimate_rate=0.0, damping=0.0, armature=0.0, walls=False
    )
    rng, errors = np.random.default_rng(0), {True: [], False: []}
    joints = limits
    for _ in range(40):
        state = {
            "q": rng.uniform(0.7 * joints.q_min, 0.7 * joints.q_max),
            "dq": rng.uniform(-0.8 * joints.dq_max, 0.8 * joints.dq_max),
        }
        for mid in (True, False):
            run = bench.axis(
                replace(limits, mid_interval=mid),
                0,
                cycles=1,
                damping=0.0,
                armature=0.0,
                **state,
            )
            errors[mid].append(prediction_error(run))
    assert max(errors[True]) < 0.4 * max(errors[False])


def check_exact_sjs(bench):
    limits = replace(bench.loose, scheme="paper", walls=False, ddq_max=2.0)
    M = bench.chain.inertia_matrix(bench.q) + np.diag(limits.armature)
    costs = []
    for exact in (False, True):
        run = bench.joint(replace(limits, exact_sjs=exact), 5, gain=40.0, cycles=1)
        step = run.a[0] - run.a0[0]
        costs.append(float(step @ M @ step))
        assert run.bits("joint_acceleration")
    projected = bench.joint(replace(limits, scheme="qp"), 5, gain=40.0, cycles=1)
    np.testing.assert_allclose(run.a, projected.a, atol=1e-6)
    assert costs[1] <= costs[0] + SLACK


def check_scheme(bench):
    limits = replace(bench.with_element("x_max", 0, 0.60), ddq_max=1.0)
    qp = bench.axis(limits, 0, cycles=400)
    paper = bench.axis(replace(limits, scheme="paper"), 0, cycles=400)
    assert qp.bits("wall_position") & 1
    assert np.abs(qp.a - paper.a).max() > 1e-3


def check_bounds(bench):
    limits = bench.with_element("q_max", 0, bench.q[0] + 0.1)
    for kind, overshoots in (("viability", False), ("paper-corrected", True)):
        run = bench.joint(replace(limits, bounds=kind), 0, gain=10.0)
        assert (run.q[:, 0].max() > limits.q_max[0] + REAL) == overshoots


CHECKS = {
    name.removeprefix("check_"): check
    for name, check in globals().items()
    if name.startswith("check_")
} | {"near_press": check_near_press}


@pytest.mark.parametrize("name", names_in(LimitConfig))
def test_every_limit_shows_when_it_alone_is_changed(bench, name):
    assert name in CHECKS, f"LimitConfig.{name} has no check that it is enforced"
    CHECKS[name](bench)


def test_every_check_belongs_to_a_limit():
    assert set(CHECKS) == set(names_in(LimitConfig))
