"""An arm in this process from names: plant or twin, task, period."""

from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig, Plant, make_plant
from dovetail.plants.twin import TwinPlant, load_twin
from dovetail.scene import SceneConfig


def build_arm(
    scene: SceneConfig,
    task: TaskSpec,
    *,
    period: float = 0.005,
    plant: str = "mujoco",
    twin: str | None = None,
    engine: str | None = None,
    force_damping: float = 0.0,
    scheme: str = "qp",
    dynamics: DynamicsConfig | None = None,
) -> LocalArm:
    """Put the controller over a plant or a twin.

    The controller always uses the nominal model: it is told nothing of a twin.

    Args:
        scene: Geometry.
        task: Mode of each axis.
        period: Control period [s].
        plant: Engine, where no twin is named.
        twin: Name or file of a twin.
        engine: Engine of the twin, if not the one in its file.
        force_damping: Damping D of force axes [1/s].
        scheme: Limit scheme, "qp" or "paper".
        dynamics: Physics of the plant; not with a twin, which has its own.

    Raises:
        ConfigError: Unknown name, or dynamics given together with a twin.
    """
    robot = scene.robot()
    if twin is not None:
        if dynamics is not None:
            raise ConfigError(
                "dynamics and twin exclude each other: a twin has its own"
            )
        body: Plant = TwinPlant(load_twin(twin), scene, engine=engine)
    else:
        body = make_plant(plant, scene, dynamics or DynamicsConfig())
    osc = OscConfig.for_period(period, force_damping=[force_damping] * 6)
    limits = LimitConfig.for_period(robot, period, scheme=scheme)
    return LocalArm(body, robot, osc, limits, task, period)
