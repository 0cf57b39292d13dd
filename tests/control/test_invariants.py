"""The invariants of the limits and of the loop, numbered as in docs/control.md.

Those of the task's law, 1 to 5, are in test_invariants_task.py.
"""

from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.poses import (
    matrix_from_quat,
    quat_about_z,
    quat_from_matrix,
    quat_multiply,
)
from extras import need

TASK = "XYZ:force A:pose BC:hold"
PERIOD = 1e-3
FAR = {
    "hardware": False,
    "q_min": -10.0,
    "q_max": 10.0,
    "dq_max": 20.0,
    "ddq_max": 1000.0,
    "tau_max": 1e4,
    "walls": False,
    "estimate_rate": 0.0,
    "last_line": False,
    "kappa": 1.0,
}


@pytest.fixture(scope="module")
def far(robot) -> LimitConfig:
    """Limits that are never met."""
    return LimitConfig.for_period(robot, PERIOD, **FAR)


def controller_at(robot, limits, task, q, dq=None, **osc):
    dq = np.zeros(7) if dq is None else dq
    controller = make_controller(robot, OscConfig(**osc), limits, task, PERIOD)
    pose = robot.tool_pose(q)  # where it was a period ago: it finds what it expects
    controller.reset(q - PERIOD * dq, pose.position, pose.quat_wxyz, dq=dq)
    return controller


def is_viable(x, v, limits, v_max, brake, slack=0.0):
    low, high = limits
    room = high - x if v > 0 else x - low
    inside = low - slack <= x <= high + slack and abs(v) <= v_max + slack
    return inside and v * v <= 2.0 * brake * room + slack


def test_6_any_allowed_acceleration_from_a_viable_state_ends_viable(rng):
    limits, margin = (-1.0, 1.3), 0.004
    inner = (limits[0] + margin, limits[1] - margin)
    count = 0
    while count < 20000:
        A, V, dt = rng.uniform(5, 30), rng.uniform(0.5, 3), rng.choice([1e-3, 5e-3])
        eta, delta_v = rng.uniform(0.2, 1.0), rng.uniform(0.0, 0.3)
        kappa = rng.choice([1.0, 2.0, 5.0, 10.0])
        v_max, brake = (1 - delta_v) * V, eta * A
        x, v = rng.uniform(*inner), rng.uniform(-v_max, v_max)
        if rng.random() < 0.5:  # on the edge of what can still stop
            x = inner[1] - v * v / (2 * brake) if v > 0 else inner[0] + v**2 / 2 / brake
        if not is_viable(x, v, inner, v_max, brake):
            continue
        count += 1
        lb, ub = _core.acceleration_bounds(
            x, v, *limits, V, A,
            dt=dt, kappa=kappa, eta=eta, delta_x=margin, delta_v=delta_v,
        )  # fmt: skip
        assert -A <= lb <= ub <= A
        a = rng.choice([lb, ub, rng.uniform(lb, ub)])
        end = (x + v * dt + 0.5 * a * dt * dt, v + a * dt)
        assert abs(end[1]) <= v_max + 1e-9
        soft = brake * (kappa * dt) ** 2 / 8 + 1e-9  # no hair's breadth kicks a joint
        outer = (inner[0] - soft, inner[1] + soft)
        assert is_viable(*end, outer, v_max + 1e-9, brake, 1e-9)
        if a != 0.0 and 0.0 < -v / a < dt:  # the turning point, too
            turn = x - 0.5 * v * v / a
            assert outer[0] <= turn <= outer[1]


@pytest.mark.parametrize("kind", ["viability", "paper_corrected", "paper_printed"])
def test_7_bounds_are_mirror_symmetric(rng, kind):
    for _ in range(5000):
        x, v = rng.uniform(-1.5, 1.5), rng.uniform(-3, 3)
        settings = {
            "dt": 1e-3,
            "kappa": 3.0,
            "eta": 0.6,
            "delta_x": 0.002,
            "delta_v": 0.01,
            "kind": getattr(_core.BoundsKind, kind),
        }
        lb, ub = _core.acceleration_bounds(x, v, -1.0, 1.2, 2.0, 15.0, **settings)
        mirror = _core.acceleration_bounds(-x, -v, -1.2, 1.0, 2.0, 15.0, **settings)
        assert (lb, ub) == pytest.approx((-mirror[1], -mirror[0]))


def random_boxes(robot, rng, count, spread=30.0):
    """Inertia matrices of the arm with wanted accelerations and boxes."""
    chain = robot.chain()
    for _ in range(count):
        M = chain.inertia_matrix(rng.uniform(robot.limits.q_min, robot.limits.q_max))
        M = M + 0.05 * np.eye(7)
        middle = rng.uniform(-5, 5, 7)
        half = rng.uniform(0, 15, 7)
        a0 = rng.uniform(-spread, spread, 7)
        yield M, np.linalg.inv(M), a0, middle - half, middle + half


def test_8_sjs_ends_inside_the_box_and_leaves_what_is_inside(robot, rng):
    for _, Minv, a0, lb, ub in random_boxes(robot, rng, 2000):
        result = _core.sjs(a0, Minv, lb, ub)
        assert (result.a >= lb).all()
        assert (result.a <= ub).all()
        assert result.passes <= 8
        np.testing.assert_array_equal(_core.sjs(result.a, Minv, lb, ub).a, result.a)
        inside = np.clip(a0, lb, ub)
        np.testing.assert_array_equal(_core.sjs(inside, Minv, lb, ub).a, inside)


@pytest.mark.parametrize("stage", ["sjs", "sjs_exact"])
def test_9_unsaturated_joints_keep_their_torque(robot, rng, stage):
    for M, Minv, a0, lb, ub in random_boxes(robot, rng, 1000):
        result = getattr(_core, stage)(a0, Minv, lb, ub)
        held = result.upper | result.lower
        change = M @ (result.a - a0)
        free = [i for i in range(7) if not held >> i & 1]
        assert np.abs(change[free]).max(initial=0.0) < 1e-7


def test_10_exact_sjs_is_the_projection_and_does_not_expand(robot, rng):
    qpsolvers = need("qpsolvers")
    for M, Minv, a0, lb, ub in random_boxes(robot, rng, 500):
        exact = _core.sjs_exact(a0, Minv, lb, ub)
        assert exact.ok
        wide = {"lb": lb - 1e-12, "ub": ub + 1e-12}
        qp = qpsolvers.solve_qp(M, -M @ a0, **wide, solver="quadprog")
        np.testing.assert_allclose(exact.a, qp, atol=1e-6)
        other = a0 + rng.normal(0, 3, 7)
        step = _core.sjs_exact(other, Minv, lb, ub).a - exact.a
        before = other - a0
        assert step @ M @ step <= before @ M @ before + 1e-8


def test_11_sjs_is_the_projection_where_every_added_torque_pushes_inwards(robot, rng):
    equal = different = 0
    for M, Minv, a0, lb, ub in random_boxes(robot, rng, 1500, spread=20.0):
        result, exact = _core.sjs(a0, Minv, lb, ub), _core.sjs_exact(a0, Minv, lb, ub)
        added = M @ (result.a - a0)
        pushes = [
            (-added[i] if result.upper >> i & 1 else added[i])
            for i in range(7)
            if (result.upper | result.lower) >> i & 1
        ]
        gap = np.abs(result.a - exact.a).max()
        if len(pushes) == 1 or all(p >= 0.0 for p in pushes):
            assert gap < 1e-7
            equal += 1
        elif min(pushes) < -1e-6:
            assert gap > 1e-3  # rad/s2; the smallest seen is 0.013
            different += 1
    assert equal > 600
    assert different > 600


def test_12_scs_meets_its_rows_and_far_walls_change_nothing(robot, rng):
    chain = robot.chain()
    for M, Minv, a0, lb, ub in random_boxes(robot, rng, 1000):
        q = rng.uniform(0.8 * robot.limits.q_min, 0.8 * robot.limits.q_max)
        Jc, djc = chain.jacobian(q)[:3], rng.normal(0, 1, 3)
        cu = rng.uniform(0.0, 4.0, 3)
        cl = cu - rng.uniform(0.0, 6.0, 3)
        result = _core.scs(a0, Minv, Jc, djc, cl, cu, 1e-3)
        assert result.passes <= 4
        if np.linalg.eigvalsh(Jc @ Minv @ Jc.T)[0] > 2e-3:
            row = Jc @ result.a + djc
            assert (row < cu + 1e-6).all()
            assert (row > cl - 1e-6).all()
        far = np.full(3, 1e6)
        away = _core.scs(a0, Minv, Jc, djc, -far, far, 1e-3)
        np.testing.assert_array_equal(away.a, a0)
        tau = (M @ _core.sjs(away.a, Minv, lb, ub).a) - M @ _core.sjs(
            a0, Minv, lb, ub
        ).a
        assert np.abs(tau).max() == 0.0


def test_13_torque_and_box_hold_together_if_the_safe_action_is_feasible(robot, rng):
    limited = 0
    for M, Minv, a0, lb, ub in random_boxes(robot, rng, 2000):
        wanted, safe = _core.sjs(a0, Minv, lb, ub).a, np.clip(0.0, lb, ub)
        h = rng.normal(0, 2, 7)
        room = rng.uniform(0.1, 3.0, 7)
        lo, hi = M @ safe + h - room, M @ safe + h + room
        blend = _core.blend_torque(wanted, safe, M, h, lo, hi)
        assert not blend.unsafe
        assert (blend.a >= lb - 1e-9).all()
        assert (blend.a <= ub + 1e-9).all()
        assert (blend.tau >= lo).all()
        assert (blend.tau <= hi).all()
        np.testing.assert_allclose(blend.tau, M @ blend.a + h, atol=1e-9)
        limited += blend.limited != 0
    assert limited > 1900


def adversary(rng, f_max, robot, q):
    """One action of 50 ms: bang-bang, held small, or towards a joint's limit."""
    style = rng.integers(3)
    if style == 0:
        f = rng.choice([-1.0, 1.0], 6) * f_max
    elif style == 1:
        f = rng.uniform(-1.0, 1.0, 6) * f_max
    else:
        i = rng.integers(7)
        f = robot.chain().jacobian(q)[:, i] * rng.choice([-1.0, 1.0]) * 3 * f_max
    turn = quat_about_z(rng.uniform(-np.pi, np.pi))
    down = np.array([0.0, 0.0, 1.0, 0.0])
    return _core.Target(f_star=f, quat_wxyz_d=quat_multiply(turn, down))


@pytest.mark.slow
@pytest.mark.parametrize("period", [1e-3, 5e-3])
def test_14_no_limit_is_violated_in_1e5_adversarial_steps(robot, q_home, rng, period):
    # The last line would end the attack.
    limits = LimitConfig.for_period(robot, period, hardware=False, last_line=False)
    # A posture would keep the joints from their limits: it was not reached by 18 mm.
    osc = OscConfig.for_period(period, posture_stiffness=0.0, k_null=5.0)
    chain = robot.chain()
    model = limits
    plant = _core.RigidPlant(chain, damping=model.damping, armature=model.armature)
    controller = make_controller(robot, osc, limits, TASK, period)
    steps, episode, hold = 100_000, round(5.0 / period), round(0.05 / period)
    worst = np.full(3, -np.inf)  # joint position, joint speed, wall
    at_wall = np.zeros(6)  # cycles
    for cycle in range(steps):
        if cycle % episode == 0:
            start = q_home + rng.uniform(-0.03, 0.03, 7)
            pose = robot.tool_pose(start)
            plant.reset(start, np.zeros(7))
            controller.reset(start, pose.position, pose.quat_wxyz)
            f_max = rng.choice([1.0, 5.0, 30.0])
        q, dq = plant.read()
        if cycle % hold == 0:
            target = adversary(rng, f_max, robot, q)
        plant.apply(controller.step(q, dq, target).tau, period)
        q, dq = plant.read()
        x = chain.pose(q)[0]
        walls = np.concatenate([x - limits.x_max, limits.x_min - x])
        at_wall += walls > -limits.delta_x - 1e-3
        excess = (
            np.maximum(q - limits.q_max, limits.q_min - q).max(),
            (np.abs(dq) - limits.dq_max).max(),
            walls.max(),
        )
        worst = np.maximum(worst, excess)
    assert (worst <= 0.0).all(), f"position, speed, wall exceeded by {worst}"
    # The adversary did reach them: nothing but the margins was left.
    tool = limits
    fastest = (limits.delta_v * limits.dq_max).max()
    assert (worst > [-limits.delta_q - 1e-3, -fastest, -tool.delta_x - 1e-4]).all()
    assert at_wall.min() > 1000  # each of the six; 1574 is the least seen


def test_15_torque_is_affine_in_the_action_without_saturation(robot, far, rng):
    for _ in range(100):
        q = rng.uniform(0.7 * robot.limits.q_min, 0.7 * robot.limits.q_max)
        dq = rng.uniform(-0.5, 0.5, 7)
        most = np.repeat([10.0, 0.0], 3)  # rotations are at their clamp, by the error
        f, g = rng.uniform(-most, most, (2, 6))
        share = rng.uniform(-1, 2)
        torques = [
            controller_at(robot, far, TASK, q, dq).step(
                q, dq, _core.Target(f_star=f_star)
            )
            for f_star in (f, g, share * f + (1 - share) * g)
        ]
        assert not any(result.flags.packed for result in torques)
        mixed = share * torques[0].tau + (1 - share) * torques[1].tau
        np.testing.assert_allclose(torques[2].tau, mixed, atol=1e-8)


def test_16_turning_the_base_turns_f_and_scaling_the_mass_scales_the_torque(
    robot, far, rng
):
    limits = replace(far, damping=0.0, armature=0.0)
    for _ in range(50):
        q = rng.uniform(0.7 * robot.limits.q_min, 0.7 * robot.limits.q_max)
        dq, f = rng.uniform(-0.5, 0.5, 7), rng.uniform(-10, 10, 6)
        turn = quat_about_z(rng.uniform(-3, 3))
        R, s = matrix_from_quat(turn), rng.uniform(0.5, 2.0)
        at, links = robot.geometry, robot.links
        first = at.origin_rotation.copy(), at.origin_position.copy()
        first[0][0], first[1][0] = R @ first[0][0], R @ first[1][0]
        at = replace(at, origin_rotation=first[0], origin_position=first[1])
        turned = replace(robot, geometry=at)
        links = replace(links, mass=s * links.mass, inertia=s * links.inertia)
        heavy = replace(robot, links=links)
        task, osc = "XYZ:force ABC:hold", {"s0": 1e-5}
        target = _core.Target(f_star=f)
        tau = controller_at(robot, limits, task, q, dq, **osc).step(q, dq, target).tau
        both = np.concatenate([R @ f[:3], R @ f[3:]])
        other = controller_at(turned, limits, task, q, dq, **osc)
        turned_tau = other.step(q, dq, _core.Target(f_star=both)).tau
        np.testing.assert_allclose(turned_tau, tau, atol=1e-7)
        scaled = (
            controller_at(heavy, limits, task, q, dq, **osc).step(q, dq, target).tau
        )
        np.testing.assert_allclose(scaled, s * tau, rtol=1e-7, atol=1e-7)


def test_17_force_axes_without_force_never_add_energy(robot, far, rng):
    unlimited = 0
    for _ in range(300):
        q = rng.uniform(robot.limits.q_min, robot.limits.q_max)
        dq = rng.uniform(-robot.limits.dq_max, robot.limits.dq_max)
        task = rng.choice(["XYZABC:force", "XYZ:force", "ZA:force"])
        controller = controller_at(robot, far, task, q, dq)
        result = controller.step(q, dq, _core.Target())
        if result.flags.packed == 0:
            assert dq @ result.tau <= 1e-9
            unlimited += 1
    assert unlimited > 280


def test_a_rotation_matrix_of_the_tool_is_a_quaternion_of_the_tool(robot, rng):
    for _ in range(50):
        q = rng.uniform(robot.limits.q_min, robot.limits.q_max)
        quat = quat_from_matrix(robot.chain().pose(q)[1])
        np.testing.assert_allclose(quat, robot.tool_pose(q).quat_wxyz, atol=1e-12)
