"""Robots of MuJoCo Menagerie by name; its package downloads a model and keeps it."""

from pathlib import Path
from typing import Any

from dovetail.errors import (
    ConfigError,
    MissingDependencyError,
    did_you_mean,
    install_command,
)
from dovetail.plugins import MENAGERIE


def menagerie_file(name: str) -> Path:
    """Return the MJCF file of a robot, or of one of its models: NAME or NAME/MODEL.

    Raises:
        ConfigError: No such robot or model (lists them), or the download failed.
        MissingDependencyError: The package is not installed.
    """
    try:
        import mujoco_menagerie as menagerie
    except ImportError as error:
        raise MissingDependencyError(
            f"{MENAGERIE}{name} needs mujoco-menagerie: {install_command('menagerie')}"
        ) from error
    robot, _, model = name.partition("/")
    known = menagerie.names()
    if robot not in known:
        raise ConfigError(
            f"MuJoCo Menagerie has no robot {robot!r}{did_you_mean(robot, known)}; "
            "mujoco-menagerie names lists them"
        )
    return _fetched(menagerie, robot, model)


def _fetched(menagerie: Any, robot: str, model: str) -> Path:
    """Return the file of a model, downloaded if it is not kept yet."""
    found = menagerie.get(robot)
    try:
        return Path(found.xml(model or found.default_model))
    except menagerie.UnknownEntryPointError as error:
        raise ConfigError(
            f"{robot} of MuJoCo Menagerie has no model {model!r}; known: "
            f"{', '.join(found.entry_names)}"
        ) from error
    except (menagerie.MenagerieError, OSError) as error:
        raise ConfigError(
            f"{robot} of MuJoCo Menagerie could not be downloaded: {error}; connect "
            f"once and run mujoco-menagerie prefetch {robot}, set MENAGERIE_CACHE_DIR "
            "to a copy of another machine's cache, or MENAGERIE_ROOT to a checkout"
        ) from error
