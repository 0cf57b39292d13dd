"""Plants by the names of their engines; an engine is imported where it is used."""

from typing import TYPE_CHECKING

from dovetail.errors import ConfigError, did_you_mean
from dovetail.plants.plant import PLANTS, DrivenPlant, DynamicsConfig, Engine

if TYPE_CHECKING:
    from dovetail.workcell.workcell import Workcell


def find_engine(name: str) -> Engine:
    """Return the physics engine of a name.

    Raises:
        ConfigError: Unknown name; lists the known ones.
    """
    for known in PLANTS:
        if name == known:
            return known
    raise ConfigError(
        f"plant {name!r} is unknown{did_you_mean(name, PLANTS)}; known plants: "
        f"{', '.join(PLANTS)}"
    )


def make_plant(
    name: str, cell: "Workcell", dynamics: DynamicsConfig | None = None
) -> DrivenPlant:
    """Build a plant by its engine's name.

    Args:
        name: "mujoco", "bullet" or "drake".
        cell: What stands in it.
        dynamics: Physics of the arm and of the contacts; None is the robot's model.

    Raises:
        ConfigError: Unknown name.
        MissingDependencyError: The engine is not installed.
    """
    engine = find_engine(name)
    if engine == "mujoco":
        from dovetail.plants.mujoco_plant import MujocoPlant

        return MujocoPlant(cell, dynamics)
    if engine == "drake":
        from dovetail.plants.drake_plant import DrakePlant

        return DrakePlant(cell, dynamics)
    from dovetail.plants.bullet_plant import BulletPlant

    return BulletPlant(cell, dynamics)
