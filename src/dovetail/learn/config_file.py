"""A training's settings in a TOML file: a recipe, a file of one's own, or a run's.

Keys are the names of `TrainConfig`'s settings and of the task's options. A file may
come from a stranger: it chooses no module and no arm outside this process.
"""

import shlex
from pathlib import Path
from typing import Any

import tomlkit

from dovetail.arms.address import parse_address
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError, did_you_mean
from dovetail.learn.config import TrainConfig
from dovetail.plugins import OPTIONS, require_trusted
from dovetail.reading import read_toml
from dovetail.settings import names_in, unknown_settings
from dovetail.tasks.options import gather_options, option_types
from dovetail.tasks.shipped import DEFAULT_ENV

CONFIG = "config.toml"
MODEL = "model.toml"

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


def read_settings(path: Path, arm: str | None = None) -> dict[str, Any]:
    """Return the settings in a file as keyword arguments of `TrainConfig`.

    Args:
        path: A TOML file, or the folder of a run.
        arm: The arm as the user gives it again: a file must not choose an arm outside
            this process.

    Raises:
        ConfigError: The file cannot be read, an unknown key (names the nearest known
            one), or an arm or a module that the user has not named.
    """
    path = path.expanduser()
    path = path / CONFIG if path.is_dir() else path
    try:
        table = read_toml(path)
    except FileNotFoundError as error:
        raise ConfigError(f"there is no file {path}") from error
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    for name in OPTIONS:
        if name in table:
            require_trusted(path, name, table[name], is_option=True)
    task = task_class(table.get("env", DEFAULT_ENV))
    known = {*names_in(TrainConfig), *option_types(task)} - {"task_options", "resume"}
    if unknown := set(table) - known:
        raise unknown_settings(unknown, sorted(known), str(path))
    if (named := table.get("arm")) is not None:
        _require_given(str(named), arm, path)
    if isinstance(model := table.get("model"), str):
        beside = path.parent / model
        table["model"] = beside if beside.is_file() else Path(model)
    return gather_options(table, task)


def load_config(path: Path, arm: str | None = None, **changed: Any) -> TrainConfig:
    """Return the settings in a file as a record, some of them changed.

    Raises:
        ConfigError: See `read_settings`; or a value that is wrong: names it.
    """
    settings = read_settings(path, arm)
    try:
        return TrainConfig(**settings | changed)
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
