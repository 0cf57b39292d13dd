"""Settings of an environment: nested, frozen, each default written here alone.

`EnvConfig.of(near_speed=0.05, twin="medium")` takes the fields of every section by
their short names, which are those of the command line; `flat` gives them back.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Fixed

from dovetail.control.limits import TABLE, DeclaredErrors
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.period_option import Period
from dovetail.control.ranges import Range
from dovetail.control.sections import Section, Sectioned
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import Twin
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.tasks.shipped import EPISODE_STEPS
from dovetail.trackers.find import DEFAULT_TRACKER

F_SCALE = 4.0
"""f* at action 1 on X Y Z [m/s2]."""
FORCE_DAMPING = 40.0
"""Damping of force axes [1/s]."""
FALL_BACK = "dovetail.search.fall_back_env:FallBackEnv"
"""Environment in which a script takes over from an action that does not succeed."""
ENDLESS = 1_000_000
"""Actions of an episode that only success or its user ends."""
SCRIPTS = {"corner": "dovetail.search.corrected_env:CorrectedEnv"}
"""Scripts that an action may correct, and the environment in which it does."""


@dataclass(frozen=True, kw_only=True)
class ActionConfig(Section):
    """Meaning of an action in [-1, 1]."""

    f_scale: tuple[float, ...] | float = F_SCALE
    """f* at action 1 on X Y Z [m/s2]: one number, or three."""
    f_scale_angular: Annotated[float, Range(0.0, 1000.0, "rad/s2")] = 20.0
    """f* at action 1 on A B C [rad/s2]."""
    theta_range: Annotated[float, Range(0.0, math.pi, "rad")] = 0.2
    """Rotation at action 1 on pose axes A B C [rad]."""
    position_range: Annotated[float, Range(0.0, 1.0, "m")] = 0.05
    """Displacement at action 1 on pose axes X Y Z [m]."""
    force_damping: tuple[float, ...] | float = FORCE_DAMPING
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

    def __post_init__(self) -> None:
        """Refuse a script that is not there, and a number out of range."""
        if self.script == "none":
            object.__setattr__(self, "script", None)
        if self.script is not None and self.script not in SCRIPTS:
            known = ", ".join(SCRIPTS)
            raise ConfigError(f"script {self.script!r} is unknown; known: {known}")
        super().__post_init__()
        if self.script is not None and self.fall_back:
            raise ConfigError(
                f"fall_back is {self.fall_back:g} s with script {self.script!r}, whose "
                "corrections fade: it acts alone in the end; leave fall_back out"
            )


@dataclass(frozen=True, kw_only=True)
class ApproachConfig(Section):
    """Limits near contact, for every policy."""

    near_speed: float = 0.02
    """Speed limit of the tool there, per axis [m/s]."""
    near_press: float = 1.5
    """Largest f* towards the fixture there [m/s2], tare not counted. Times the
    effective mass, about 10 kg, it is the force of standing on the rim."""
    near_distance: Annotated[float, Range(0.0, 1.0, "m")] = 0.01
    """Height above the fixture's mouth below which contact is near [m]."""


@dataclass(frozen=True, kw_only=True)
class ControlConfig(Section):
    """Control period, and scheme of the limits."""

    period: Period = DEFAULT_PERIOD
    """Control period: 1ms, 2ms, 2.5ms or 5ms. An action acts for 50 ms at any of them;
    an arm's address may give its own."""
    scheme: str = "qp"
    """Scheme that keeps the limits: qp or paper."""


@dataclass(frozen=True, kw_only=True)
class ObservationConfig(Section):
    """Observation of the policy: the task's columns, and more."""

    also: tuple[str, ...] = ()
    """Columns the policy sees beside the task's: tilt, spin, wrench or force."""
    recall: tuple[int, ...] = ()
    """Ages [steps] of past tool positions that the policy sees. Past tilts are added if
    the tilt is shown; with any age the last action is added, too."""
    stack: int = 0
    """Past (observation, action) pairs in the observation."""
    tracker: str = DEFAULT_TRACKER
    """Source of the fixture's pose: truth, late or a camera's file.
    With numbers: delayed?delay=0.1, late?bias=0.002. Of a camera.toml its delay, rate
    and error are taken, not its pictures; MODULE:CLASS is one of your own."""


@dataclass(frozen=True, kw_only=True)
class PlaceConfig(Section):
    """Plant or arm, and robot. `Fixed` fields are no options of a command."""

    plant: str = "mujoco"
    """Physics engine: mujoco or bullet. Of the plain plant, not of a twin or an arm."""
    twin: Annotated[Twin | str | Path | None, Fixed] = None
    """A twin, its name or its file, to use in place of the plain plant."""
    arm: Annotated[str | None, Fixed] = None
    """Address of the arm, see `arms.address`; None is the plant or twin."""
    engine: Annotated[str | None, Fixed] = None
    """Physics engine of the twin, if not the one in its file."""
    dynamics: Annotated[DynamicsConfig | None, Fixed] = None
    """Physics of the plain plant, if not the robot's; a twin has its own."""
    robot: str = DEFAULT_ROBOT
    """Robot in the cell, or MODULE:FUNCTION of your own."""


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig(Section):
    """Length of an episode, and the tare before it."""

    max_steps: Annotated[int, Range(1, ENDLESS, "steps")] = EPISODE_STEPS
    """Actions per episode, of 50 ms each. `gym.make` calls it max_episode_steps."""
    tare: bool | None = None
    """Measure before each episode the weight that gravity compensation misses. It takes
    2.2 s in free air, and is taken off what the policy commands. Left out, it is done
    on every arm but the nominal simulation, which misses none, where force axes are
    damped enough for it."""


@dataclass(frozen=True, kw_only=True)
class EnvConfig(Sectioned):
    """Everything about an environment but its task and its arm."""

    whose: ClassVar[str] = "an environment"

    action: ActionConfig = field(default_factory=ActionConfig)
    """Meaning of an action."""
    approach: ApproachConfig = field(default_factory=ApproachConfig)
    """Limits near contact."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """Control period, and scheme of the limits."""
    declared: DeclaredErrors = TABLE
    """Largest declared differences between the arm and its model."""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    """Observation of the policy."""
    place: PlaceConfig = field(default_factory=PlaceConfig)
    """Plant or arm, and robot."""
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    """Length of an episode, and the tare before it."""


USUAL = EnvConfig()
"""Default settings."""
