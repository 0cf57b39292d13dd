"""The folder of a training run: claimed for one process, and only for its settings."""

import fcntl
import json
import shlex
from pathlib import Path
from typing import IO, Annotated, Any, Literal, get_args, get_origin

from dovetail.arms.address import parse_address
from dovetail.control.sections import settings_in
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError
from dovetail.files import (
    claim_output_folder,
    dated_folder,
    open_lock,
    require_empty,
    write_atomic,
)
from dovetail.learn.config import NOT_COMPARED, TrainConfig
from dovetail.reading import read_json
from dovetail.strangers import OPTIONS, require_trusted
from dovetail.tasks.options import gather_options, option_types
from dovetail.tasks.shipped import DEFAULT_ENV

CONFIG = "config.json"
MODEL = "model.toml"
PROGRESS = "progress.csv"
EVALUATION = "evaluation.json"
CHECKPOINTS = "checkpoints"
TENSORBOARD = "tensorboard"

_LOCK = ".lock"


def place_run(config: TrainConfig) -> TrainConfig:
    """Return the settings with a folder: a new one by the time where none is given."""
    if config.runs.out is not None or config.runs.resume:
        return config
    env = config.environment
    name = env.env.replace(":", "/").rpartition("/")[2]
    if env.env == DEFAULT_ENV:
        options, kinds = env.env_options(), option_types(env.task_class)
        name = "_".join(f"{k}_{options[k]}" for k in kinds if kinds[k] is str)
    return config.having(out=dated_folder("runs", f"{name}-"))


def settings_of(folder: Path, arm: str | None = None) -> dict[str, Any]:
    """Return a run's settings as keyword arguments of `TrainConfig.of`.

    Args:
        folder: The run's.
        arm: The arm as the user gives it again. A folder may come from a stranger: it
            must not choose an arm outside this process.

    Raises:
        ConfigError: There is no run, its config.json is damaged, or it names an arm, a
            robot perhaps, that the user has not given; names it.
    """
    content = _read_config(folder)
    kinds = {name: known.kind for name, known in settings_in(TrainConfig).items()}
    for name in OPTIONS:
        if name in content:
            require_trusted(folder / CONFIG, name, content[name], is_option=True)
    task = task_class(content.get("env", DEFAULT_ENV))
    kinds |= {name: kind | None for name, kind in option_types(task).items()}
    settings = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in content.items()
        if name in kinds and name not in NOT_COMPARED
    }
    if settings.get("model") is not None:  # config.json has its content
        file = folder / MODEL
        settings["model"] = file if file.exists() else None
    for name, value in settings.items():
        if not _is_of(kinds[name], value):
            raise ConfigError(
                f"{folder / CONFIG} is damaged: {name} is {str(value)[:80]!r}, which "
                "is no such setting; start a new run"
            )
    if (named := settings.get("arm")) is not None:
        _require_given(str(named), arm, folder / CONFIG)
    if not settings.get("fixed_goal"):  # older versions write a place all the same
        settings.pop("fixture", None)
    return gather_options(settings, task)


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


def _is_of(kind: Any, value: Any) -> bool:
    """Say whether a value that JSON gave is of a field's type."""
    parts = get_args(kind)
    if get_origin(kind) is Annotated:
        return _is_of(parts[0], value)
    if get_origin(kind) is Literal:
        return value in parts
    if get_origin(kind) is tuple:
        if not isinstance(value, tuple):
            return False
        has_length = parts[-1] is Ellipsis or len(value) == len(parts)
        return has_length and all(_is_of(parts[0], element) for element in value)
    if parts:
        return any(_is_of(part, value) for part in parts)
    if kind is float:
        kind = (int, float)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def require_run(config: TrainConfig) -> Path:
    """Refuse a run folder that cannot be started in, or resumed; write nothing.

    Returns:
        The folder, absolute.

    Raises:
        ConfigError: Not empty and not to be resumed; nothing there to resume; started
            with other settings (names the field); in use.
    """
    folder = config.runs.folder
    if config.runs.resume:
        config.require_same(_read_config(folder))
        with RunLock(folder):
            return folder
    if (folder / CONFIG).exists():
        raise ConfigError(
            f"the run folder {folder} already holds a run; continue it with --resume, "
            "or choose another --out"
        )
    require_empty(folder)
    return folder


def open_run(config: TrainConfig) -> Path:
    """Create the run folder, or return the one to resume; see `require_run`.

    Returns:
        The folder, absolute; it holds config.json.
    """
    folder = require_run(config)
    if not config.runs.resume:
        claim_output_folder(folder)
        write_atomic(folder / CONFIG, json.dumps(config.to_json(), indent=2) + "\n")
        if config.dynamics.model_file is not None:
            write_atomic(folder / MODEL, config.dynamics.model_file.content)
    return folder


def _read_config(folder: Path) -> dict[str, Any]:
    path = folder / CONFIG
    try:
        settings = read_json(path)
        if not isinstance(settings, dict):
            raise ValueError("it holds no table")
        return settings
    except FileNotFoundError as error:
        raise ConfigError(
            f"no run to resume in {folder}: it has no {CONFIG}; leave out --resume to "
            "start one"
        ) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"{path} is damaged: {reason}; start a new run") from error


class RunLock:
    """Holds a run folder for this process; the system frees it when that dies."""

    def __init__(self, folder: Path) -> None:
        """Name the folder."""
        self._folder = folder
        self._file: IO[str] | None = None

    def __enter__(self) -> "RunLock":
        """Take the folder.

        Raises:
            ConfigError: Another process trains in it, or its lock is no file.
        """
        self._file = open_lock(self._folder / _LOCK)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._file.close()
            raise ConfigError(
                f"another process is training in {self._folder}; wait for it, or "
                "choose another --out"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        """Free the folder."""
        if self._file is not None:
            self._file.close()
