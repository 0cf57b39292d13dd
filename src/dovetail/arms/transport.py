"""Transports by name: each file of this folder that ends in `_transport`.

It has `build_arm(address, cell, settings)`. All but that of this process have
`parse(text)`, too, for an address that begins with NAME://; the address's class says
NAME as its `transport`. A new one needs no line elsewhere.
"""

import importlib
import pkgutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from dovetail.errors import ConfigError

LOCAL = "local"
"""Of the arms of this process, whose addresses have no scheme."""
_ENDING = "_transport"


@cache
def list_schemes() -> tuple[str, ...]:
    """Return the schemes of addresses on a network."""
    files = pkgutil.iter_modules([str(Path(__file__).parent)])
    named = {f.name.removesuffix(_ENDING) for f in files if f.name.endswith(_ENDING)}
    return tuple(sorted(named - {LOCAL}))


def part_of_transport(name: str, part: str) -> Callable[..., Any]:
    """Return a transport's `parse` or `build_arm`.

    Raises:
        ConfigError: Its file has no such function.
    """
    module = importlib.import_module(f"dovetail.arms.{name}{_ENDING}")
    if part not in vars(module):
        raise ConfigError(
            f"transport {name!r} has no {part}: each has one, as arms/fri_transport.py"
        )
    return vars(module)[part]
