"""Robots by name: each file of this folder that has a function of its own name.

A robot that is not in the package is named by ``module:function``.
"""

import importlib
import pkgutil
from pathlib import Path

from dovetail.errors import ConfigError, did_you_mean
from dovetail.plugins import import_names
from dovetail.robots.robot import Robot

DEFAULT_ROBOT = "iiwa14"
_PACKAGE = "dovetail.robots"


def list_robots() -> tuple[str, ...]:
    """Return the names of the robots in this folder."""
    names = [
        module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)])
    ]
    found = (importlib.import_module(f"{_PACKAGE}.{name}") for name in names)
    return tuple(n for n, module in zip(names, found, strict=True) if n in vars(module))


def find_robot(name: str = DEFAULT_ROBOT) -> Robot:
    """Return a robot without a tool.

    Args:
        name: The name of a file of this folder, or ``module:function`` of a function
            without arguments that returns a `Robot`.

    Raises:
        ConfigError: No such robot; lists the known ones.
    """
    module, _, function = name.partition(":")
    if not function:
        if name not in list_robots():
            raise ConfigError(
                f"robot {name!r} is unknown{did_you_mean(name, list_robots())}; known: "
                f"{', '.join(list_robots())}; or give MODULE:FUNCTION of your own, see "
                "docs/your-own-robot.md"
            )
        module, function = f"{_PACKAGE}.{name}", name
    try:
        make = import_names(module)[function]
    except (ImportError, KeyError) as error:
        raise ConfigError(
            f"robot {name!r}: no function {function!r} in a module {module!r} that "
            f"Python finds ({error}); start where {module}.py lies, or set PYTHONPATH"
        ) from error
    robot = make()
    if not isinstance(robot, Robot):
        raise ConfigError(
            f"robot {name!r} gave a {type(robot).__name__}; its function must return "
            "a dovetail.robots.robot.Robot"
        )
    return robot
