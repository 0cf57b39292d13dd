"""Names of things that are not dovetail's: modules of a MODULE:NAME, and robot files.

Importing a module runs it. A user who types MODULE:NAME, or calls a function with it,
wants that; a file from elsewhere must not choose it, nor another file to be read.
"""

import importlib
import os
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError

TRUSTED = "DOVETAIL_TRUST"
"""Environment variable: modules that files may name, with commas between them. It
reaches the processes that a command starts."""
OPTIONS = ("env", "robot", "tracker")
"""Options that may name a module."""
ROBOT_FILES = (".urdf", ".xml")
"""Endings of a robot's file."""
MENAGERIE = "menagerie:"
"""Beginning of the name of a robot of MuJoCo Menagerie."""
_OF_ROBOTS = ("robot", "arm_model")
"""Keys and options whose value may be a robot's file, or a robot itself."""
_NAMED = re.compile(rf"--(?:{'|'.join(OPTIONS)})[= ]([A-Za-z_][\w.]*):")


def is_read(value: str) -> bool:
    """Say whether a robot's name is that of a file, here or in MuJoCo Menagerie."""
    return not is_robot_text(value) and (
        value.startswith(MENAGERIE) or value.lower().endswith(ROBOT_FILES)
    )


def is_robot_text(value: str) -> bool:
    """Say whether a text is a robot itself, and not a name of one."""
    return value.startswith("{")


def module_of(name: str, value: str) -> str:
    """Return the module that a value imports; empty for none.

    Args:
        name: Its option or key: a robot alone may be a file.
        value: What is given.
    """
    if name in _OF_ROBOTS and (is_robot_text(value) or is_read(value)):
        return ""
    module, colon, _ = value.partition(":")
    return module if colon else ""


def import_names(module: str) -> dict[str, Any]:
    """Import a module, also from the folder where the command was given.

    Returns:
        What it has, by name.

    Raises:
        ImportError: Python finds no such module.
    """
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)
    return vars(importlib.import_module(module))


def trust(*modules: str) -> None:
    """Let files name these modules from now on."""
    known = filter(None, os.environ.get(TRUSTED, "").split(","))
    os.environ[TRUSTED] = ",".join(dict.fromkeys([*known, *modules]))


def trust_typed(words: Sequence[str]) -> None:
    """Let files name the modules that a command line names: `--robot MODULE:NAME`."""
    for module in _NAMED.findall(" ".join(words)):
        if f"{module}:" != MENAGERIE:
            trust(module)


def named_modules(settings: Mapping[str, Any]) -> list[str]:
    """Return the options that name a module in these settings, as they are typed."""
    named = {
        name: settings[name] for name in OPTIONS if module_of(name, settings[name])
    }
    return [word for name, value in named.items() for word in (f"--{name}", value)]


def require_trusted(
    source: object, name: str, value: object, *, is_option: bool = False
) -> str:
    """Return a name that a file chooses, of dovetail's or of a module that is trusted.

    Args:
        source: The file, for the message.
        name: Which of its keys.
        value: What it holds.
        is_option: The command that reads the file has an option of this name.

    Raises:
        ConfigError: It is no text, or it names a module that is not trusted, or a
            robot's file.
    """
    if not isinstance(value, str):
        raise ConfigError(f"{source} is damaged: {name} is {value!r}, which is no name")
    require_unread(source, name, value)
    module = module_of(name, value)
    if module and module not in os.environ.get(TRUSTED, "").split(","):
        given = f"give --{name} {shlex.quote(value)}, or " if is_option else ""
        raise ConfigError(
            f"{source}: {name} is {value!r}, which imports and runs the module "
            f"{module!r}; if you trust it, {given}set {TRUSTED}={module}"
        )
    return value


def require_unread(source: object, name: str, value: object) -> None:
    """Refuse a robot's file that a file names: it has to hold the robot itself.

    Args:
        source: The file, for the message.
        name: Which of its keys.
        value: What it holds.

    Raises:
        ConfigError: It names a file.
    """
    if name in _OF_ROBOTS and isinstance(value, str) and is_read(value):
        raise ConfigError(
            f"{source}: {name} is {value[:80]!r}, another file; needed: the robot "
            "itself, as a training writes it. If you have that file, give --robot "
            f"{shlex.quote(value[:80])}"
        )
