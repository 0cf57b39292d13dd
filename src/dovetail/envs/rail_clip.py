"""Clip a component on a rail: the second task, in one file over the same arm."""

import math
from typing import Any, ClassVar

import numpy as np

from dovetail.envs.hole_pose import HolePose
from dovetail.envs.peg_in_hole import PegInHoleEnv
from dovetail.envs.randomisation import TOOL_DOWN
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.types import Vec3, Vec7

FACING_ROBOT = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
"""Rotation (wxyz) of a slot whose z axis points out of it towards the robot, -x."""


class RailClipEnv(PegInHoleEnv):
    """Push a clip along X into a rail's slot that faces the robot, turning it about A.

    The tool is horizontal. The policy commands X as a force and A as a pose; Y, Z, B
    and C are held where the episode starts, on the slot's axis. The clip starts turned
    about the vertical, so it must be aligned before it goes in.

    The geometry is the peg's and the hole's of `SceneConfig`, laid on the side. Action
    (X, A), observation, reward, info and episode end are those of `PegInHoleEnv`, with
    x, y, z in world axes as there.

    ## Starting state

    The slot's mouth is within +-30 mm of (0.87, 0, 0.40) m along each axis; the clip 20
    to 100 mm in front of it, turned by up to +-0.2 rad.
    """

    defaults: ClassVar[dict[str, Any]] = {
        "task": "X:force A:pose YZBC:hold",
        "clearance": 0.001,
    }
    """What the task is where nothing else is asked for."""
    hole_poses: ClassVar[tuple[HolePose, ...]] = (
        HolePose("A", 0.85, -0.02, 0.39, 0.0, FACING_ROBOT),
        HolePose("B", 0.87, 0.02, 0.40, 0.0, FACING_ROBOT),
        HolePose("C", 0.89, -0.005, 0.415, 0.0, FACING_ROBOT),
    )
    """Where the slot's mouth is when a policy is tried; its axis is the world's -x."""
    q_seed: ClassVar[Vec7] = np.array([0.0, 0.6, 0.0, -1.6, 0.0, -0.63, 0.0])
    """Where inverse kinematics starts [rad]: elbow up, tool forward."""

    def walls(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return lower and upper walls of the TCP [m], world axes."""
        return (0.60, -0.15, 0.30), (0.95, 0.15, 0.50)

    def mouth_direction(self) -> Vec3:
        """Return where the mouth is from the target, world axes, unit length."""
        return np.array([-1.0, 0.0, 0.0])

    def draw_hole(self) -> Pose:
        """Draw the pose of the slot's mouth; its axis is the world's -x."""
        middle = np.array([0.87, 0.0, 0.40])
        position = middle + self.np_random.uniform(-0.03, 0.03, 3)
        return Pose(position, np.array(FACING_ROBOT))

    def draw_start(self, hole: Pose) -> Pose:
        """Draw the clip's start in front of the slot, turned about the vertical."""
        distance = self.np_random.uniform(0.02, 0.10)
        turn = quat_about_z(self.np_random.uniform(-0.2, 0.2))
        aligned = quat_multiply(hole.quat_wxyz, TOOL_DOWN)
        position = hole.position + distance * self.mouth_direction()
        return Pose(position, quat_multiply(turn, aligned))
