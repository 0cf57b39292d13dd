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
"""Actions of an episode that only its success ends, or who runs it."""
SCRIPTS = {"corner": "dovetail.search.corrected_env:CorrectedEnv"}
"""Scripts that an action may correct, and the environment in which it does."""


@dataclass(frozen=True, kw_only=True)
class ActionConfig(Section):
    """What an action in [-1, 1] means."""

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
    """How much of an action is added to what the script does [1]."""
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
    """What holds near contact, whatever the policy does."""

    near_speed: float = 0.02
    """Speed limit of the tool there, per axis [m/s]."""
    near_press: float = 1.5
    """Largest f* towards the fixture there [m/s2], tare not counted. Times the
    effective mass, about 10 kg, it is the force of standing on the rim."""
    near_distance: Annotated[float, Range(0.0, 1.0, "m")] = 0.01
    """How far above the fixture's mouth contact is near [m]."""


@dataclass(frozen=True, kw_only=True)
class ControlConfig(Section):
    """How the controller runs."""

    period: Period = DEFAULT_PERIOD
    """Control period: 1ms, 2ms, 2.5ms or 5ms. An action acts for 50 ms at any of them;
    an arm's address may give its own."""
    scheme: str = "qp"
    """How the controller keeps its limits: qp or paper."""


@dataclass(frozen=True, kw_only=True)
class ObservationConfig(Section):
    """What the policy sees. Its columns are the task's, and more."""

    also: tuple[str, ...] = ()
    """Columns the policy sees beside the task's: tilt, spin, wrench or force."""
    recall: tuple[int, ...] = ()
    """Steps ago of which the policy sees where the tool was. And how it was tilted, if
    that is shown; with any of them the last action, too."""
    stack: int = 0
    """Past (observation, action) pairs in the observation."""
    tracker: str = DEFAULT_TRACKER
    """What tells where the fixture is: truth, late or a camera's file.
    With numbers: delayed?delay=0.1, late?bias=0.002. Of a camera.toml its delay, rate
    and error are taken, not its pictures; MODULE:CLASS is one of your own."""


@dataclass(frozen=True, kw_only=True)
class PlaceConfig(Section):
    """Where it runs. On a command line what is Fixed is no option."""

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
    """How an episode begins and ends."""

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
    """What an action means."""
    approach: ApproachConfig = field(default_factory=ApproachConfig)
    """What holds where contact is near."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """How the controller runs."""
    declared: DeclaredErrors = TABLE
    """How far the arm is from its model, at most."""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    """What the policy sees."""
    place: PlaceConfig = field(default_factory=PlaceConfig)
    """Where it runs."""
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    """How an episode begins and ends."""


USUAL = EnvConfig()
"""What holds where nothing else is asked for."""
