"""Draw docs/frames.png: the frames of conventions.md, from the robot's own numbers."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, matrix_from_quat
from dovetail.robots.robot import Robot

TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # Rx(pi), wxyz
SEED = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0])
COLOURS = ("tab:red", "tab:green", "tab:blue")


def joint_positions(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Positions of base, joints A1 to A7 and flange in world axes [m], (9, 3)."""
    position, rotation = np.zeros(3), np.eye(3)
    points = [position]
    for i in range(7):
        position = position + rotation @ robot.geometry.origin_position[i]
        c, s = np.cos(q[i]), np.sin(q[i])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        rotation = rotation @ robot.geometry.origin_rotation[i] @ turn
        points.append(position)
    points.append(position + rotation @ robot.geometry.flange_position)
    return np.array(points)


def draw_frame(axes: plt.Axes, name: str, pose: Pose, length: float) -> None:
    """Draw a frame's three axes and its name."""
    rotation = matrix_from_quat(pose.quat_wxyz)
    for i, colour in enumerate(COLOURS):
        end = pose.position + length * rotation[:, i]
        axes.plot(*np.stack([pose.position, end]).T, color=colour, linewidth=2)
        axes.text(
            *(pose.position + 1.25 * length * rotation[:, i]), "xyz"[i], fontsize=7
        )
    axes.text(*(pose.position + np.array([0.06, 0.0, 0.03])), name, fontsize=11)


def main() -> None:
    """Write frames.png beside this file."""
    robot = find_cell().loaded_robot()
    tool = Pose(np.array([0.60, 0.0, 0.20]), TOOL_DOWN)
    q = robot.inverse_kinematics(tool, SEED)
    points = joint_positions(robot, q)
    figure = plt.figure(figsize=(7, 6), layout="tight")
    axes = figure.add_subplot(projection="3d")
    axes.plot(*np.vstack([points, tool.position]).T, "o-", color="0.55", linewidth=5)
    flange = Pose(points[-1], tool.quat_wxyz)
    hole = Pose(np.array([0.60, 0.0, 0.10]), np.array([1.0, 0.0, 0.0, 0.0]))
    world = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    for name, pose, length in (
        ("world = base", world, 0.15),
        ("flange", flange, 0.08),
        ("tool (TCP) = peg", tool, 0.08),
        ("hole", hole, 0.08),
    ):
        draw_frame(axes, name, pose, length)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("z [m]")
    axes.set_box_aspect((1, 1, 0.8))
    axes.set_xlim(-0.1, 0.9)
    axes.set_ylim(-0.5, 0.5)
    axes.set_zlim(0.0, 0.8)
    axes.view_init(elev=15, azim=-65)
    figure.savefig(Path(__file__).with_name("frames.png"), dpi=110)


if __name__ == "__main__":
    main()
