"""Train contact-rich manipulation in simulation, transfer it to a robot, inside limits.

Importing the package registers the Gymnasium environments by name only; nothing heavy
is loaded before one of them is made.
"""

import pkgutil
from importlib.metadata import version
from pathlib import Path

import gymnasium

__version__ = version("dovetail")
"""Version of the installed package; its one home is pyproject.toml."""

for _, _folder, _is_package in pkgutil.iter_modules(
    [str(Path(__file__).parent / "tasks")]
):
    if _is_package:
        _name = _folder.title().replace("_", "")
        gymnasium.register(
            id=f"dovetail/{_name}-v0",
            entry_point="dovetail.envs.registered:make_env",
            vector_entry_point="dovetail.envs.registered:make_batch",
            kwargs={"task_class": f"dovetail.tasks.{_folder}.task:{_name}"},
        )
