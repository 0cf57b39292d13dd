"""Build the arm of an environment: in this process, or behind an address."""

import warnings
from dataclasses import replace

import numpy as np

from dovetail.arms.address import parse_address
from dovetail.arms.arm import Arm, ArmFacts
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.local_address import TwinAddress, local_address
from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.period import require_period
from dovetail.control.proven import DECLARED
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import per_axis
from dovetail.envs.config import USUAL, EnvConfig
from dovetail.errors import ConfigError, UnprovenWarning
from dovetail.plants.twin import load_twin
from dovetail.settings import values_of
from dovetail.workcell.workcell import Workcell

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
        config: Its plant, control, actions and declared errors; an address
            may give its own period, and a plant or twin of its own.

    Raises:
        ConfigError: An unknown address or name, or a setting out of range.
        MissingDependencyError: What the address needs is not installed.
    """
    period = require_period(config.period)
    if arm is None:
        address = local_address(config.plant, config.twin)
    elif isinstance(arm, str):
        address = parse_address(arm)
    elif isinstance(arm, ArmAddress):
        address = arm
    else:
        require_period(arm.facts.period, "the arm's control period")
        _require_cell_as_built(arm.facts, cell)
        _require_as_built(arm.facts, config)
        return arm
    if arm is not None and config.twin is not None:
        raise ConfigError("an arm's address and a twin exclude each other; give one")
    if (arm or config.twin) and config.plant not in (USUAL.plant, config.engine):
        raise ConfigError(
            f"plant is {config.plant!r}, which is the plain plant's engine, beside an "
            "arm or a twin: give a twin's engine as engine, or leave the arm out"
        )
    if isinstance(address, TwinAddress):
        _warn_of(address)
    if doubt := address.unproven_margins:
        warnings.warn(doubt, UnprovenWarning, stacklevel=2)
    if config.engine is not None:
        address = address.with_engine(config.engine)
    if config.dynamics is not None:
        address = address.with_dynamics(config.dynamics)
    period = address.period or period
    is_hardware = address.margins == "hardware"
    osc, limits = make_settings(
        cell, replace(config, period=period), is_hardware=is_hardware
    )
    settings = ControllerSettings(osc=osc, limits=limits, task=axes, period=period)
    return address.build(cell, settings)


def _require_as_built(facts: ArmFacts, config: EnvConfig) -> None:
    """Refuse settings that an arm that is built already has otherwise, or cannot have.

    Raises:
        ConfigError: Names the setting and both values.
    """
    limits, usual = values_of(facts.limits), values_of(USUAL)
    built = {name: limits[name] for name in ("scheme", "near_speed", "near_press")}
    built |= {"period": facts.period, "plant": None, "engine": None, "dynamics": None}
    built |= {"force_damping": tuple(facts.osc.force_damping[:3])}
    built |= dict.fromkeys(DECLARED)
    for name, value in values_of(config).items():
        if name not in built or value == usual[name]:
            continue
        given = per_axis(name, value) if name == "force_damping" else value
        if given != built[name]:
            raise ConfigError(
                f"{name} is {value}, but the arm is built already"
                f"{'' if built[name] is None else f', with {built[name]}'}: give "
                f"{name} where the arm is built, or the arm's address in its place"
            )


def _require_cell_as_built(facts: ArmFacts, cell: Workcell) -> None:
    """Refuse a cell file beside an arm that was built for another cell.

    Raises:
        ConfigError: Names what differs, and both.
    """
    if not cell.own:
        return
    wanted, found = cell.loaded_robot().geometry, facts.robot.geometry
    pairs = {
        "tool [m]": (wanted.tool_position, found.tool_position),
        "last link with tool [kg]": (
            cell.loaded_robot().links.mass[6],
            facts.robot.links.mass[6],
        ),
    }
    if facts.limits.walls:
        pairs["walls_low [m]"] = cell.walls[0], facts.limits.x_min
        pairs["walls_high [m]"] = cell.walls[1], facts.limits.x_max
    for name, (ours, theirs) in pairs.items():
        if not np.allclose(ours, theirs, rtol=0.0, atol=1e-9):
            raise ConfigError(
                f"the arm was built for another cell: its {name} is "
                f"{np.round(theirs, 4).tolist()}, the cell file's "
                f"{np.round(ours, 4).tolist()}; build the arm with the same cell, or "
                "give its address in its place",
                name="cell",
            )


def _warn_of(address: TwinAddress) -> None:
    """Say, once in a process, what of a twin the limits were not shown to hold for."""
    name = address.twin or "given"
    for field, text in load_twin(address.config).unproven().items():
        warnings.warn(f"twin {name}, {field}: {text}", UnprovenWarning, stacklevel=2)


def build_local_arm(cell: Workcell, axes: TaskSpec, config: EnvConfig) -> LocalArm:
    """Build controller and plant in this process.

    Args:
        cell: What stands in it.
        axes: Mode of each axis.
        config: Its plant, control, actions and declared errors; the margins
            are those of hardware, as the same policy has to run there.

    Raises:
        ConfigError: Dynamics given with a twin, unknown plant or twin, or a setting out
            of range.
    """
    arm = build_arm(None, cell, axes, config)
    assert isinstance(arm, LocalArm)
    return arm


def make_settings(
    cell: Workcell, config: EnvConfig, *, is_hardware: bool = True
) -> tuple[OscConfig, LimitConfig]:
    """Return law and limits of the controller of an environment.

    Args:
        cell: Its robot, tool and held part, and its walls.
        config: Actions, limits near contact, control and declared errors.
        is_hardware: Margins for an arm that is not as the model says.

    Raises:
        ConfigError: Something is declared of an arm that is said to be its model.
    """
    declared = config.declared_errors()
    if not is_hardware and declared != DECLARED:
        given = ", ".join(f"{n} {x:g}" for n, x in declared.items())
        raise ConfigError(
            f"the arm's address says margins=model, of an arm that is exactly its "
            f"model, and errors are declared ({given}); give one of the two"
        )
    x_min, x_max = cell.walls
    limits = LimitConfig.for_period(
        cell.loaded_robot(),
        config.period,
        hardware=is_hardware,
        **(declared if is_hardware else {}),
        x_min=x_min,
        x_max=x_max,
        dx_max=[SPEED_MAX] * 3,
        near_speed=config.near_speed,
        near_press=config.near_press,
        scheme=config.scheme,
    )
    damping = per_axis("force_damping", config.force_damping)
    osc = OscConfig.for_period(
        config.period, force_damping=[*damping, *[max(damping)] * 3]
    )
    return osc, limits
