"""The invariants of the task's law, 1 to 5 of docs/control.md, on what the arm is told.

Everything here is taken from torques that the controller gave, not from matrices that
are put together again from its parts: far from every limit a torque is u0 itself.
"""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.poses import (
    quat_about_z,
    quat_conjugate,
    quat_multiply,
    quat_normalized,
    rotation_error,
    swing_twist,
)

TASK = "XYZ:force A:pose BC:hold"
PERIOD = 1e-3
K_NULL = 5.0  # 1/s
NO_LAW = {"stiffness": 0.0, "damping_ratio": 0.0, "posture_stiffness": 0.0}


@pytest.fixture(scope="module")
def far(robot) -> LimitConfig:
    """Limits that are never met; the model is that of the measured state."""
    return LimitConfig.for_period(
        robot,
        PERIOD,
        q_min=-10.0,
        q_max=10.0,
        dq_max=20.0,
        ddq_max=1000.0,
        tau_max=1e4,
        walls=False,
        estimate_rate=0.0,
        last_line=False,
        mid_interval=False,
    )


def torque(robot, limits, task, q, dq, target, **osc):
    """The controller's torque in its first cycle, in which nothing limited it."""
    controller = make_controller(robot, OscConfig(**osc), limits, task, PERIOD)
    start(controller, robot, q, dq)
    result = controller.step(q, dq, target)
    assert result.flags.packed == 0
    return result.tau


def start(controller, robot, q, dq):
    """Reset it to where the arm was a period ago: it then finds what it expects."""
    pose = robot.tool_pose(q)
    controller.reset(q - PERIOD * dq, pose.position, pose.quat_wxyz, dq)


def random_states(robot, rng, count):
    for _ in range(count):
        q = rng.uniform(robot.limits.q_min, robot.limits.q_max)
        yield q, rng.uniform(-robot.limits.dq_max, robot.limits.dq_max)


def model_at(robot, limits, q, task, **osc):
    """Task rows, inertia and its inverse, and whether nothing fades there."""
    controller = make_controller(robot, OscConfig(**osc), limits, task, PERIOD)
    pose = robot.tool_pose(q)
    controller.reset(q, pose.position, pose.quat_wxyz)
    t = controller.osc_terms(q, np.zeros(7))
    return t["J_task"], t["M"], t["Minv"], t["exact"]


def projector(robot, limits, q, task, s0):
    """N of the controller: without a task its torque is N M (-k dq), for every dq."""
    osc = {**NO_LAW, "k_null": K_NULL, "s0": s0}
    columns = [
        torque(robot, limits, task, q, dq, _core.Target(), **osc) for dq in np.eye(7)
    ]
    _, _, Minv, _ = model_at(robot, limits, q, task, s0=s0)
    return -np.stack(columns, axis=1) @ Minv / K_NULL


def test_1_null_space_torque_moves_no_task_axis(robot, far, rng):
    exact = 0
    for q, dq in random_states(robot, rng, 100):
        J, _, Minv, is_exact = model_at(robot, far, q, TASK, s0=1e-3)
        if not is_exact:
            continue
        exact += 1
        N = projector(robot, far, q, TASK, 1e-3)
        assert np.abs(J @ Minv @ N).max() < 1e-10
        f = rng.uniform(-10, 10, 6)
        target = _core.Target(f_star=f)
        tau = torque(robot, far, "XYZABC:force", q, dq, target, s0=1e-3)
        rows = robot.chain().jacobian(q)
        np.testing.assert_allclose(rows @ Minv @ tau, f, atol=1e-8)
    assert exact > 70


@pytest.mark.parametrize("task", [TASK, "XYZABC:force", "ZA:force"])
def test_2_eigenvalues_of_the_null_space_projector_lie_in_0_1(robot, far, rng, task):
    for q, _ in random_states(robot, rng, 60):
        values = np.linalg.eigvals(projector(robot, far, q, task, 0.2))
        assert np.abs(values.imag).max() < 1e-6
        assert values.real.min() > -1e-8
        assert values.real.max() < 1 + 1e-8


@pytest.mark.parametrize("task", [TASK, "XYZABC:force", "ZA:force"])
def test_3_null_space_damping_never_adds_energy(robot, far, rng, task):
    taken = 0
    for q, dq in random_states(robot, rng, 200):
        osc = {**NO_LAW, "k_null": K_NULL, "s0": 0.2}
        power = dq @ torque(robot, far, task, q, dq, _core.Target(), **osc)
        assert power <= 1e-9
        taken += power < -1e-3
    assert taken > 150  # W: and it does take some out


def test_3_the_posture_moves_no_axis_of_the_tool_and_pulls_back(robot, far, rng):
    pulled = 0
    for task in (TASK, "XYZABC:force", "ZA:force"):
        for _ in range(60):
            q = rng.uniform(0.8 * robot.limits.q_min, 0.8 * robot.limits.q_max)
            away = rng.uniform(-0.3, 0.3, 7)
            added = []
            for stiffness in (0.0, 50.0):
                osc = OscConfig(s0=1e-4, posture_stiffness=stiffness)
                controller = make_controller(robot, osc, far, task, PERIOD)
                start(controller, robot, q, np.zeros(7))
                controller.step(q, np.zeros(7), _core.Target())  # latches q
                added.append(controller.osc_terms(q + away, np.zeros(7)))
            u = added[1]["u0"] - added[0]["u0"]
            middle = q + away  # at rest the model is evaluated here
            rows = robot.chain().jacobian(middle) @ added[0]["Minv"] @ u
            singular = np.linalg.svd(robot.chain().jacobian(middle))[1][-1]
            if singular > 0.05:
                assert np.abs(rows).max() < 1e-8
                assert u @ -away > 0.0
                pulled += 1
    assert pulled > 100


@pytest.mark.parametrize("s0", [0.02, 0.5])
def test_4_task_inertia_is_symmetric_positive_and_bounded(robot, far, rng, s0):
    """Column i of Lambda, by J^T, is the torque of a unit of f* on axis i."""
    for q, _ in random_states(robot, rng, 100):
        osc = {**NO_LAW, "s0": s0, "k_null": 0.0, "length_scale": 1.0}
        columns = [
            torque(robot, far, "XYZABC:force", q, np.zeros(7), _core.Target(f), **osc)
            for f in np.eye(6)
        ]
        J = robot.chain().jacobian(q)
        if np.linalg.svd(J, compute_uv=False)[-1] < 0.01:
            continue  # J^T says nothing of some of Lambda there
        Lambda = np.linalg.lstsq(J.T, np.stack(columns, axis=1), rcond=None)[0]
        np.testing.assert_allclose(Lambda, Lambda.T, atol=1e-7)
        values = np.linalg.eigvalsh(0.5 * (Lambda + Lambda.T))
        assert values.min() > -1e-7
        assert values.max() <= 1.125 / s0 + 1e-7


def turned_by(robot, limits, q, quat):
    """The angle about z, times K, that the controller's torque turns the tool with."""
    at_once = {"error_clamp_rotation": np.pi, "turn_speed": 1e4}
    osc = {"stiffness": 20.0, "s0": 1e-4} | at_once
    target = _core.Target(quat_wxyz_d=quat)
    tau = torque(robot, limits, TASK, q, np.zeros(7), target, **osc)
    _, _, Minv, is_exact = model_at(robot, limits, q, TASK, s0=1e-4)
    assert is_exact
    f = robot.chain().jacobian(q) @ Minv @ tau
    np.testing.assert_allclose(f[:5], 0.0, atol=1e-8)  # force axes and B, C stay
    return f[5] / 20.0


def test_5_theta_is_the_turn_about_z_and_antipodes_are_one_rotation(
    robot, far, rng, q_home
):
    start = robot.tool_pose(q_home).quat_wxyz
    for _ in range(100):
        theta, quat = rng.uniform(-3.1, 3.1), quat_normalized(rng.normal(size=4))
        turned = quat_multiply(quat_about_z(theta), quat)
        np.testing.assert_allclose(
            rotation_error(turned, quat), [0, 0, theta], atol=1e-9
        )
        # what the torque turns by: theta alone, whatever else the Target is tilted by
        goal = quat_multiply(quat_about_z(theta), start)
        assert turned_by(robot, far, q_home, goal) == pytest.approx(theta, abs=1e-8)
        _, twist = swing_twist(quat_multiply(turned, quat_conjugate(start)))
        angle = 2.0 * np.arctan2(twist[3], twist[0])
        angle = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
        for sign in (1.0, -1.0):
            seen = turned_by(robot, far, q_home, sign * turned)
            assert seen == pytest.approx(angle, abs=1e-7)


def test_the_arm_accelerates_as_the_controller_meant(robot, far, rng):
    """The model's Coriolis torque, damping and inertia are the plant's, by sign, too.

    Far from the limits a torque does not depend on the Coriolis torque of the model;
    at one it does: here joints may not accelerate by more than 0.1 rad/s2.
    """
    tight = LimitConfig.for_period(
        robot, PERIOD, q_min=-10.0, q_max=10.0, dq_max=20.0, ddq_max=0.1,
        tau_max=1e4, walls=False, estimate_rate=0.0, last_line=False,
        mid_interval=False,
    )  # fmt: skip
    plant = _core.RigidPlant(
        robot.chain(),
        damping=tight.damping,
        armature=tight.armature,
    )
    coriolis = 0.0
    for q, dq in random_states(robot, rng, 100):
        controller = make_controller(robot, OscConfig(), tight, TASK, PERIOD)
        start(controller, robot, q, dq)
        target = _core.Target(f_star=rng.uniform(-30, 30, 6))
        result = controller.step(q, dq, target)
        assert result.flags.joint_acceleration
        ddq = plant.acceleration(q, dq, result.tau)
        np.testing.assert_allclose(ddq, result.a, atol=1e-7)
        coriolis = max(coriolis, np.abs(robot.chain().coriolis(q, dq)).max())
    assert coriolis > 5.0  # Nm: it was there to be seen


def test_with_coriolis_and_the_jacobians_rate_the_tool_accelerates_by_f_star(
    robot, far, rng
):
    plant = _core.RigidPlant(
        robot.chain(), damping=np.zeros(7), armature=np.asarray(far.armature)
    )
    chain, seen = robot.chain(), 0
    for q, dq in random_states(robot, rng, 100):
        if not model_at(robot, far, q, "XYZABC:force", s0=1e-3)[3]:
            continue
        f = rng.uniform(-10, 10, 6)
        osc = {"use_coriolis": True, "use_jdot": True, "s0": 1e-3}
        tau = torque(robot, far, "XYZABC:force", q, dq, _core.Target(f), **osc)
        ddq = plant.acceleration(q, dq, tau)
        twist_rate = chain.jacobian(q) @ ddq + chain.jacobian_dot_dq(q, dq)
        np.testing.assert_allclose(twist_rate, f, atol=1e-6)
        seen += 1
    assert seen > 70
