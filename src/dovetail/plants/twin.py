"""Twins: plants made to differ from the model on purpose; they play the real robot.

A twin is a TOML file in which every key of `Twin` is present and no other, but
the table [camera], which may be left out. A result on a twin says "twin", never
"robot".
"""

import warnings
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from dovetail.control.proven import unproven
from dovetail.control.ranges import Range, check_ranges, ranges_of
from dovetail.control.sections import Sectioned, settings_in
from dovetail.errors import ConfigError, UnprovenWarning, did_you_mean
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DrivenPlant, DynamicsConfig, Engine
from dovetail.plants.twin_camera import TwinCamera
from dovetail.plants.twin_parts import TwinArm, TwinChannel, TwinContact
from dovetail.reading import read_toml

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot
    from dovetail.workcell.workcell import Workcell

TWIN_FOLDER = Path(__file__).parent.parent / "twins"
"""Folder of the shipped twins."""


@dataclass(frozen=True, kw_only=True)
class Twin(Sectioned):
    """Everything in which a twin differs from the model. No number has a default.

    `of`, `having` and `table` know every number by its key in a twin's file.
    """

    whose: ClassVar[str] = "a twin"

    description: str
    """Description of the twin, one line."""
    engine: Engine
    """Physics engine: another one than the policy was trained in."""
    seed: Annotated[int, Range(0, 2**63 - 1, "1")]
    """Seed of the noise, >= 0."""
    arm: TwinArm
    """The arm: masses, gravity, friction and rotors."""
    channel: TwinChannel
    """Between controller and joints."""
    contact: TwinContact
    """Contact of the tool."""
    clearance_offset: Annotated[float, Range(-0.005, 0.005, "m")]
    """True clearance minus the task's, per side [m]."""
    camera: TwinCamera | None = None
    """Errors of its camera; None if the twin's file gives none."""

    def __post_init__(self) -> None:
        """Refuse a number out of range, by name."""
        if not isinstance(self.description, str):
            raise ConfigError(
                f"twin description is {self.description!r}; give one line of text"
            )
        if self.camera is not None and not isinstance(self.camera, TwinCamera):
            object.__setattr__(self, "camera", _camera(self.camera))
        check_ranges(self, "twin")

    def table(self) -> dict[str, Any]:
        """Return what its file holds by key, the camera's as a table of its own."""
        camera = None if self.camera is None else self.camera.flat()
        return self.flat() | {"camera": camera}

    def dynamics(self) -> DynamicsConfig:
        """Return the part that the engine simulates."""
        return DynamicsConfig.of(**vars(self.arm), **vars(self.contact))

    def on(self, robot: "Robot") -> Self:
        """Return the twin of a robot: with its own inertia set where it lacks this."""
        own = robot.links.inertia_set
        return self.having(inertia=own) if self.lacks(robot) else self

    def lacks(self, robot: "Robot") -> str:
        """Say that a robot has not the twin's inertia set; empty where it has."""
        own, inertia = robot.links.inertia_set, self.arm.inertia
        if inertia in (own, *robot.links.inertia_sets):
            return ""
        return (
            f"the twin's inertia set {inertia!r} is of another robot: in its "
            f"place {own!r} of {robot.name} is taken, with the twin's friction and "
            f"rotors; a file that says so: dovetail "
            f"twin show NAME > mine.toml, there inertia = {own!r}, --twin mine.toml"
        )

    def unproven(self) -> dict[str, str]:
        """Say by field what lies outside that for which the limits were shown to hold.

        Returns:
            A sentence with value, allowed range and remedy for each such field.
        """
        error = max(abs(scale - 1.0) for scale in self.arm.mass_scale)
        said = {
            "command_delay": unproven(delay=self.channel.command_delay),
            "mass_scale": unproven(mass_error=error),
        }
        return {name: texts[0] for name, texts in said.items() if texts}

    def to_toml(self, *, is_ascii: bool = False) -> str:
        """Write the twin as the text of a file that `load_twin` reads, with its units.

        Args:
            is_ascii: Escape every other character, for a terminal that has none.
        """
        lines = _keys(self, is_ascii)
        if self.camera is not None:
            lines += ["", "[camera]", *_keys(self.camera, is_ascii)]
        return "\n".join(lines) + "\n"


def _keys(config: "Twin | TwinCamera", is_ascii: bool) -> list[str]:
    """Return a line for each key that is no table."""
    lines, known = [], settings_in(type(config))
    for name, value in config.flat().items():
        if isinstance(value, TwinCamera) or value is None:
            continue
        if isinstance(value, str):
            text = f'"{"".join(_escaped(c, is_ascii) for c in value)}"'
        elif isinstance(value, tuple):
            text = "[" + ", ".join(repr(v) for v in value) + "]"
        else:
            text = repr(value)
        ranges = ranges_of(known[name].owner)
        unit = ranges[name].unit if name in ranges else "1"
        lines.append(f"{name} = {text}" + (f"  # {unit}" if unit != "1" else ""))
    return lines


def _escaped(c: str, is_ascii: bool) -> str:
    """Return a character of a TOML string; what steers a terminal is escaped, too."""
    if c in '"\\':
        return f"\\{c}"
    if c.isprintable() and (c.isascii() or not is_ascii):
        return c
    return f"\\u{ord(c):04x}" if ord(c) < 0x10000 else f"\\U{ord(c):08x}"


def list_twins() -> tuple[str, ...]:
    """Return the names of the shipped twins."""
    return tuple(sorted(path.stem for path in TWIN_FOLDER.glob("*.toml")))


def load_twin(name_or_path: Twin | str | Path) -> Twin:
    """Read a shipped twin by name, or any twin by the path of its file.

    A twin that was read already is returned.

    Raises:
        ConfigError: No such twin, damaged file, unknown or missing key, or a value out
            of range; the message lists the known names.
    """
    if isinstance(name_or_path, Twin):
        return name_or_path
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = TWIN_FOLDER / f"{name_or_path}.toml"
    if not path.is_file():
        raise ConfigError(
            f"no twin {str(name_or_path)!r}"
            f"{did_you_mean(str(name_or_path), list_twins())}; shipped twins: "
            f"{', '.join(list_twins())}; or give the path of a .toml file"
        )
    try:
        table = read_toml(path)
    except OSError as error:
        raise ConfigError(f"cannot read twin file {path}: {error.strerror}") from error
    except ConfigError as error:
        raise ConfigError(f"twin file {error}") from error
    known = settings_in(Twin)
    unknown = [key for key in table if key not in known]
    needed = [name for name, setting in known.items() if setting.default is MISSING]
    missing = [key for key in needed if key not in table]
    if unknown or missing:
        names = ", ".join(key + did_you_mean(key, known) for key in unknown)
        raise ConfigError(
            f"twin file {path}: unknown keys: {names or 'none'}; missing keys: "
            f"{', '.join(missing) or 'none'}; known keys: {', '.join(known)}"
        )
    try:
        return Twin.of(**table)
    except ConfigError as error:
        raise ConfigError(f"twin file {path}: {error}") from error


def _camera(table: object) -> TwinCamera:
    """Return what a table of a file says."""
    known = [*settings_in(TwinCamera)]
    if not isinstance(table, dict):
        raise ConfigError("camera is no table; give [camera] and its keys below it")
    if unknown := [str(key) for key in table if key not in known]:
        raise ConfigError(
            f"[camera] has unknown keys: "
            f"{', '.join(key + did_you_mean(key, known) for key in unknown)}; known: "
            f"{', '.join(known)}"
        )
    return TwinCamera.of(**{str(key): value for key, value in table.items()})


def make_twin(
    config: Twin | str | Path, cell: "Workcell", *, engine: str | None = None
) -> DrivenPlant:
    """Build a plant with a twin's dynamics, and its delay and noise at the joints.

    Args:
        config: The twin, its name, or its file.
        cell: As the policy knows it; the twin's clearance differs.
        engine: Another engine than the twin's.

    Raises:
        ConfigError: The twin's clearance would be negative.
        MissingDependencyError: The engine is not installed.
    """
    from dovetail import _core

    config = load_twin(config)
    if lack := config.lacks(cell.robot):
        warnings.warn(lack, UnprovenWarning, stacklevel=2)
    config = config.on(cell.robot)
    name, widened = engine or config.engine, cell.widened(config.clearance_offset)
    plant = make_plant(name, widened, config.dynamics())
    plant.attach_channel(
        _core.Channel(
            delay=config.channel.command_delay,
            torque_noise=config.channel.torque_noise,
            position_noise=config.channel.position_noise,
            velocity_noise=config.channel.velocity_noise,
            seed=config.seed,
        )
    )
    return plant
