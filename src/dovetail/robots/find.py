"""Robots by name, by file, and by function.

A name is that of a file of this folder that has a function of its own name. Other
robots are a URDF or MJCF file, ``menagerie:NAME`` or ``module:function``; settings and
policies carry a file's robot itself, see `robot_text`.
"""

import importlib
import pkgutil
from functools import lru_cache
from pathlib import Path

from dovetail.errors import ConfigError, did_you_mean
from dovetail.plugins import (
    MENAGERIE,
    ROBOT_FILES,
    import_names,
    is_read,
    is_robot_text,
)
from dovetail.robots.menagerie import menagerie_file
from dovetail.robots.robot import Robot
from dovetail.robots.robot_text import read_robot_text, write_robot_text

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
        name: The name of a file of this folder; the path of a .urdf or .xml file;
            ``menagerie:NAME``; ``module:function`` of a function without arguments that
            returns a `Robot`; or the text that `whole_robot` gives.

    Raises:
        ConfigError: No such robot; lists the known ones. Or a file that is no arm.
        MissingDependencyError: `mujoco-menagerie` is needed.
    """
    if is_robot_text(name):
        return read_robot_text(name)
    if is_read(name):
        return _read(name)
    module, _, function = name.partition(":")
    if not function:
        if name not in list_robots():
            raise _unknown(name)
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


def whole_robot(name: str) -> str:
    """Return the text of a robot that a file describes; any other name as it is.

    A training that holds the text never reads the file again, so a later change of
    the file does not affect it.

    Raises:
        ConfigError: See `find_robot`.
    """
    if is_read(name):
        return write_robot_text(find_robot(name))
    if is_robot_text(name):
        read_robot_text(name)
    return name


def robot_label(name: str) -> str:
    """Return a short name of a robot for messages; its full text is too long."""
    return read_robot_text(name).name if is_robot_text(name) else name


def _unknown(name: str) -> ConfigError:
    if name.endswith(".xacro"):
        return ConfigError(
            f"robot {name!r} is a xacro file; expand it first: xacro {name} > arm.urdf"
        )
    return ConfigError(
        f"robot {name!r} is unknown{did_you_mean(name, list_robots())}; known: "
        f"{', '.join(list_robots())}; or give the path of a {' or '.join(ROBOT_FILES)} "
        f"file, {MENAGERIE}NAME, or MODULE:FUNCTION of your own, see "
        "docs/your-own-robot.md"
    )


def _read(name: str) -> Robot:
    """Read a robot's file, or take the one that was read from it."""
    if name.startswith(MENAGERIE):
        path = menagerie_file(name.removeprefix(MENAGERIE))
    else:
        path = Path(name)
    try:
        path = path.expanduser()
        found = path.stat()
    except OSError as error:
        raise ConfigError(
            f"cannot read robot file {path}: {error.strerror or error}"
        ) from error
    except (ValueError, RuntimeError) as error:  # a NUL in it; no such user
        raise ConfigError(f"cannot read robot file {name!r}: {error}") from error
    return _from_file(path.absolute(), found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=16)
def _from_file(path: Path, *_version: int) -> Robot:
    kind = Robot.from_urdf if path.suffix.lower() == ".urdf" else Robot.from_mjcf
    return kind(path, complete=True)
