"""Where a try in contact begins: hole, posture, walls, near plane, what is held."""

import math
from dataclasses import dataclass, replace

import numpy as np

from dovetail.control.config import LimitConfig
from dovetail.errors import ReachError
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.poses import Pose, quat_from_vector, quat_multiply
from dovetail.robots.robot import Robot
from dovetail.tasks.starts import (
    RandomisationConfig,
    sample_fixture,
    sample_start,
    tool_down,
)
from dovetail.workcell.workcell import WALLS

from .contact_choices import Array, Choices

TABLE_WALL = -0.06  # m: with the shipped one of 0.03 m the tool cannot reach the table
NEAR = 0.01  # m above a surface
ABOVE = 0.002  # m over the surface at the start of slide and press
DRAWS = 100  # of a start, as it was chosen
TOUCH = 1e-5  # m: a start may press contacts in by less
NOWHERE, EVERYWHERE = np.array([0, 0, 1, -np.inf]), np.array([0, 0, 1, 10.0])


@dataclass(frozen=True)
class Start:
    """A try's first state."""

    q: Array
    hole: Pose
    hold: Pose
    """What hold axes keep."""
    near_plane: Array


def walls_of(task: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the walls of the TCP [m]: the environment's, or down to the table."""
    if task == "slide":
        return (*WALLS[0][:2], TABLE_WALL), WALLS[1]
    return WALLS[0], WALLS[1]


def make_start(
    rng: np.random.Generator, plant: MujocoPlant, limits: LimitConfig, choices: Choices
) -> Start:
    """Draw a start; the plant is left there, at rest, and touches nothing hard."""
    robot = plant.robot
    for draw in range(2 * DRAWS):
        hole = sample_fixture(rng, RandomisationConfig())
        # A peg that leans as far as this clearance allows may not fit as it is built.
        lean = min(1.0, 2.0 - draw / DRAWS)
        tilt = (lean * choices.tilt[0], lean * choices.tilt[1])
        try:
            at = replace(choices, tilt=tilt)
            q, surface = _posture(rng, robot, limits, at, hole)
        except ReachError:
            continue
        if _is_clear(plant, q, hole):
            break
    else:
        raise RuntimeError(f"no start found for {choices.task}")
    pose = robot.tool_pose(q)
    turn = quat_from_vector(np.array([*choices.twist, 0.0]))
    hold = Pose(pose.position, quat_multiply(turn, pose.quat_wxyz))
    plane = {
        "off": NOWHERE,
        "everywhere": EVERYWHERE,
        "surface": np.array([0.0, 0.0, 1.0, surface + NEAR]),
    }[choices.near]
    return Start(q, hole, hold, plane)


def _posture(
    rng: np.random.Generator,
    robot: Robot,
    limits: LimitConfig,
    choices: Choices,
    hole: Pose,
) -> tuple[Array, float]:
    """Return a configuration and the height of the surface near it [m]."""
    mouth = float(hole.position[2])
    yaw = 2.0 * math.atan2(hole.quat_wxyz[3], hole.quat_wxyz[0])
    seed = robot.posture("down") + rng.normal(0.0, 0.3, 7)
    if choices.task == "slide":
        low, high = np.array(WALLS[0][:2]) + 0.05, np.array(WALLS[1][:2]) - 0.05
        place = np.append(rng.uniform(low, high), ABOVE)
        pose = Pose(place, tool_down(rng.uniform(-0.5, 0.5)))
        return robot.inverse_kinematics(pose, seed), 0.0
    if choices.task == "press":
        corner = rng.uniform(-0.045, 0.045, 2)
        place = hole.position + np.array([*corner, ABOVE])
        pose = Pose(place, tool_down(yaw + rng.uniform(-0.2, 0.2)))
        return robot.inverse_kinematics(pose, seed), mouth
    if choices.task == "jam":
        pose = _wedged(rng, choices, hole, yaw)
        return robot.inverse_kinematics(pose, seed), mouth
    if not choices.is_random_start:
        pose = sample_start(rng, hole, yaw, RandomisationConfig())
        return robot.inverse_kinematics(pose, seed), mouth
    while True:
        q = rng.uniform(limits.q_min + 0.05, limits.q_max - 0.05)
        p = robot.tool_pose(q).position
        if min(np.min(p - WALLS[0]), np.min(WALLS[1] - p)) > 0.02:
            return q, mouth


def _wedged(
    rng: np.random.Generator,
    choices: Choices,
    hole: Pose,
    yaw: float,
) -> Pose:
    """Return the peg in the hole, tilted by a share of what the clearance lets in."""
    tilt_max = 2.0 * choices.clearance / choices.depth  # rad, about its mouth and end
    shrink = rng.uniform(0.3, 0.95)
    tilt = shrink * tilt_max * np.array([*choices.tilt, 0.0]) / math.sqrt(2.0)
    rotation = quat_multiply(quat_from_vector(tilt), tool_down(yaw))
    # The peg turns about its middle in the hole, so that both its ends stay inside.
    half = 0.5 * choices.depth * np.array([-tilt[1], tilt[0], 0.0])
    end = hole.position + np.array([0.0, 0.0, -choices.depth]) + half
    return Pose(end, rotation)


def _is_clear(plant: MujocoPlant, q: Array, hole: Pose) -> bool:
    """Put the arm there and say whether no contact is pressed in."""
    import mujoco

    plant.reset(q, hole)
    mujoco.mj_forward(plant.model, plant.data)
    return all(c.dist > -TOUCH for c in plant.data.contact)
