"""Settings of an environment: flat, frozen, each default written here alone."""

import math
from pathlib import Path
from typing import Annotated, Any, Self, TypeAlias

import numpy as np
import tyro
from pydantic import BeforeValidator, model_validator

from dovetail.control.limits import NEAR_PRESS, NEAR_SPEED, DeclaredErrors
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.errors import ConfigError
from dovetail.options import Period
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import Twin
from dovetail.robots.find import DEFAULT_ROBOT, whole_robot
from dovetail.settings import Range, fill_in, settings
from dovetail.tasks.shipped import EPISODE_STEPS
from dovetail.trackers.find import DEFAULT_TRACKER
from dovetail.workcell.cell_config import CellFile

F_SCALE = 4.0
"""f* at action 1 on X Y Z [m/s2]."""
FORCE_DAMPING = 40.0
"""Damping of force axes [1/s]."""
ENDLESS = 1_000_000
"""Actions of an episode that only success or its user ends."""
GRASP_ERROR, GRASP_TURN = Range(0.0, 0.01, "m"), Range(0.0, 0.2, "rad")
"""Ranges of a held part's displacement in the fingers."""
SCRIPTS = ("corner",)
"""Scripts that an action may correct."""


def _as_tuple(value: Any) -> Any:
    """Return one number as a tuple of it, and three as they are."""
    if np.ndim(value) == 0:
        return (value,)
    if len(value) not in (1, 3):
        raise ValueError("one number, or three: X Y Z")
    return value


PerAxis: TypeAlias = Annotated[
    tuple[float, ...] | float,
    BeforeValidator(_as_tuple),
    tyro.conf.arg(metavar="FLOAT [FLOAT FLOAT]"),
]
"""Type of a setting of X Y Z: three numbers, or one that holds for all."""


@settings()
class ActionConfig:
    """Meaning of an action in [-1, 1]."""

    f_scale: PerAxis = (F_SCALE,)
    """f* at action 1 on X Y Z [m/s2]: one number, or three."""
    f_scale_angular: Annotated[float, Range(0.0, 1000.0, "rad/s2")] = 20.0
    """f* at action 1 on A B C [rad/s2]."""
    theta_range: Annotated[float, Range(0.0, math.pi, "rad")] = 0.2
    """Rotation at action 1 on pose axes A B C [rad]."""
    position_range: Annotated[float, Range(0.0, 1.0, "m")] = 0.05
    """Displacement at action 1 on pose axes X Y Z [m]."""
    force_damping: PerAxis = (FORCE_DAMPING,)
    """Damping D of force axes X Y Z [1/s], one number or three. f_scale / D is the top
    speed. The paper has 0; near_speed and near_press act all the same, until they are
    0.25 m/s (the limit everywhere) and f_scale; tare needs damping."""
    script: str | None = None
    """Script that acts, corrected by the policy's action: corner, or none.
    It is then part of the policy, which sees what the script would do next, see
    `search.corrected_env`. A teacher's steps are the script's alone."""
    correction: Annotated[float, Range(0.0, 1.0, "1")] = 0.5
    """Share of an action that is added to the script's own [1]."""
    fall_back: Annotated[float, Range(0.0, 3600.0, "s")] = 0.0
    """Time after which the corner search takes over [s]; 0 is never.
    It does where the policy is used: a training is of the policy alone."""

    @model_validator(mode="after")
    def _check_action_config(self) -> Self:
        """Refuse a script that is not there, and a number out of range."""
        if self.script == "none":
            fill_in(self, script=None)
        if self.script is not None and self.script not in SCRIPTS:
            known = ", ".join(SCRIPTS)
            raise ConfigError(f"script {self.script!r} is unknown; known: {known}")
        if self.script is not None and self.fall_back:
            raise ConfigError(
                f"fall_back is {self.fall_back:g} s with script {self.script!r}, whose "
                "corrections fade: it acts alone in the end; leave fall_back out"
            )
        return self


@settings()
class ApproachConfig:
    """Limits near contact, for every policy."""

    near_speed: Annotated[float, NEAR_SPEED] = 0.02
    """Speed limit of the tool there, per axis [m/s]."""
    near_press: Annotated[float, NEAR_PRESS] = 1.5
    """Largest f* towards the fixture there [m/s2].
    The tare is not counted. Times the effective mass, about 10 kg, it is the force of
    standing on the rim."""
    near_distance: Annotated[float, Range(0.0, 1.0, "m")] = 0.01
    """Height above the fixture's mouth below which contact is near [m]."""


@settings()
class ControlConfig:
    """Control period, and scheme of the limits."""

    period: Period = DEFAULT_PERIOD
    """Control period: 1ms, 2ms, 2.5ms or 5ms. An action acts for 50 ms at any of them;
    an arm's address may give its own."""
    scheme: str = "qp"
    """Scheme that keeps the limits: qp or paper."""


@settings()
class ObservationConfig:
    """Observation of the policy: the task's columns, more of them, or fewer."""

    without: tuple[str, ...] = ()
    """Columns of the task's that the policy does not see: joints, velocity, ...
    Without joints it is taken on other arms of seven joints, too."""

    also: tuple[str, ...] = ()
    """Columns the policy sees beside the task's: tilt, mouth, spin or wrench.
    Of simulations also force and parts, the joints of parts that move."""
    recall: tuple[int, ...] = ()
    """Ages [steps] of past tool positions that the policy sees. Past tilts are added if
    the tilt is shown; with any age the last action is added, too."""
    stack: Annotated[int, Range(0, 100, "pairs")] = 0
    """Past (observation, action) pairs in the observation."""
    tracker: str = DEFAULT_TRACKER
    """Source of the fixture's pose: truth, late or a camera's file.
    With numbers: delayed?delay=0.1, late?bias=0.002. Of a camera.toml its delay, rate
    and error are taken, not its pictures; MODULE:CLASS is one of your own."""


@settings()
class PlantConfig:
    """Plant and robot."""

    plant: str = "mujoco"
    """Physics engine: mujoco, bullet or drake. Of the plain plant, not of a twin or an
    arm."""
    robot: str = DEFAULT_ROBOT
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    Settings and policies hold the robot of a file, not its path."""

    @model_validator(mode="after")
    def _check_plant_config(self) -> Self:
        """Read a robot's file."""
        fill_in(self, robot=whole_robot(self.robot))
        return self


@settings()
class CellSetting:
    """The cell."""

    cell: CellFile = None
    """Cell file: table, tool, walls, and where fixtures stand. What it leaves out is
    the task's own (docs/your-own-cell.md)."""


@settings()
class EpisodeConfig:
    """Length of an episode, and the tare before it."""

    max_steps: Annotated[int, Range(1, ENDLESS, "steps")] = EPISODE_STEPS
    """Actions per episode, of 50 ms each. `gym.make` calls it max_episode_steps."""
    tare: bool | None = None
    """Measure before each episode the weight that gravity compensation misses. It takes
    2.2 s in free air, and is taken off what the policy commands. Left out, it is done
    on every arm but the nominal simulation, which misses none, where force axes are
    damped enough for it."""


@settings()
class GraspConfig:
    """Displacement of the held part in the fingers, of simulated arms."""

    grasp_error: Annotated[float | None, GRASP_ERROR] = None
    """Largest displacement along each axis of the tool, drawn for each episode [m].
    A policy sees it only through contact. Left out, it is the task's own."""
    grasp_turn: Annotated[float | None, GRASP_TURN] = None
    """The same about each axis [rad]."""


@settings()
class EnvOptions(
    ActionConfig,
    ApproachConfig,
    ControlConfig,
    DeclaredErrors,
    ObservationConfig,
    PlantConfig,
    CellSetting,
    EpisodeConfig,
    GraspConfig,
):
    """Settings of an environment that a command line gives."""


@settings()
class EnvConfig(EnvOptions):
    """Everything about an environment but its task."""

    twin: Twin | str | Path | None = None
    """A twin, its name or its file, to use in place of the plain plant."""
    arm: str | None = None
    """Address of the arm, see `arms.address`; None is the plant or twin."""
    engine: str | None = None
    """Physics engine of the twin, if not the one in its file."""
    dynamics: DynamicsConfig | None = None
    """Physics of the plain plant, if not the robot's; a twin has its own."""


USUAL = EnvConfig()
"""Default settings."""
