"""Frames of KUKA's LBR arms: ours, and those of lbr_description.

All LBR arms are alike: seven axes through one line at q = 0, that differ in lengths and
masses. Our joints turn about their local z. In lbr_description (lbr_fri_ros2_stack)
every frame is parallel to the base at q = 0.
"""

import numpy as np

from dovetail.robots.links import InertiaSet, Row, inertia_set
from dovetail.types import Array

_STRAIGHT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_UP = ((-1, 0, 0), (0, 0, 1), (0, 1, 0))  # x -> -x, y -> z, z -> y
_DOWN = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # x -> x, y -> z, z -> -y
ROTATIONS = np.array((_STRAIGHT, _UP, _UP, _DOWN, _UP, _DOWN, _UP), dtype=float)
"""Rotations of the joints' frames in their parents at q = 0: the convention of the
pybullet_data and Drake models, which agree with each other."""
Placed = tuple[tuple[float, float, float], Row]
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
        rotation = rotation @ ROTATIONS[i]
        lbr_position = lbr_position + np.array(origin)
        coms[i] = rotation.T @ (lbr_position + coms[i] - position)
        inertias[i] = rotation.T @ inertias[i] @ rotation
    return InertiaSet(masses, coms, inertias)
