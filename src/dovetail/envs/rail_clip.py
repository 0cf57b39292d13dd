"""Clip a component on a rail: the second task, in one file over the same arm."""

from typing import Any, ClassVar

import numpy as np

from dovetail.envs.peg_in_hole import PegInHoleEnv
from dovetail.envs.randomisation import TOOL_DOWN
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.types import Vec3, Vec4, Vec7

FACING_ROBOT: Vec4 = np.array([np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0])
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

    q_seed: ClassVar[Vec7] = np.array([0.0, 0.6, 0.0, -1.6, 0.0, -0.63, 0.0])
    """Where inverse kinematics starts [rad]: elbow up, tool forward."""

    def __init__(
        self, *args: Any, task: str = "X:force A:pose YZBC:hold", **settings: Any
    ) -> None:
        """Build the environment; arguments as for `PegInHoleEnv`."""
        settings.setdefault("clearance", 0.001)
        super().__init__(*args, task=task, **settings)

    def walls(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return lower and upper walls of the TCP [m], world axes."""
        return (0.60, -0.15, 0.30), (0.95, 0.15, 0.50)

    def mouth_direction(self) -> Vec3:
        """Return where the mouth is from the target, world axes, unit length."""
        return np.array([-1.0, 0.0, 0.0])

    def draw_hole(self) -> Pose:
        """Draw the pose of the slot's mouth; its axis is the world's -x."""
        middle = np.array([0.87, 0.0, 0.40])
        return Pose(middle + self.np_random.uniform(-0.03, 0.03, 3), FACING_ROBOT)

    def draw_start(self, hole: Pose) -> Pose:
        """Draw the clip's start in front of the slot, turned about the vertical."""
        distance = self.np_random.uniform(0.02, 0.10)
        turn = quat_about_z(self.np_random.uniform(-0.2, 0.2))
        aligned = quat_multiply(hole.quat_wxyz, TOOL_DOWN)
        position = hole.position + distance * self.mouth_direction()
        return Pose(position, quat_multiply(turn, aligned))
