"""The tasks in this package, by the folders beside this file, and the usual one."""

import importlib
import pkgutil
from collections.abc import Mapping
from pathlib import Path


def _find() -> dict[str, str]:
    folders = [
        folder
        for _, folder, is_package in pkgutil.iter_modules([str(Path(__file__).parent)])
        if is_package
    ]
    names = {folder: folder.title().replace("_", "") for folder in folders}
    return {
        f"dovetail/{name}-v0": f"dovetail.tasks.{folder}.task:{name}"
        for folder, name in names.items()
    }


def _find_usual() -> tuple[str, str, str]:
    """Return the environment and the policies of the folder that names them."""
    for env_id, task in TASKS.items():
        folder = vars(importlib.import_module(task.rpartition(".")[0]))
        if "USUAL_POLICY" in folder:
            return env_id, folder["USUAL_POLICY"], folder["TRUSTING_POLICY"]
    raise LookupError("no task's folder names the USUAL_POLICY")


def _find_implied() -> dict[str, str]:
    """Return the options of which a folder says that they choose its task."""
    folders = {
        env_id: vars(importlib.import_module(task.rpartition(".")[0]))
        for env_id, task in TASKS.items()
    }
    return {
        folder["IMPLIED_BY"]: env_id
        for env_id, folder in folders.items()
        if "IMPLIED_BY" in folder
    }


TASKS: Mapping[str, str] = _find()
"""Gymnasium id of each, and its class as ``module:Class``."""
DEFAULT_ENV, DEFAULT_POLICY, TRUSTING_POLICY = _find_usual()
"""Environment and shipped policy where none is asked for; and the shipped one that
takes the fixture's pose for true."""
IMPLIED_ENVS = _find_implied()
"""Environment that is meant where an option of its task is given, and no environment,
by the option."""
EPISODE_STEPS = 200
"""Actions of an episode of any task, where nothing else is asked for."""
