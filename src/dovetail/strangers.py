"""Modules that are not dovetail's: the first half of every MODULE:NAME.

Importing one runs it. Who types MODULE:NAME, or calls a function with it, wants that; a
file that somebody sent may not choose it.
"""

import importlib
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError

TRUSTED = "DOVETAIL_TRUST"
"""Environment variable: modules that files may name, with commas between them. It
reaches the processes that a command starts."""
_NAMED = re.compile(r"--(?:env|robot|tracker)[= ]([A-Za-z_][\w.]*):")


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


def require_trusted(source: object, name: str, value: object) -> str:
    """Return a name that a file chooses, of dovetail's or of a module that is trusted.

    Args:
        source: The file, for the message.
        name: Which of its keys.
        value: What it holds.

    Raises:
        ConfigError: It is no text, or code that nobody has said is to be run.
    """
    if not isinstance(value, str):
        raise ConfigError(f"{source} is damaged: {name} is {value!r}, which is no name")
    module, colon, _ = value.partition(":")
    if colon and module not in os.environ.get(TRUSTED, "").split(","):
        raise ConfigError(
            f"{source}: {name} is {value!r}, which imports and runs the module "
            f"{module!r}; if you trust it, set {TRUSTED}={module}"
        )
    return value
