"""Displacement of a held part between the fingers, as a gripper leaves it."""

from typing import NamedTuple

import numpy as np

from dovetail.poses import UNMOVED, Pose, quat_from_vector


class Grasp(NamedTuple):
    """Largest displacement of a held part from its place in the fingers."""

    error: float = 0.0
    """Along each axis of the TCP's frame [m]."""
    turn: float = 0.0
    """Component of the rotation vector about each of them [rad]."""

    def draw(self, rng: np.random.Generator) -> Pose:
        """Draw the part's frame in the TCP's, uniformly; nothing where both are 0."""
        if not any(self):
            return UNMOVED
        shift, turn = rng.uniform(-1.0, 1.0, (2, 3))
        return Pose(self.error * shift, quat_from_vector(self.turn * turn))
