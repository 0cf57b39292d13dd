"""Build an arm in this process for an environment, over a plant or a twin."""

from pathlib import Path
from typing import cast

from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig, Plant, make_plant
from dovetail.plants.twin import TwinPlant, load_twin
from dovetail.scene import SceneConfig

WALLS_MIN = (0.38, -0.22, 0.03)
WALLS_MAX = (0.82, 0.22, 0.30)
"""Walls of the TCP [m], world axes: they enclose every start and every hole."""
SPEED_MAX = 0.25
"""Speed limit of the TCP per axis [m/s]."""


def build_local_arm(
    scene: SceneConfig,
    task: TaskSpec,
    *,
    plant: str,
    twin: str | Path | None,
    period: float,
    force_damping: float,
    walls: tuple[tuple[float, ...], tuple[float, ...]] = (WALLS_MIN, WALLS_MAX),
    scheme: str = "qp",
    engine: str | None = None,
    dynamics: DynamicsConfig | None = None,
) -> LocalArm:
    """Build controller and plant.

    Args:
        scene: Geometry of the task.
        task: Mode of each axis.
        plant: Engine's name; not used with a twin, which names its own.
        twin: Name of a shipped twin or path of a twin file; None for the plain plant.
        period: Control period [s].
        force_damping: Damping D of force axes [1/s]; 0 is the paper.
        walls: Lower and upper walls of the TCP [m].
        scheme: How limits are kept, "qp" or "paper".
        engine: Physics engine of the twin, if not the one in its file.
        dynamics: Physics of the plain plant; a twin has its own.

    Raises:
        ConfigError: Dynamics given with a twin, unknown plant or twin, or a setting out
            of range.
    """
    if twin is not None and dynamics is not None:
        raise ConfigError("dynamics and twin exclude each other: a twin has its own")
    robot = scene.robot()
    limits = LimitConfig.for_period(
        robot,
        period,
        x_min=walls[0],
        x_max=walls[1],
        dx_max=[SPEED_MAX] * 3,
        scheme=scheme,
    )
    osc = OscConfig.for_period(period, force_damping=[force_damping] * 6)
    body: Plant
    if twin is None:
        body = make_plant(plant, scene, dynamics or DynamicsConfig())
    else:
        body = cast("Plant", TwinPlant(load_twin(twin), scene, engine=engine))
    return LocalArm(body, robot, osc, limits, task, period)
