"""The folder of a training run: claimed for one process, and only for its settings."""

import fcntl
from dataclasses import replace
from pathlib import Path
from typing import IO

from dovetail.errors import ConfigError
from dovetail.files import (
    claim_output_folder,
    dated_folder,
    open_lock,
    require_empty,
    write_atomic,
)
from dovetail.learn.config import NOT_COMPARED, TrainConfig
from dovetail.learn.config_file import (
    CONFIG,
    MODEL,
    config_of,
    read_settings,
    to_toml,
)
from dovetail.settings import defaults_of
from dovetail.tasks.options import option_types
from dovetail.tasks.shipped import DEFAULT_ENV

PROGRESS = "progress.csv"
EVALUATION = "evaluation.json"
CHECKPOINTS = "checkpoints"
TENSORBOARD = "tensorboard"

_LOCK = ".lock"


def place_run(config: TrainConfig) -> TrainConfig:
    """Return the settings with a folder: a new one by the time where none is given."""
    if config.out is not None or config.resume:
        return config
    name = config.env.replace(":", "/").rpartition("/")[2]
    if config.env == DEFAULT_ENV:
        options, kinds = config.env_options(), option_types(config.task_class)
        own = vars(config.task_class)["__annotations__"]
        words = (k for k in kinds if kinds[k] is str and k in own)
        name = "_".join(f"{k}_{options[k]}" for k in words)
    return replace(config, out=dated_folder("runs", f"{name}-"))


def require_run(config: TrainConfig) -> Path:
    """Refuse a run folder that cannot be started in, or resumed; write nothing.

    Returns:
        The folder, absolute.

    Raises:
        ConfigError: Not empty and not to be resumed; nothing there to resume; started
            with other settings (names the field); in use.
    """
    folder = config.folder
    if config.resume:
        config.require_same(run_config(folder, config.arm))
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
        The folder, absolute; it holds config.toml.
    """
    folder = require_run(config)
    if not config.resume:
        claim_output_folder(folder)
        write_atomic(folder / CONFIG, to_toml(config))
        if config.model_file is not None:
            write_atomic(folder / MODEL, config.model_file.content)
    return folder


def run_config(folder: Path, arm: str | None = None) -> TrainConfig:
    """Return the settings of a run.

    Args:
        folder: The run's.
        arm: The arm as the user gives it again.

    Raises:
        ConfigError: There is no run, its config.toml is damaged or of another version,
            or it names an arm, a robot perhaps, that the user has not given.
    """
    if not (folder / CONFIG).exists():
        raise ConfigError(
            f"no run to resume in {folder}: it has no {CONFIG}; leave out --resume to "
            "start one"
        )
    file = folder / CONFIG
    try:
        given = read_settings(file, arm, is_run=True)
        usual = defaults_of(TrainConfig)
        written = {name for name, value in usual.items() if value is not None}
        if missing := sorted(written - given.keys() - set(NOT_COMPARED)):
            raise ConfigError(f"{file} lacks {', '.join(missing)}", name=missing[0])
        return config_of(file, given | {"out": folder, "resume": True})
    except ConfigError as error:
        if error.name:
            again = "if another version of dovetail began this run, start a new one"
            error.args = (f"{error}; {again}",)
        raise


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
