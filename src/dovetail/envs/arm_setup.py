"""Build the arm of an environment: in this process, or behind an address."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from dovetail.arms.address import (
    FRI_NAME,
    ArmAddress,
    FriAddress,
    GrpcAddress,
    PlantAddress,
    TwinAddress,
    parse_address,
)
from dovetail.arms.arm import Arm
from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.period import (
    DEFAULT_PERIOD,
    FRI_PERIODS,
    require_period,
)
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import per_axis
from dovetail.envs.usual import FORCE_DAMPING, NEAR_SPEED
from dovetail.envs.workspace import Walls
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig, Plant, make_plant
from dovetail.plants.twin import TwinConfig, TwinPlant, load_twin
from dovetail.scene import SceneConfig

if TYPE_CHECKING:
    from dovetail.arms.watchdog import WatchdogConfig

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
        walls: Lower and upper walls of the TCP [m].
        scheme: How limits are kept, "qp" or "paper".
        engine: Physics engine of the twin, if not the one in its file.
        dynamics: Physics of the plain plant; every other arm has its own.

    Raises:
        ConfigError: An unknown address or name, or a setting out of range.
        MissingDependencyError: What the address needs is not installed.
    """
    period = require_period(period)
    address = parse_address(arm) if isinstance(arm, str) else arm
    if engine is not None and twin is None and not isinstance(address, TwinAddress):
        raise ConfigError(
            f"engine is {engine!r}, which is a twin's, and no twin is given; add twin, "
            "or give plant"
        )
    build = partial(
        build_local_arm,
        scene,
        task,
        force_damping=force_damping,
        near_speed=near_speed,
        walls=walls,
        scheme=scheme,
    )
    if address is None:
        return build(
            plant=plant, twin=twin, period=period, engine=engine, dynamics=dynamics
        )
    if twin is not None:
        raise ConfigError("an arm's address and a twin exclude each other; give one")
    if isinstance(address, PlantAddress):
        return build(plant=address.engine, twin=None, period=period, dynamics=dynamics)
    if isinstance(address, TwinAddress):
        return build(
            plant=plant,
            twin=address.twin,
            period=period,
            engine=engine,
            dynamics=dynamics,
        )
    if not isinstance(address, (FriAddress, GrpcAddress)):
        require_period(address.period, "the arm's control period")
        return address
    if dynamics is not None:
        raise ConfigError(
            "dynamics can be given to a plant of this process only; the arm behind "
            "the address has its own"
        )
    period = address.period or period
    is_hardware = address.margins == "hardware"
    osc, limits = make_settings(
        scene, period, force_damping, near_speed, walls, scheme, is_hardware=is_hardware
    )
    if isinstance(address, FriAddress):
        return build_fri_arm(address, scene, osc, limits, task, period)
    return _build_remote_arm(address, scene, osc, limits, task, period)


def make_settings(
    scene: SceneConfig,
    period: float,
    force_damping: float | Sequence[float],
    near_speed: float,
    walls: Walls,
    scheme: str,
    *,
    is_hardware: bool = True,
) -> tuple[OscConfig, LimitConfig]:
    """Return law and limits of a task's controller.

    Args:
        scene: Geometry of the task.
        period: Control period [s].
        force_damping: Damping D of force axes [1/s], one number or three.
        near_speed: Speed limit of the TCP per axis where contact is near [m/s].
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
        dx_near=near_speed,
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
    if twin is not None and dynamics is not None:
        raise ConfigError("dynamics and twin exclude each other: a twin has its own")
    osc, limits = make_settings(scene, period, force_damping, near_speed, walls, scheme)
    body: Plant
    if twin is None:
        body = make_plant(plant, scene, dynamics or DynamicsConfig())
    else:
        body = cast("Plant", TwinPlant(load_twin(twin), scene, engine=engine))
    return LocalArm(body, scene.robot(), osc, limits, task, period)


def build_fri_arm(
    address: FriAddress,
    scene: SceneConfig,
    osc: OscConfig,
    limits: LimitConfig,
    task: TaskSpec | str,
    period: float,
    watchdog: "WatchdogConfig | None" = None,
) -> Arm:
    """Build the arm behind a cabinet, real or simulated."""
    require_period(period, FRI_NAME, FRI_PERIODS)
    from dovetail.arms.fri_arm import FriArm
    from dovetail.arms.watchdog import WatchdogConfig

    if address.control is None:  # a robot: T1's limit is one of the velocity's norm
        limits = replace(limits, dx_max=limits.dx_max / np.sqrt(3.0))
    return FriArm(
        scene.robot(),
        osc,
        limits,
        task,
        period,
        bind=(address.host, address.port),
        version=address.version,
        clock=address.clock,
        control=address.control,
        reset=address.reset,
        approach=address.approach,
        timeout=address.timeout,
        watchdog=watchdog or WatchdogConfig(target_timeout=address.watchdog),
        realtime=address.realtime,
        measured_sign=address.measured_sign,
        commanded_sign=address.commanded_sign,
        external_sign=address.external_sign,
        commanded_is_total=address.commanded_is_total,
    )


def _build_remote_arm(
    address: GrpcAddress,
    scene: SceneConfig,
    osc: OscConfig,
    limits: LimitConfig,
    task: TaskSpec,
    period: float,
) -> Arm:
    from dovetail.arms.remote_arm import RemoteArm

    return RemoteArm(
        address.text,
        osc,
        limits,
        task,
        period,
        robot=scene.robot(),
        scene=scene,
    )
