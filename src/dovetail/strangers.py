"""Modules that are not dovetail's: the first half of every MODULE:NAME."""

import importlib
import sys
from pathlib import Path
from typing import Any


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
