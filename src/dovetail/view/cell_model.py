"""The one description of a workcell that pictures and the page are drawn from."""

from typing import Any

from dovetail.plants.mjcf import build_mjcf
from dovetail.workcell.workcell import Workcell

LAST_DRAWN = 2
"""The last group of geoms that MuJoCo draws, unasked."""


def cell_spec(cell: Workcell) -> Any:
    """Return the cell as an `mujoco.MjSpec`: the plant's bodies, with what is drawn.

    Arm and gripper are drawn by the meshes of installed packages, or of the file that
    the arm is from; what has none as capsules and boxes. What collides in their place
    is there, in a group that is not drawn.
    """
    import mujoco

    text = build_mjcf(cell.loaded_robot(), cell, visual_meshes=True)
    return mujoco.MjSpec.from_string(text)
