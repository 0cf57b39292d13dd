"""Trackers by name: each file of this folder whose class has its name.

``delayed?delay=0.1``: the class `Delayed` of `delayed.py`, its arguments after the
question mark. A tracker that is not in the package is ``module:Class``.
"""

import importlib
import pkgutil
from pathlib import Path
from urllib.parse import parse_qsl

from dovetail.errors import ConfigError
from dovetail.strangers import import_names
from dovetail.trackers.tracker import Tracker

DEFAULT_TRACKER = "truth"
_PACKAGE = "dovetail.trackers"


def list_trackers() -> tuple[str, ...]:
    """Return the names of the trackers in this folder."""
    names = [m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)])]
    modules = {name: importlib.import_module(f"{_PACKAGE}.{name}") for name in names}
    return tuple(
        name
        for name, module in modules.items()
        if vars(module).get(name.title(), Tracker) is not Tracker
    )


def find_tracker(text: str = DEFAULT_TRACKER) -> Tracker:
    """Build a tracker.

    Args:
        text: Its name, or MODULE:CLASS, then ?NAME=NUMBER&NAME=NUMBER for arguments.

    Raises:
        ConfigError: No such tracker (lists the known ones), or an argument that it
            does not take.
    """
    name, _, query = text.partition("?")
    module, _, kind = name.partition(":")
    if not kind:
        if name not in list_trackers():
            raise ConfigError(
                f"tracker {name!r} is unknown; known: {', '.join(list_trackers())}, or "
                "MODULE:CLASS of your own"
            )
        module, kind = f"{_PACKAGE}.{name}", name.title()
    try:
        make = import_names(module)[kind]
        return make(**{key: float(value) for key, value in parse_qsl(query)})
    except (ImportError, KeyError) as error:
        raise ConfigError(
            f"tracker {text!r}: no class {kind!r} in a module {module!r} that Python "
            f"finds ({error})"
        ) from error
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"tracker {text!r} does not take these arguments: {error}; give "
            "NAME?ARGUMENT=NUMBER&ARGUMENT=NUMBER"
        ) from error
