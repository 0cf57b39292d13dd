"""What commands the arm in a try in contact: a Target every 50 ms."""

import math

import numpy as np

from dovetail import _core
from dovetail.control.limits import ApproachLimits
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import CommandMap
from dovetail.envs.config import ApproachConfig
from dovetail.envs.observation import USUAL_GROUPS, Layout
from dovetail.learn.policy import Policy, find_policy
from dovetail.poses import (
    quat_about_z,
    quat_from_matrix,
    quat_multiply,
    theta_about_vertical,
)
from dovetail.robots.robot import Robot

from .contact_choices import Array, Choices
from .contact_scene import Start

ACTION = 0.05  # s
HELD = 20  # actions
INTO = 0.8  # share of the actions that press on what is near
TASK = "XYZ:force A:pose BC:hold"


def near_press_of(choices: Choices) -> float:
    """Return the controller's near_press [m/s2]: as in the environment, or none."""
    is_limited = choices.is_press_limited or choices.policy == "shipped"
    return ApproachConfig.near_press if is_limited else ApproachLimits.near_press


class Commander:
    """Fills a Target for one try."""

    shipped: Policy | None = None

    def __init__(
        self, choices: Choices, start: Start, robot: Robot, rng: np.random.Generator
    ) -> None:
        self.choices, self.start, self.robot, self.rng = choices, start, robot, rng
        self.chain = robot.chain()
        self.tare = np.zeros(6)
        self.near_plane = start.near_plane
        self._signs, self._theta = np.zeros(3), 0.0
        way = np.array(choices.drift_way)
        linear = choices.drift * way / np.linalg.norm(way)
        self._drift = np.append(linear, np.zeros(3))
        self._phase = rng.uniform(0.0, 2.0 * math.pi)
        if choices.policy == "shipped":
            self._prepare_policy()

    def _prepare_policy(self) -> None:
        if Commander.shipped is None:
            Commander.shipped = Policy.load(find_policy("peg_square"))
        Commander.shipped.reset()
        self._map = CommandMap(
            TaskSpec.parse(TASK),
            f_scale=4.0,
            f_scale_angular=20.0,
            theta_range=0.2,
            position_range=0.05,
        )
        depth = np.array([0.0, 0.0, 0.03])
        self._scaling = Layout(USUAL_GROUPS, self.robot, depth)
        hole = self.start.hole
        self._goal = hole.position - depth
        self._goal_quat = quat_multiply(hole.quat_wxyz, np.array([0.0, 1.0, 0.0, 0.0]))

    def fill(self, target: _core.Target, number: int, q: Array, dq: Array) -> None:
        """Write action `number` for a measured state."""
        target.near_plane = self.near_plane
        target.f_tare = self.tare
        target.velocity_d = self._drift
        if self.choices.policy == "shipped":
            self._fill_shipped(target, q, dq)
            return
        choices = self.choices
        f = choices.f_star
        if choices.policy == "wave":
            angle = 2.0 * math.pi * choices.frequency * ACTION * number + self._phase
            linear = f * np.array(choices.direction)
            linear[:2] *= math.sin(angle)
            if choices.task in ("free", "spring"):
                linear[2] *= math.sin(angle)
            theta = choices.theta * math.sin(0.7 * angle)
        else:
            if choices.policy == "bang" or number % HELD == 0:
                self._draw(q)
            linear, theta = f * self._signs, self._theta
        target.f_star = np.append(linear, np.zeros(3)) + self.tare
        turn = quat_about_z(theta)
        target.position_d = self.start.hold.position
        target.quat_wxyz_d = quat_multiply(turn, self.start.hold.quat_wxyz)

    def _draw(self, q: Array) -> None:
        """Draw a corner of f*, or the one that drives a joint to its nearer limit."""
        rng = self.rng
        self._signs = rng.choice([-1.0, 1.0], 3)
        self._theta = rng.uniform(-1.0, 1.0) * self.choices.theta
        if self.choices.policy == "seek":
            joint = rng.integers(7)
            middle = 0.5 * (self.robot.limits.q_min + self.robot.limits.q_max)
            sign = 1.0 if q[joint] > middle[joint] else -1.0
            self._signs = sign * np.sign(self.chain.jacobian(q)[:3, joint])
        elif self.choices.task in ("slide", "press", "jam") and rng.random() < INTO:
            self._signs[2] = -1.0

    def _fill_shipped(self, target: _core.Target, q: Array, dq: Array) -> None:
        position, rotation = self.chain.pose(q)
        raw = np.empty(14)
        raw[:7] = q
        raw[7:10] = position - self._goal
        quat = quat_from_matrix(rotation)
        raw[10] = theta_about_vertical(quat, self._goal_quat)
        raw[11:14] = self.chain.jacobian(q)[:3] @ dq
        assert Commander.shipped is not None
        action = Commander.shipped(self._scaling.scale(raw))
        self._map.take_off(self.tare)
        self._map.fill(target, action, self._goal, self._goal_quat)
