"""Twins: plants made to differ from the model on purpose; they play the real robot.

A twin is a TOML file in which every key of `Twin` is present and no other, but
the table [camera], which may be left out. A result on a twin says "twin", never
"robot".
"""

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import tomlkit
from pydantic import field_validator

from dovetail.control.proven import unproven
from dovetail.errors import ConfigError, UnprovenWarning, did_you_mean
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DrivenPlant, DynamicsConfig
from dovetail.plants.twin_camera import TwinCamera
from dovetail.plants.twin_parts import TwinArm, TwinChannel, TwinContact, TwinRun
from dovetail.reading import read_toml
from dovetail.settings import (
    Range,
    defaults_of,
    names_in,
    ranges_of,
    settings,
    values_of,
)

if TYPE_CHECKING:
    from dovetail.robots.robot import Robot
    from dovetail.workcell.workcell import Workcell

TWIN_FOLDER = Path(__file__).parent.parent / "twins"
"""Folder of the shipped twins."""


@settings(owner="twin")
class Twin(TwinRun, TwinArm, TwinChannel, TwinContact):
    """Everything in which a twin differs from the model. No number has a default."""

    clearance_offset: Annotated[float, Range(-0.005, 0.005, "m")]
    """True clearance minus the task's, per side [m]."""
    camera: TwinCamera | None = None
    """Errors of its camera; None if the twin's file gives none."""

    @field_validator("camera", mode="before")
    @classmethod
    def _read_camera(cls, table: Any) -> Any:
        """Return what a table of a file says."""
        return TwinCamera(**table) if isinstance(table, dict) else table

    def table(self) -> dict[str, Any]:
        """Return what its file holds by key, the camera's as a table of its own."""
        camera = None if self.camera is None else values_of(self.camera)
        return values_of(self) | {"camera": camera}

    def dynamics(self) -> DynamicsConfig:
        """Return the part that the engine simulates."""
        shared = [n for n in names_in(DynamicsConfig) if n in names_in(Twin)]
        return DynamicsConfig(**{name: vars(self)[name] for name in shared})

    def on(self, robot: "Robot") -> Self:
        """Return the twin of a robot: with its own inertia set where it lacks this."""
        own = robot.links.inertia_set
        return replace(self, inertia=own) if self.lacks(robot) else self

    def lacks(self, robot: "Robot") -> str:
        """Say that a robot has not the twin's inertia set; empty where it has."""
        own, inertia = robot.links.inertia_set, self.inertia
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
        error = max(abs(scale - 1.0) for scale in self.mass_scale)
        said = {
            "command_delay": unproven(delay=self.command_delay),
            "mass_scale": unproven(mass_error=error),
        }
        return {name: texts[0] for name, texts in said.items() if texts}

    def to_toml(self, *, is_ascii: bool = False) -> str:
        """Write the twin as the text of a file that `load_twin` reads, with its units.

        Args:
            is_ascii: Escape every other character, for a terminal that has none.
        """
        document = tomlkit.document()
        for name, value in _items(self):
            document.add(name, value)
        if self.camera is not None:
            camera = tomlkit.table()
            for name, value in _items(self.camera):
                camera.add(name, value)
            document.add(tomlkit.nl())
            document.add("camera", camera)
        lines = tomlkit.dumps(document).split("\n")
        return "\n".join(
            "".join(_escaped(c, is_ascii=is_ascii) for c in line) for line in lines
        )


def _items(config: "Twin | TwinCamera") -> Iterator[tuple[str, Any]]:
    """Yield each number and text with its unit beside it, as TOML."""
    ranges = ranges_of(type(config))
    for name, value in values_of(config).items():
        if name == "camera":
            continue
        item = tomlkit.item(value)
        if name in ranges and ranges[name].unit != "1":
            item.comment(ranges[name].unit)
        yield name, item


def _escaped(c: str, *, is_ascii: bool) -> str:
    """Return a character of a TOML text; what steers a terminal is escaped, too."""
    if c.isprintable() and (c.isascii() or not is_ascii):
        return c
    code = ord(c)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


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
    known = names_in(Twin)
    unknown = [key for key in table if key not in known]
    optional = defaults_of(Twin)
    missing = [key for key in known if key not in table and key not in optional]
    if unknown or missing:
        names = ", ".join(key + did_you_mean(key, known) for key in unknown)
        raise ConfigError(
            f"twin file {path}: unknown keys: {names or 'none'}; missing keys: "
            f"{', '.join(missing) or 'none'}; known keys: {', '.join(known)}"
        )
    try:
        return Twin(**table)
    except ConfigError as error:
        raise ConfigError(f"twin file {path}: {error}") from error


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
            delay=config.command_delay,
            torque_noise=config.torque_noise,
            position_noise=config.position_noise,
            velocity_noise=config.velocity_noise,
            seed=config.seed,
        )
    )
    return plant
