"""Colours and sizes of the marks beside the bodies, in pictures and on the page."""

import numpy as np

from dovetail.poses import Pose
from dovetail.types import Vec3

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

FORCE_COLOUR: Colour = (217, 38, 31)
"""The contact force's arrow."""
PATH_COLOUR: Colour = (26, 90, 190)
"""Path of the tool's end."""
BELIEVED_COLOUR: Colour = (190, 50, 200)
"""The fixture where it is believed; no part of a shipped cell has this hue."""
FORCE_SCALE = 0.004
"""Length of a force's arrow [m/N]."""
FORCE_MIN = 0.5
"""Least contact force that gets an arrow [N]."""
BESIDE: Vec3 = np.array([-0.04, -0.05, 0.0])
"""Offset of a force's arrow from the tool's end [m]: at 0 the tool would hide it."""
_HAIR = 2e-4
"""Distance up to which believed and true fixture are drawn as one [m]."""
_TURN = 1e-6
"""The same of their turn: 1 - cos of half of it; 2.8 mrad."""


def is_elsewhere(believed: Pose, fixture: Pose) -> bool:
    """Return whether a believed pose differs visibly from the true one."""
    gap = float(np.linalg.norm(believed.position - fixture.position))
    likeness = abs(float(believed.quat_wxyz @ fixture.quat_wxyz))
    return gap > _HAIR or likeness < 1.0 - _TURN
