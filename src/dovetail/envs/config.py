"""Settings of an environment: nested, frozen, each default written here alone.

`EnvConfig.of(near_speed=0.05, twin="medium")` takes the fields of every section by
their short names, which are those of the command line; `flat` gives them back.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Self

from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.ranges import Range, check_ranges
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import TwinConfig
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.trackers.find import DEFAULT_TRACKER

F_SCALE = 4.0
"""f* at action 1 on X Y Z [m/s2]."""
FORCE_DAMPING = 40.0
"""Damping of force axes [1/s]."""
FALL_BACK = "dovetail.search.fall_back_env:FallBackEnv"
"""Environment in which a script takes over from an action that does not succeed."""
SCRIPTS = {"corner": "dovetail.search.corrected_env:CorrectedEnv"}
"""Scripts that an action may correct, and the environment in which it does."""


@dataclass(frozen=True, kw_only=True)
class ActionConfig:
    """What an action in [-1, 1] means."""

    f_scale: float | tuple[float, ...] = F_SCALE
    """f* at action 1 on X Y Z [m/s2]: one number, or three."""
    f_scale_angular: Annotated[float, Range(0.0, 1000.0, "rad/s2")] = 20.0
    """f* at action 1 on A B C [rad/s2]."""
    theta_range: Annotated[float, Range(0.0, math.pi, "rad")] = 0.2
    """Rotation at action 1 on pose axes A B C [rad]."""
    position_range: Annotated[float, Range(0.0, 1.0, "m")] = 0.05
    """Displacement at action 1 on pose axes X Y Z [m]."""
    force_damping: float | tuple[float, ...] = FORCE_DAMPING
    """Damping D of force axes X Y Z [1/s], one number or three: f_scale / D is the top
    speed. The paper has 0; near_speed and near_press act all the same, until they are
    0.25 m/s (the limit everywhere) and f_scale; tare needs damping."""
    script: str | None = None
    """Script that acts, corrected by the action: corner, see `search.corrected_env`;
    None is the action alone."""
    correction: Annotated[float, Range(0.0, 1.0, "1")] = 0.5
    """How much of an action is added to what the script does [1]."""
    fall_back: Annotated[float, Range(0.0, 3600.0, "s")] = 0.0
    """Time of an episode after which the corner search acts in the action's place [s];
    0 is never."""

    def __post_init__(self) -> None:
        """Refuse a script that is not there, and a number out of range."""
        if self.script is not None and self.script not in SCRIPTS:
            known = ", ".join(SCRIPTS)
            raise ConfigError(f"script {self.script!r} is unknown; known: {known}")
        check_ranges(self)
        if self.script is not None and self.fall_back:
            raise ConfigError(
                f"fall_back is {self.fall_back:g} s with script {self.script!r}, whose "
                "corrections fade: it acts alone in the end; leave fall_back out"
            )


@dataclass(frozen=True, kw_only=True)
class ApproachConfig:
    """What holds where contact is near, whatever the policy does."""

    near_speed: float = 0.02
    """Speed limit of the TCP per axis where contact is near [m/s]."""
    near_press: float = 1.5
    """Largest f* towards the fixture there [m/s2], tare not counted: times the
    effective mass, about 10 kg, it is the force of standing on the rim."""
    near_distance: Annotated[float, Range(0.0, 1.0, "m")] = 0.01
    """How far above the fixture's surface that begins [m]."""

    def __post_init__(self) -> None:
        """Refuse a distance out of range."""
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class ControlConfig:
    """How the controller runs."""

    period: float = DEFAULT_PERIOD
    """Control period [s]: 0.001, 0.002, 0.0025 or 0.005."""
    scheme: str = "qp"
    """How limits are kept, "qp" or "paper"."""


@dataclass(frozen=True, kw_only=True)
class ObservationConfig:
    """What the policy sees; its columns are the task's, and more."""

    also: tuple[str, ...] = ()
    """Groups of columns beside the task's, see `envs.observation.GROUPS`: tilt, say."""
    recall: tuple[int, ...] = ()
    """Ages [policy steps]: where the tool was that long ago, and how it was tilted if
    that is shown, is appended; with any age the last action, too."""
    stack: int = 0
    """Number of past (observation, action) pairs to append."""
    tracker: str = DEFAULT_TRACKER
    """Where the fixture is, as far as one may know: see `trackers.find`."""


@dataclass(frozen=True, kw_only=True)
class PlaceConfig:
    """Where it runs."""

    plant: str = "mujoco"
    """Physics engine of the plain plant, "mujoco" or "bullet"."""
    twin: TwinConfig | str | Path | None = None
    """A twin, its name or its file, to use in place of the plain plant."""
    arm: str | None = None
    """Address of the arm, see `arms.address`; None is the plant or twin."""
    engine: str | None = None
    """Physics engine of the twin, if not the one in its file."""
    dynamics: DynamicsConfig | None = None
    """Physics of the plain plant, if not the robot's; a twin has its own."""
    robot: str = DEFAULT_ROBOT
    """Robot in the cell, see `robots.find`."""


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """How an episode begins and ends."""

    max_steps: Annotated[int, Range(1, 1_000_000, "steps")] = 200
    """Episode length [policy steps of 50 ms]."""
    tare: bool = False
    """Measure at each reset, in free air, the f* that holds the weight which the arm's
    gravity compensation misses, and add it to every action's: 2.2 s."""

    def __post_init__(self) -> None:
        """Refuse a length that is none."""
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """Everything about an environment but its task and its arm."""

    action: ActionConfig = field(default_factory=ActionConfig)
    """What an action means."""
    approach: ApproachConfig = field(default_factory=ApproachConfig)
    """What holds where contact is near."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """How the controller runs."""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    """What the policy sees."""
    place: PlaceConfig = field(default_factory=PlaceConfig)
    """Where it runs."""
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    """How an episode begins and ends."""

    @classmethod
    def of(cls, **settings: Any) -> Self:
        """Return the usual settings with these changed, by their short names.

        Raises:
            ConfigError: An unknown name, or a value out of range.
        """
        return cls().having(**settings)

    def having(self, **settings: Any) -> Self:
        """Return these settings with others changed, by their short names.

        Raises:
            ConfigError: An unknown name (lists the known ones), or a value out of
                range.
        """
        if unknown := sorted(set(settings) - set(SECTION_OF)):
            raise ConfigError(
                f"unknown settings of an environment: {', '.join(unknown)}; known: "
                f"{', '.join(SECTION_OF)}"
            )
        changed: dict[str, dict[str, Any]] = {}
        for name, value in settings.items():
            whole = tuple(value) if isinstance(value, list) else value
            changed.setdefault(SECTION_OF[name], {})[name] = whole
        return replace(
            self,
            **{
                section: replace(vars(self)[section], **values)
                for section, values in changed.items()
            },
        )

    def flat(self) -> dict[str, Any]:
        """Return every setting by its short name."""
        return {
            name: vars(vars(self)[section])[name]
            for name, section in SECTION_OF.items()
        }


SECTIONS: Mapping[str, type] = {
    "action": ActionConfig,
    "approach": ApproachConfig,
    "control": ControlConfig,
    "observation": ObservationConfig,
    "place": PlaceConfig,
    "episode": EpisodeConfig,
}
SECTION_OF: Mapping[str, str] = {
    f.name: section for section, kind in SECTIONS.items() for f in fields(kind)
}
"""Short name of each setting, and the section that has it."""
USUAL = EnvConfig()
"""What holds where nothing else is asked for."""
