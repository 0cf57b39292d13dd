"""A MuJoCo plant whose held part stands in its fixture, as it does in the end."""

import numpy as np

from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import TOOL_DOWN, Pose, matrix_from_quat, quat_multiply


def place_inserted(cell):
    """Return a plant with the part upright over the table, in to the floor.

    And the tool's pose there.
    """
    plant = make_plant("mujoco", cell, DynamicsConfig.of_robot(cell.robot))
    robot = cell.loaded_robot()
    down = Pose(np.array([0.6, 0.0, 0.08]), TOOL_DOWN)
    q = robot.inverse_kinematics(down, robot.posture("down"))
    tool = robot.tool_pose(q)
    quat = quat_multiply(tool.quat_wxyz, TOOL_DOWN)
    out = matrix_from_quat(quat)[:, 2]
    plant.reset(q, Pose(tool.position - cell.heights[1] * out, quat))
    return plant, tool
