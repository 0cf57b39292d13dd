"""The one description of a workcell that pictures and the page are drawn from."""

from typing import Any

from dovetail.plants.mjcf import build_mjcf
from dovetail.workcell.workcell import Workcell


def cell_spec(cell: Workcell) -> Any:
    """Return the cell as an `mujoco.MjSpec`: the plant's bodies, with what is drawn.

    The iiwa's meshes are pybullet_data's, where that is installed; every other link is
    a capsule.
    """
    import mujoco

    text = build_mjcf(cell.loaded_robot(), cell, visual_meshes=True)
    return mujoco.MjSpec.from_string(text)
