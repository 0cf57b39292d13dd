"""KUKA's LBR arms: what they share, and the frames of lbr_description.

All LBR arms are alike: seven axes through one line at q = 0, that differ in lengths and
masses. Our joints turn about their local z. In lbr_description (lbr_fri_ros2_stack)
every frame is parallel to the base at q = 0.
"""

import numpy as np

from dovetail.robots.geometry import Geometry
from dovetail.robots.links import InertiaSet, Links, Row, inertia_set
from dovetail.robots.robot import Robot
from dovetail.robots.robot_limits import RobotLimits
from dovetail.types import Array

Point = tuple[float, float, float]

_STRAIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_UP = ((-1, 0, 0), (0, 0, 1), (0, 1, 0))  # x -> -x, y -> z, z -> y
_DOWN = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # x -> x, y -> z, z -> -y
_ROTATIONS = np.array((_STRAIGHT, _UP, _UP, _DOWN, _UP, _DOWN, _UP), dtype=float)
"""Rotations of the joints' frames in their parents at q = 0: the convention of the
pybullet_data and Drake models, which agree with each other."""
POSTURES = {
    "down": np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0]),
    "forward": np.array([0.0, 0.6, 0.0, -1.6, 0.0, -0.63, 0.0]),
}
"""Elbow up; the tool down over a table, or level [rad]."""
Q_MAX_DEG = (170, 120, 170, 120, 170, 120, 175)
"""Ranges of the joints to either side [deg], the same in all data sheets."""
Placed = tuple[Point, Row]
"""A link of lbr_description: its joint's origin in the parent [m], and its masses."""


def in_our_frames(placed: tuple[Placed, ...], origins: Array) -> InertiaSet:
    """Express lbr_description's links in our link frames.

    Both chains have the same joint lines and turning senses, so at q = 0 a link's
    com and inertia carry over by the fixed transform between the two frames.

    Args:
        placed: The links as lbr_description has them.
        origins: Our joints' origins in their parents [m], shape (7, 3).
    """
    masses, coms, inertias = inertia_set(tuple(row for _, row in placed))
    position, rotation, lbr_position = np.zeros(3), np.eye(3), np.zeros(3)
    for i, (origin, _) in enumerate(placed):
        position = position + rotation @ origins[i]
        rotation = rotation @ _ROTATIONS[i]
        lbr_position = lbr_position + np.array(origin)
        coms[i] = rotation.T @ (lbr_position + coms[i] - position)
        inertias[i] = rotation.T @ inertias[i] @ rotation
    return InertiaSet(masses, coms, inertias)


def lbr_arm(
    name: str,
    origins: tuple[Point, ...],
    flange: Point,
    links: Links,
    dq_max_deg: tuple[float, ...],
    tau_max: tuple[float, ...],
) -> Robot:
    """Return an LBR arm without a tool.

    Args:
        name: Its name.
        origins: The joints' origins in their parents [m].
        flange: The flange in the last joint's frame [m].
        links: Masses, in our frames.
        dq_max_deg: Joint speed limits [deg/s].
        tau_max: Motor torque limits [Nm].
    """
    q_max = np.deg2rad(Q_MAX_DEG)
    return Robot(
        name=name,
        geometry=Geometry(
            origin_position=np.array(origins),
            origin_rotation=_ROTATIONS,
            flange_position=np.array(flange),
        ),
        links=links,
        limits=RobotLimits(
            q_min=-q_max,
            q_max=q_max,
            dq_max=np.deg2rad(dq_max_deg),
            tau_max=np.array(tau_max, dtype=float),
        ),
        postures=POSTURES,
    )
