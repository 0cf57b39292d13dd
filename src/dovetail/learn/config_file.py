"""A training's settings in a TOML file: a recipe, a file of one's own, or a run's.

Keys are the names of `TrainConfig`'s settings and of the task's options. A file may
come from a stranger: it chooses no module and no arm outside this process.
"""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from dovetail.arms.address import parse_address
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError, did_you_mean
from dovetail.learn.config import NOT_COMPARED, TrainConfig
from dovetail.plugins import OPTIONS, is_read, require_trusted
from dovetail.reading import read_toml
from dovetail.robots.find import whole_robot
from dovetail.settings import check_values, names_in, unknown_settings
from dovetail.tasks.options import gather_options, option_types, require_types
from dovetail.tasks.shipped import DEFAULT_ENV

CONFIG = "config.toml"
MODEL = "model.toml"

_TASK = ("task_options",)
_RECIPES = Path(__file__).parent.parent / "recipes"


def list_recipes() -> tuple[str, ...]:
    """Return the names of the shipped recipes."""
    return tuple(sorted(path.stem for path in _RECIPES.glob("*.toml")))


def find_recipe(name: str) -> Path:
    """Return the file of a recipe: a shipped one by its name, or a file of one's own.

    Raises:
        ConfigError: There is no such recipe; lists the shipped ones.
    """
    path = Path(name).expanduser()
    if path.suffix != ".toml":
        path = _RECIPES / f"{name}.toml"
    if not path.is_file():
        shipped = list_recipes()
        raise ConfigError(
            f"no recipe {name!r}{did_you_mean(name, shipped)}; shipped recipes: "
            f"{', '.join(shipped)}; or give the path of a .toml file",
            name="recipe",
            value=name,
            allowed=shipped,
        )
    return path


def read_settings(
    path: Path, arm: str | None = None, *, is_run: bool = False
) -> dict[str, Any]:
    """Return the settings in a file as keyword arguments of `TrainConfig`.

    Each value is checked, but none beside another: the command line may change them.

    Args:
        path: A TOML file, or the folder of a run.
        arm: The arm that the user has given. It takes the place of the file's.
        is_run: The run is to go on: its arm must be the given one.

    Raises:
        ConfigError: The file cannot be read, an unknown key (names the nearest known
            one), a wrong value, a setting that no file chooses, or an arm or a module
            that the user has not named.
    """
    path = path.expanduser()
    path = path / CONFIG if path.is_dir() else path
    table = _read_table(path)
    task = task_class(table.get("env", DEFAULT_ENV))
    names = [n for n in names_in(TrainConfig) if n not in (*NOT_COMPARED, *_TASK)]
    if unknown := set(table) - {*names, *option_types(task)}:
        known = sorted([*names, *option_types(task)])
        raise unknown_settings(unknown, known, str(path))
    if "arm" in table and arm is not None and not is_run:
        table["arm"] = arm
    elif "arm" in table:
        _require_given(str(table["arm"]), arm, path)
    if isinstance(model := table.get("model"), str):
        beside = path.parent / model
        table["model"] = beside if beside.is_file() else Path(model)
    if isinstance(cell := table.get("cell"), str):
        beside = path.parent / cell
        table["cell"] = beside if beside.is_file() else Path(cell)
    try:
        shared = {name: table[name] for name in names if name in table}
        require_types(table, task)
        return gather_options(table | check_values(TrainConfig, shared), task)
    except ConfigError as error:
        error.args = (f"{path}: {error}",)
        raise


def _read_table(path: Path) -> dict[str, Any]:
    """Return a file's table, if it chooses nothing that is the user's to choose."""
    try:
        table = read_toml(path)
    except FileNotFoundError as error:
        raise ConfigError(f"there is no file {path}") from error
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    table = _with_robot(table, path)
    for name in OPTIONS:
        if name in table:
            require_trusted(path, name, table[name], is_option=True)
    for name in NOT_COMPARED:
        if name in table:
            raise ConfigError(
                f"{path} gives {name}, which no file chooses: leave it out there, and "
                f"give --{name}",
                name=name,
                value=table[name],
            )
    return table


def _with_robot(table: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return a table with the robot in the place of its file, which may lie beside."""
    name = table.get("robot")
    if not (isinstance(name, str) and is_read(name)):
        return table
    beside = path.parent / name
    return table | {"robot": whole_robot(str(beside) if beside.is_file() else name)}


def load_config(path: Path, arm: str | None = None, **changed: Any) -> TrainConfig:
    """Return the settings in a file as a record, some of them changed.

    Raises:
        ConfigError: See `read_settings`; or settings that exclude each other.
    """
    return config_of(path, read_settings(path, arm) | changed)


def config_of(path: Path, settings: Mapping[str, Any]) -> TrainConfig:
    """Return settings of a file as a record; its errors name the file."""
    try:
        return TrainConfig(**settings)
    except ConfigError as error:
        error.args = (f"{path}: {error}",)
        raise


def to_toml(config: TrainConfig) -> str:
    """Return a run's settings as the text of its file; its model lies beside it."""
    table = config.to_json() | ({} if config.model is None else {"model": MODEL})
    return tomlkit.dumps({n: value for n, value in table.items() if value is not None})


def _require_given(named: str, given: str | None, file: Path) -> None:
    """Refuse an arm outside this process that only a file names.

    Raises:
        ConfigError: It is not the given one, or none is given.
    """
    address = parse_address(named)
    if address.is_here or (given is not None and parse_address(given) == address):
        return
    what = "which may be a robot" if address.may_be_robot else "outside this process"
    wrong = "is not given again" if given is None else f"is not the given {given!r}"
    raise ConfigError(
        f"{file} names the arm {named!r}, {what}, and it {wrong}; if this run may use "
        f"that arm, add --arm {shlex.quote(named)}"
    )
