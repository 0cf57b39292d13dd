"""The controller in NumPy: one cycle as equations, in the order of Khatib 1987.

The C++ controller is compared with it. It takes checked settings and finite input. What
judges the input and the motion is not in it: StateCheck, which does not believe
measurements that cannot be, and LastLine, which ends what no Target explains.
"""

from typing import TYPE_CHECKING

import numpy as np
from reference_bounds import intervals, under_push, walls
from reference_qp import solve_qp

from dovetail import poses
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import FORCE, FREE, HOLD, POSE, TaskSpec
from dovetail.types import Array

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.robots.robot import Robot


NEAR_TIME = 0.05
"""Time in which a speed near contact is corrected [s]."""

NEAR_BAND = 0.002
"""Height over the near plane in which near_press comes to act whole [m]."""
WEIGHT_TIME, WEIGHT_MAX = 0.1, 5.0
"""In which weight is learned in free air [s], and the most of it on an axis [m/s2]."""

PATH_TIME = 0.1
"""Time for which a Target's feed-forward moves its desired pose on [s]."""

SURPRISE = 0.25
"""Largest part of one measurement that the disturbance estimate uses, over tau_max."""

LARGEST, USUAL, HELD, HELD_LEAST = 1.0, 0.3, 0.12, 10.0
"""Over tau_max: the most that is taken for a disturbance, of it the limits act against
except at a joint's limit, and a hold; a hold acts against as much at least [Nm]."""

STEADY_RATE = 40.0
"""Of the part of the disturbance that a joint target holds against [1/s]."""

POSTURE_MAX, STAY_MAX = 2.0, 0.02
"""Longest way back that is used: to the posture [rad], to where an axis stays [m]."""

WAY_SHARE = 0.85
"""Share of a joint's speed limit that the way to a pose that jumps uses."""

STAY_SPEED = 0.01
"""An axis that stays is held where it comes to be slower than this [m/s]."""


class ReferenceController:
    """Operational-space control below every limit."""

    def __init__(
        self, robot: "Robot", osc: OscConfig, limits: LimitConfig, task: str, dt: float
    ) -> None:
        self.chain, self.osc, self.limits, self.dt = robot.chain(), osc, limits, dt
        self.modes = np.array(TaskSpec.parse(task).modes)
        self.is_servo = np.isin(self.modes, (POSE, HOLD))
        self.weights = np.repeat([1.0, osc.length_scale], 3)
        self.scale = (self.modes != FREE) * self.weights
        D = 2.0 * osc.damping_ratio * np.sqrt(osc.stiffness)
        self.D = np.where(self.is_servo, D, osc.force_damping)

    def reset(self, q: Array, position_hold: Array, quat_hold: Array) -> None:
        """Latch the pose that hold axes keep; forget disturbance and posture."""
        self.p_hold, self.quat_hold = position_hold, poses.quat_normalized(quat_hold)
        self.r, self.steady = np.zeros(7), np.zeros(7)
        self.posture: Array | None = None
        self.way: tuple[Array, Array] | None = None
        self.v_way, self.pace, self.integral = np.zeros(6), 1.0, np.zeros(6)
        self.weight = np.zeros(3)
        self.walls: tuple[Array, Array] | None = None
        self.anchor, self.is_staying = np.zeros(3), np.zeros(3, dtype=bool)
        self.last: tuple[Array, ...] | None = None

    def step(self, q: Array, dq: Array, target: "_core.Target") -> tuple[Array, ...]:
        """Return overlay torque [Nm], its acceleration and the wanted one [rad/s2]."""
        chain, osc, lim, dt = self.chain, self.osc, self.limits, self.dt
        joints, tool, saturation = lim, lim, lim
        q_min, q_max, tau_max = joints.q_min, joints.q_max, joints.tau_max
        self.estimate(dq)
        # Model  M a + h = u  half a period ahead; the arm does a + push
        q_model = q + 0.5 * dt * dq if lim.mid_interval else q
        M = chain.inertia_matrix(q_model) + np.diag(lim.armature)
        Minv: Array = np.asarray(np.linalg.inv(M), dtype=np.float64)
        c = chain.coriolis(q_model, dq)
        h = c + lim.damping * dq
        J_tool, dJdq = chain.jacobian(q_model), chain.jacobian_dot_dq(q_model, dq)
        push = Minv @ np.clip(self.r, -USUAL * tau_max, USUAL * tau_max)
        push_x = J_tool[:3] @ push
        middle, half = 0.5 * (q_max + q_min), 0.5 * (q_max - q_min)
        is_inside = np.abs(q - middle) < half - joints.delta_q
        push_q = np.where(is_inside, push, Minv @ self.r)  # in full at a limit
        # Limits  lb <= a <= ub,  cl <= Jc a + dJc dq <= cu,  lo <= M a + h <= hi
        (p, R), twist = chain.pose(q), chain.jacobian(q) @ dq
        bounds = (q_min, q_max, joints.dq_max, joints.ddq_max)
        self.walls = walls(lim, dt, p, self.walls)
        wall = (*self.walls, tool.dx_max, tool.ddx_max, tool.eta_wall, tool.delta_x)
        lb, ub = intervals(lim, dt, q, dq, push_q, *bounds, joints.eta, joints.delta_q)
        cl, cu = intervals(lim, dt, p, twist[:3], push_x, *wall)
        g = chain.gravity(q)
        lo, hi = -tau_max - g, tau_max - g
        if target.joint_mode:  # a spring in each joint, what pushes is held against
            K, zeta = osc.joint_stiffness, osc.joint_damping_ratio
            spring = K * (target.q_d - q) - 2.0 * zeta * np.sqrt(K) * dq
            most = np.clip(HELD * tau_max, HELD_LEAST, None)
            most = np.minimum(most, 0.5 * tau_max)
            held = self.steady / max(1.0, np.max(np.abs(self.steady) / most))
            self.posture = self.way = None
            self.pace = 1.0
            a0 = np.clip(spring - Minv @ held, lb, ub)
        else:  # Khatib's law
            if target.near_plane[:3] @ p > target.near_plane[3]:  # not near contact
                self.follow_weight(J_tool @ push, target.f_tare)
            f = self.desired_acceleration(p, R, twist, target)
            f[:3] += self.stay(p, twist, target.stay)
            f -= osc.use_jdot * dJdq
            if tool.walls:  # ask for no more than the tool's limits allow
                drift = (dJdq - J_tool @ Minv @ (h - osc.use_coriolis * c))[:3]
                low, high = self.near_interval(p, twist, push_x, target)
                if saturation.scheme == "qp":
                    low, high = np.maximum(low, cl), np.minimum(high, cu)
                f[:3] = np.maximum(np.minimum(f[:3], high - drift), low - drift)
            u0 = self.task_torque(q, dq, f, J_tool, M, Minv)
            a0 = Minv @ (u0 + osc.use_coriolis * c - h)
        rows = (J_tool[:3], dJdq[:3], cl, cu) if tool.walls else None
        if saturation.scheme == "qp":
            a = solve_qp(M, a0, lb, ub, rows, (M, h, lo, hi), saturation.rho)
        else:
            a = saturate(a0, Minv, *rows, saturation.s0_wall) if rows else a0
            box = (np.eye(7), np.zeros(7), lb, ub, 1e-12)  # SJS: nothing fades
            exact = saturation.exact_sjs
            a = solve_qp(M, a, lb, ub) if exact else saturate(a, Minv, *box)
            a = blend(np.clip(a, lb, ub), np.clip(0.0, lb, ub), M, h, lo, hi)
        u = np.clip(M @ a + h, lo, hi)
        self.last = (M, h, dq, u)
        return u, a + push, a0 + push

    def estimate(self, dq: Array) -> None:
        """Add  r += share (M ddq + h - u - r)  of the interval that has ended."""
        if self.last is None:
            return
        lim, dt, tau_max = self.limits, self.dt, self.limits.tau_max
        M, h, dq_last, u = self.last
        ddq = (dq - dq_last) / dt
        slowed = 0.5 * lim.damping * dt * ddq  # at the mean speed
        lost = M @ ddq + h + slowed - u - self.r
        most = SURPRISE * tau_max
        share = 1.0 - np.exp(-lim.estimate_rate * dt)
        r = self.r + share * np.clip(lost, -most, most)
        self.r = np.clip(r, -LARGEST * tau_max, LARGEST * tau_max)
        self.steady += min(STEADY_RATE * dt, 1.0) * (self.r - self.steady)

    def task_torque(
        self, q: Array, dq: Array, f: Array, J_tool: Array, M: Array, Minv: Array
    ) -> Array:
        """J^T Lambda f* + N M (-k dq) + N_tool M (posture),  N = I - J^T Lambda J M^-1.

        The posture moves no row of the whole tool, those of free axes included.
        """
        osc = self.osc
        self.posture = q if self.posture is None else self.posture
        way = self.posture - q
        way = way * (POSTURE_MAX / max(POSTURE_MAX, float(np.linalg.norm(way))))

        def projected(J: Array, a: Array) -> tuple[Array, Array]:
            Lambda = faded_inverse(J @ Minv @ J.T, osc.s0)
            return Lambda, M @ a - J.T @ Lambda @ J @ a

        J = self.scale[:, None] * J_tool
        J_all = self.weights[:, None] * J_tool
        Lambda, damping = projected(J, -osc.k_null * dq)
        # Joint speeds of the way at full pace
        speed = np.abs(
            Minv @ J.T @ Lambda @ ((self.modes == POSE) * self.scale * self.v_way)
        )
        most = WAY_SHARE * (1.0 - self.limits.delta_v) * self.limits.dq_max
        self.pace = 1.0 / max(1.0, np.max(speed / most))
        _, posture = projected(J_all, osc.posture_stiffness * way)
        return J.T @ Lambda @ (self.scale * f) + damping + posture

    def stay(self, p: Array, twist: Array, bits: int) -> Array:
        """Return the springs of force axes that are held where they came to rest."""
        asked = (bits >> np.arange(3) & 1 == 1) & (self.modes[:3] == FORCE)
        self.is_staying &= asked
        self.anchor = np.where(self.is_staying, self.anchor, p)
        self.is_staying |= asked & (np.abs(twist[:3]) < STAY_SPEED)
        way = np.clip(self.anchor - p, -STAY_MAX, STAY_MAX)
        return asked * self.osc.stiffness[:3] * way

    def follow_weight(self, pull: Array, tare: Array) -> None:
        """Follow in free air how weight accelerates the tool, within bounds."""
        share = 1.0 - np.exp(-self.dt / WEIGHT_TIME)
        weight = self.weight + share * (pull[:3] - self.weight)
        self.weight = np.clip(weight, -WEIGHT_MAX, WEIGHT_MAX)
        self.integrate(pull + tare)

    def integrate(self, pull: Array) -> None:
        """Follow what pulls at pose and hold axes beside the tare, within bounds."""
        config = self.osc
        most = np.repeat(
            [config.integral_clamp_linear, config.integral_clamp_angular], 3
        )
        share = 1.0 - np.exp(-self.dt / config.integral_time)
        integral = self.integral + share * (pull - self.integral)
        self.integral = self.is_servo * np.clip(integral, -most, most)

    def desired_acceleration(
        self, p: Array, R: Array, twist: Array, target: "_core.Target"
    ) -> Array:
        """f* = action + xddot_d - D (xdot - xdot_d), + K e on pose and hold axes."""
        clamps, quat = self.osc, poses.quat_from_matrix(R)
        p_path, quat_path, v_d, a_d = desired_motion(target)
        way = (p, quat) if self.way is None else self.way
        moved = self.moved_to(p_path, way[0], v_d[:3])
        turned = self.turned_to(quat_path, way[1], v_d[3:])
        self.way = moved, turned
        v_d, a_d = (self.modes != HOLD) * v_d, (self.modes != HOLD) * a_d
        p_d = np.where(self.modes[:3] == POSE, moved, self.p_hold)
        e_rot = poses.rotation_error(self.desired_rotation(quat, turned), quat)
        e = self.is_servo * np.append(p_d - p, e_rot)
        used = np.array([clamps.error_clamp_position, clamps.error_clamp_rotation])
        lengths = np.linalg.norm(e.reshape(2, 3), axis=1)
        e *= np.repeat(used / np.maximum(used, lengths), 3)  # direction kept
        most = np.repeat([clamps.f_clamp_linear, clamps.f_clamp_angular], 3)
        has_walls = self.limits.walls
        asked = self.without_press(p, target) if has_walls else target.f_star
        action = np.clip(asked, -most, most)
        drive = self.osc.stiffness * e + action + a_d - self.integral
        return np.clip(drive - self.D * (twist - v_d), -most, most)

    def moved_to(self, p_d: Array, p: Array, speed: Array) -> Array:
        """Go on from p to the Target's, by at most (move_speed + |v_d|) dt."""
        way = (self.modes[:3] == POSE) * (p_d - p)
        v, own = self.osc.move_speed, float(np.linalg.norm(speed))
        share, self.v_way[:3] = self.used(way, v + own, own)
        return p + share * way

    def turned_to(self, quat_d: Array, quat: Array, speed: Array) -> Array:
        """Turn on to the Target's, by at most (turn_speed + |w_d|) dt."""
        way = poses.rotation_error(poses.quat_normalized(quat_d), quat)
        v, own = self.osc.turn_speed, float(np.linalg.norm(speed))
        share, self.v_way[3:] = self.used(way, v + own, own)
        return poses.quat_multiply(poses.quat_from_vector(share * way), quat)

    def used(self, way: Array, speed: float, own: float) -> tuple[float, Array]:
        """Return the share of a way that a cycle goes, and its speed at full pace."""
        length = max(float(np.linalg.norm(way)), 1e-12)
        most = max(self.pace * speed, own) * self.dt
        return min(1.0, most / length), way * speed / max(length, speed * self.dt)

    def desired_rotation(self, quat: Array, quat_d: Array) -> Array:
        """Swing and twist about world z, each from the target, hold or measurement."""
        from_hold = poses.quat_conjugate(self.quat_hold)
        quat_d = poses.quat_normalized(quat_d)
        wanted = poses.swing_twist(poses.quat_multiply(quat_d, from_hold))
        measured = poses.swing_twist(poses.quat_multiply(quat, from_hold))
        held = (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        parts = {POSE: wanted, HOLD: held}
        about_x, about_y, about_z = (
            parts.get(int(m), measured) for m in self.modes[3:]
        )
        swing = poses.quat_from_vector(np.array([about_x[0][0], about_y[0][1], 0.0]))
        turn = poses.quat_multiply(swing, about_z[1])
        return poses.quat_multiply(turn, self.quat_hold)

    def without_press(self, p: Array, target: "_core.Target") -> Array:
        """f* that presses no harder than near_press on what lies below the plane."""
        normal, asked = target.near_plane[:3], np.array(target.f_star)
        share = 1.0 - np.clip((normal @ p - target.near_plane[3]) / NEAR_BAND, 0.0, 1.0)
        tare = target.f_tare[:3]
        press = normal @ ((tare if tare.any() else -self.weight) - asked[:3])
        asked[:3] += share * max(press - self.limits.near_press, 0.0) * normal
        return asked

    def near_interval(
        self, p: Array, twist: Array, push_x: Array, target: "_core.Target"
    ) -> tuple[Array, ...]:
        """Speed near_speed below the plane, above it what can be braked to in time."""
        lim, v, plane = self.limits, twist[:3], target.near_plane
        height = max(plane[:3] @ p - plane[3] + NEAR_TIME * min(plane[:3] @ v, 0.0), 0)
        brake = lim.eta_wall * lim.ddx_max
        near = np.sqrt(lim.near_speed**2 + 2.0 * brake * height)
        tare = target.f_tare[:3]
        push = push_x + tare  # weight is held already
        is_force = np.array([int(m) == FORCE for m in self.modes[:3]])
        moving = np.clip(desired_motion(target)[2][:3], -0.1, 0.1)
        surface = np.where(is_force, moving, 0.0)

        def below(limit: Array, push: Array, v: Array) -> Array:
            sides = zip(limit, push, v, strict=True)
            return np.array([under_push(lim, *side, held=0.0) for side in sides])

        high = below((near + np.maximum(surface, 0.0) - v) / NEAR_TIME, push, v) + tare
        return -below(
            (near + np.maximum(-surface, 0.0) + v) / NEAR_TIME, -push, -v
        ) + tare, high


def desired_motion(target: "_core.Target") -> tuple[Array, ...]:
    """Pose, velocity and acceleration of a path that ends after PATH_TIME."""
    t, is_moving = min(target.age, PATH_TIME), target.age < PATH_TIME
    v, a = target.velocity_d, target.acceleration_d
    way = v * t + 0.5 * a * t**2
    turn = poses.quat_from_vector(way[3:])
    quat = poses.quat_multiply(turn, target.quat_wxyz_d)
    return target.position_d + way[:3], quat, is_moving * (v + a * t), is_moving * a


def faded_inverse(A: Array, s0: float) -> Array:
    """U diag(w(s) / s) U^T: exact above s0, fading smoothly to nothing below."""
    s, U = np.linalg.eigh(A)
    t = np.clip(s / s0, 0.0, 1.0)
    weight = np.where(t < 1.0, t * (3.0 - 2.0 * t) / s0, 1.0 / np.maximum(s, s0))
    return (U * weight) @ U.T


def saturate(
    a0: Array, Minv: Array, J: Array, bias: Array, low: Array, high: Array, s0: float
) -> Array:
    """SCS, or SJS with J = I: rows J a + bias found outside are held from then on."""
    held, bound, a = np.zeros(len(J), dtype=bool), np.zeros(len(J)), a0
    while True:
        row = J @ a + bias
        new = ~held & ((row > high + 1e-9) | (row < low - 1e-9))
        if not new.any():
            return a
        held, bound = held | new, np.where(new, np.clip(row, low, high), bound)
        J_held, missing = J[held], (bound - J @ a0 - bias)[held]
        mobility = J_held @ Minv @ J_held.T
        a = a0 + Minv @ J_held.T @ faded_inverse(mobility, s0) @ missing


def blend(a: Array, a_safe: Array, M: Array, h: Array, lo: Array, hi: Array) -> Array:
    """Largest step from a safe action that the motors can give; never a clip."""
    safe, change = M @ a_safe + h, M @ (a - a_safe)
    room = np.where(change > 0.0, hi - safe, lo - safe)
    share = np.where(change != 0.0, room / np.where(change != 0.0, change, 1.0), 1.0)
    return a_safe + np.clip(share.min(), 0.0, 1.0) * (a - a_safe)
