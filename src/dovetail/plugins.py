"""Modules that are not dovetail's: the first half of every MODULE:NAME.

Importing one runs it. A user who types MODULE:NAME, or calls a function with it, wants
that; a file from elsewhere must not choose it.
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
_NAMED = re.compile(rf"--(?:{'|'.join(OPTIONS)})[= ]([A-Za-z_][\w.]*):")


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
        trust(module)


def named_modules(settings: Mapping[str, Any]) -> list[str]:
    """Return the options that name a module in these settings, as they are typed."""
    named = {name: settings[name] for name in OPTIONS if ":" in settings[name]}
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
        ConfigError: It is no text, or it names a module that is not trusted.
    """
    if not isinstance(value, str):
        raise ConfigError(f"{source} is damaged: {name} is {value!r}, which is no name")
    module, colon, _ = value.partition(":")
    if colon and module not in os.environ.get(TRUSTED, "").split(","):
        given = f"give --{name} {shlex.quote(value)}, or " if is_option else ""
        raise ConfigError(
            f"{source}: {name} is {value!r}, which imports and runs the module "
            f"{module!r}; if you trust it, {given}set {TRUSTED}={module}"
        )
    return value
