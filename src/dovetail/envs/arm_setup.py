"""Build the arm of an environment: in this process, or behind an address."""

from collections.abc import Sequence
from pathlib import Path

from dovetail.arms.address import parse_address
from dovetail.arms.arm import Arm
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.local_address import local_address
from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.period import DEFAULT_PERIOD, require_period
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import per_axis
from dovetail.envs.usual import FORCE_DAMPING, NEAR_SPEED
from dovetail.envs.workspace import Walls
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import TwinConfig
from dovetail.scene import SceneConfig

WALLS_MIN = (0.38, -0.22, 0.03)
WALLS_MAX = (0.82, 0.22, 0.30)
"""Walls of the TCP [m], world axes: they enclose every start and every hole."""
SPEED_MAX = 0.25
"""Speed limit of the TCP per axis [m/s]; all axes together keep it on a robot."""


def build_arm(
    arm: Arm | ArmAddress | str | None,
    scene: SceneConfig,
    task: TaskSpec,
    *,
    plant: str = "mujoco",
    twin: TwinConfig | str | Path | None = None,
    period: float = DEFAULT_PERIOD,
    force_damping: float | Sequence[float] = FORCE_DAMPING,
    near_speed: float = NEAR_SPEED,
    near_press: float = LimitConfig.near_press,
    walls: Walls = (WALLS_MIN, WALLS_MAX),
    scheme: str = "qp",
    engine: str | None = None,
    dynamics: DynamicsConfig | None = None,
) -> Arm:
    """Build the arm that an address names.

    Args:
        arm: An address, see `arms.address`; None is the plant or twin of the next
            arguments; an arm that is built already is returned.
        scene: Geometry of the task.
        task: Mode of each axis.
        plant: Engine's name; an address, or a twin, names its own.
        twin: A twin, its name or its file; an address names its own.
        period: Control period [s]; an address may give its own.
        force_damping: Damping D of force axes [1/s], one number or one for each of
            X Y Z; the paper has 0, see `PegInHoleEnv`.
        near_speed: Speed limit of the TCP per axis where contact is near [m/s].
        near_press: Largest f* into what is near there [m/s2].
        walls: Lower and upper walls of the TCP [m].
        scheme: How limits are kept, "qp" or "paper".
        engine: Physics engine of the twin, if not the one in its file.
        dynamics: Physics of the plain plant; every other arm has its own.

    Raises:
        ConfigError: An unknown address or name, or a setting out of range.
        MissingDependencyError: What the address needs is not installed.
    """
    period = require_period(period)
    if arm is None:
        address = local_address(plant, twin)
    elif isinstance(arm, str):
        address = parse_address(arm)
    elif isinstance(arm, ArmAddress):
        address = arm
    else:
        require_period(arm.facts.period, "the arm's control period")
        return arm
    if arm is not None and twin is not None:
        raise ConfigError("an arm's address and a twin exclude each other; give one")
    if engine is not None:
        address = address.with_engine(engine)
    if dynamics is not None:
        address = address.with_dynamics(dynamics)
    period = address.period or period
    osc, limits = make_settings(
        scene,
        period,
        force_damping,
        near_speed,
        walls,
        scheme,
        near_press=near_press,
        is_hardware=address.margins == "hardware",
    )
    settings = ControllerSettings(osc=osc, limits=limits, task=task, period=period)
    return address.build(scene, settings)


def make_settings(
    scene: SceneConfig,
    period: float,
    force_damping: float | Sequence[float],
    near_speed: float,
    walls: Walls,
    scheme: str,
    *,
    near_press: float = LimitConfig.near_press,
    is_hardware: bool = True,
) -> tuple[OscConfig, LimitConfig]:
    """Return law and limits of a task's controller.

    Args:
        scene: Geometry of the task.
        period: Control period [s].
        force_damping: Damping D of force axes [1/s], one number or three.
        near_speed: Speed limit of the TCP per axis where contact is near [m/s].
        near_press: Largest f* into what is near there [m/s2].
        walls: Lower and upper walls of the TCP [m].
        scheme: How limits are kept, "qp" or "paper".
        is_hardware: Margins for an arm that is not as the model says.
    """
    limits = LimitConfig.for_period(
        scene.robot(),
        period,
        hardware=is_hardware,
        x_min=walls[0],
        x_max=walls[1],
        dx_max=[SPEED_MAX] * 3,
        near_speed=near_speed,
        near_press=near_press,
        scheme=scheme,
    )
    damping = per_axis("force_damping", force_damping)
    osc = OscConfig.for_period(period, force_damping=[*damping, *[max(damping)] * 3])
    return osc, limits


def build_local_arm(
    scene: SceneConfig,
    task: TaskSpec,
    *,
    plant: str,
    twin: TwinConfig | str | Path | None,
    period: float,
    force_damping: float | Sequence[float],
    near_speed: float,
    walls: Walls = (WALLS_MIN, WALLS_MAX),
    scheme: str = "qp",
    engine: str | None = None,
    dynamics: DynamicsConfig | None = None,
) -> LocalArm:
    """Build controller and plant.

    Args:
        scene: Geometry of the task.
        task: Mode of each axis.
        plant: Engine's name; not used with a twin, which names its own.
        twin: A twin, its name or its file; None for the plain plant.
        period: Control period [s].
        force_damping: Damping D of force axes [1/s], one number or one for each of
            X Y Z; the paper has 0, see `PegInHoleEnv`.
        near_speed: Speed limit of the TCP per axis where contact is near [m/s].
        walls: Lower and upper walls of the TCP [m].
        scheme: How limits are kept, "qp" or "paper".
        engine: Physics engine of the twin, if not the one in its file.
        dynamics: Physics of the plain plant; a twin has its own.

    Raises:
        ConfigError: Dynamics given with a twin, unknown plant or twin, or a setting out
            of range.
    """
    address = local_address(plant, twin)
    if engine is not None and twin is not None:
        address = address.with_engine(engine)
    if dynamics is not None:
        address = address.with_dynamics(dynamics)
    osc, limits = make_settings(scene, period, force_damping, near_speed, walls, scheme)
    settings = ControllerSettings(osc=osc, limits=limits, task=task, period=period)
    return address.build(scene, settings)
