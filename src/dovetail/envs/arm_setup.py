"""Build the arm of an environment: in this process, or behind an address."""

from collections.abc import Sequence
from dataclasses import replace
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
from dovetail.control.period import FRI_PERIODS, require_period
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import per_axis
from dovetail.envs.config import USUAL, EnvConfig
from dovetail.errors import ConfigError
from dovetail.plants.plant import Plant, make_plant
from dovetail.plants.twin import TwinPlant, load_twin
from dovetail.workcell.workcell import Walls, Workcell

if TYPE_CHECKING:
    from dovetail.arms.watchdog import WatchdogConfig

SPEED_MAX = 0.25
"""Speed limit of the TCP per axis [m/s]; all axes together keep it on a robot."""


def build_arm(
    arm: Arm | ArmAddress | str | None,
    cell: Workcell,
    axes: TaskSpec,
    config: EnvConfig = USUAL,
) -> Arm:
    """Build the arm that an address names.

    Args:
        arm: An address, see `arms.address`; None is the plant or twin of the settings;
            an arm that is built already is returned.
        cell: What stands around it.
        axes: Mode of each axis.
        config: Its sections action, approach, control and place; an address may give
            its own period, and a plant or twin of its own.

    Raises:
        ConfigError: An unknown address or name, or a setting out of range.
        MissingDependencyError: What the address needs is not installed.
    """
    place, period = config.place, require_period(config.control.period)
    address = parse_address(arm) if isinstance(arm, str) else arm
    is_twin = place.twin is not None or isinstance(address, TwinAddress)
    if place.engine is not None and not is_twin:
        raise ConfigError(
            f"engine is {place.engine!r}, which is a twin's, and no twin is given; add "
            "twin, or give plant"
        )
    if address is None:
        return build_local_arm(cell, axes, config)
    if place.twin is not None:
        raise ConfigError("an arm's address and a twin exclude each other; give one")
    if isinstance(address, PlantAddress):
        return build_local_arm(cell, axes, config.having(plant=address.engine))
    if isinstance(address, TwinAddress):
        return build_local_arm(cell, axes, config.having(twin=address.twin))
    if not isinstance(address, (FriAddress, GrpcAddress)):
        require_period(address.period, "the arm's control period")
        return address
    if place.dynamics is not None:
        raise ConfigError(
            "dynamics can be given to a plant of this process only; the arm behind "
            "the address has its own"
        )
    period = address.period or period
    is_hardware = address.margins == "hardware"
    config = config.having(period=period)
    osc, limits = settings_of(cell, config, is_hardware=is_hardware)
    if isinstance(address, FriAddress):
        return build_fri_arm(address, cell, osc, limits, axes, period)
    return _build_remote_arm(address, cell, osc, limits, axes, period)


def settings_of(
    cell: Workcell, config: EnvConfig, *, is_hardware: bool
) -> tuple[OscConfig, LimitConfig]:
    """Return law and limits of the controller of an environment.

    Args:
        cell: Its robot and its walls.
        config: Its sections action, approach and control.
        is_hardware: Margins for an arm that is not as the model says.
    """
    return make_settings(
        cell,
        config.control.period,
        config.action.force_damping,
        config.approach.near_speed,
        cell.walls,
        config.control.scheme,
        is_hardware=is_hardware,
    )


def make_settings(
    cell: Workcell,
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
        cell: Its robot, tool and held part.
        period: Control period [s].
        force_damping: Damping D of force axes [1/s], one number or three.
        near_speed: Speed limit of the TCP per axis where contact is near [m/s].
        walls: Lower and upper walls of the TCP [m].
        scheme: How limits are kept, "qp" or "paper".
        is_hardware: Margins for an arm that is not as the model says.
    """
    limits = LimitConfig.for_period(
        cell.loaded_robot(),
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


def build_local_arm(cell: Workcell, axes: TaskSpec, config: EnvConfig) -> LocalArm:
    """Build controller and plant in this process.

    Args:
        cell: What stands in it.
        axes: Mode of each axis.
        config: Its sections action, approach, control and place; the margins are those
            of hardware, as the same policy has to run there.

    Raises:
        ConfigError: Dynamics given with a twin, unknown plant or twin, or a setting out
            of range.
    """
    place, period = config.place, config.control.period
    if place.twin is not None and place.dynamics is not None:
        raise ConfigError("dynamics and twin exclude each other: a twin has its own")
    osc, limits = settings_of(cell, config, is_hardware=True)
    body: Plant
    if place.twin is None:
        body = make_plant(place.plant, cell, place.dynamics)
    else:
        twin = TwinPlant(load_twin(place.twin), cell, engine=place.engine)
        body = cast("Plant", twin)
    return LocalArm(body, cell.loaded_robot(), osc, limits, axes, period)


def build_fri_arm(
    address: FriAddress,
    cell: Workcell,
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
        cell.loaded_robot(),
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
    cell: Workcell,
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
        robot=cell.loaded_robot(),
        cell=cell,
    )
