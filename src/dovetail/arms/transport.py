"""Transports by name: each file of this folder that ends in `_transport`.

It has `build_arm(address, cell, settings)`, and `parse(text)` where an address that
begins with NAME:// is its own. A new transport needs no line elsewhere.
"""

import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

LOCAL = "local"
"""Of the arms of this process, whose addresses have no scheme."""
_ENDING = "_transport"


def list_schemes() -> tuple[str, ...]:
    """Return the schemes of addresses on a network."""
    files = pkgutil.iter_modules([str(Path(__file__).parent)])
    named = [f.name for f in files if f.name.endswith(_ENDING)]
    return tuple(sorted(n.removesuffix(_ENDING) for n in named if LOCAL not in n))


def part_of_transport(name: str, part: str) -> Callable[..., Any]:
    """Return a transport's `parse` or `build_arm`."""
    module = importlib.import_module(f"dovetail.arms.{name}{_ENDING}")
    return vars(module)[part]
