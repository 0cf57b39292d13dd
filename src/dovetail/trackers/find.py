"""Trackers by name, ``delayed?delay=0.1``: arguments come after the question mark.

A tracker that is not in the package is ``module:Class``. A camera is its file,
``camera.toml``; ``camera.toml?images=0`` is its delay, rate and noise without pictures.
``twin`` is the camera that the twin's file describes.
"""

import inspect
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Self
from urllib.parse import parse_qsl

from dovetail.errors import ConfigError, did_you_mean
from dovetail.plants.twin import Twin, load_twin
from dovetail.plants.twin_camera import TwinCamera
from dovetail.plugins import import_names
from dovetail.trackers.covered import Covered
from dovetail.trackers.late import Late
from dovetail.trackers.tracker import Tracker
from dovetail.trackers.truth import Truth

if TYPE_CHECKING:
    from dovetail.arms.arm import Arm
    from dovetail.workcell.workcell import Workcell

DEFAULT_TRACKER = "truth"
TWIN = "twin"
"""Name of the tracker that a twin's file describes."""
CAMERA = ".toml"
"""Ending of a camera's name."""
TRACKERS = {
    "covered": Covered,
    "delayed": partial(Late, delay=0.1, rate=math.inf),
    "late": Late,
    "noisy": partial(Late, delay=0.0, rate=math.inf, offset=0.0005),
    "truth": Truth,
}
"""Trackers of the package by name; all of their arguments are numbers."""
_NUMBER = (int, float, type)  # where there is no default it is the type `empty`
_FEW = 2.0
"""Standard deviations of a calibrated place that a camera without pictures is off."""


@dataclass(frozen=True, kw_only=True)
class TrackerContext:
    """Workcell, camera and kind of arm that a tracker is built for."""

    cell: "Workcell"
    """Workcell of the arm."""
    twin: TwinCamera | None = None
    """Camera that the twin's file describes; None if there is none."""
    is_simulated: bool = True
    """True if the arm is a simulation, or behind a simulated cabinet."""

    @classmethod
    def for_arm(
        cls, cell: "Workcell", twin: Twin | str | Path | None, arm: "Arm"
    ) -> Self:
        """Return an arm's workcell, with the camera that a twin's file describes."""
        camera = None if twin is None else load_twin(twin).camera
        return cls(cell=cell, twin=camera, is_simulated=arm.facts.traits.is_simulated)


def find_tracker(
    text: str = DEFAULT_TRACKER, context: TrackerContext | None = None
) -> Tracker:
    """Build a tracker.

    Args:
        text: Its name, or MODULE:CLASS, then ?NAME=NUMBER&NAME=NUMBER for arguments;
            or a camera's file, or "twin".
        context: Where it is to look; only a camera and a twin need one.

    Raises:
        ConfigError: No such tracker (lists the known ones), or an argument that it
            does not take; or nothing that could be looked at.
        MissingDependencyError: A camera needs what is not installed.
    """
    name, _, query = text.partition("?")
    if name != TWIN and not name.endswith(CAMERA):
        return _by_name(text)
    if context is None:
        raise ConfigError(
            f"tracker {text!r} needs a workcell to look at; give a TrackerContext"
        )
    return _of_twin(context) if name == TWIN else _camera(name, query, context)


def require_tracker(text: str) -> None:
    """Refuse a tracker that there is not, as far as can be said without a context.

    Raises:
        ConfigError: See `find_tracker`.
    """
    name, _, query = text.partition("?")
    if name.endswith(CAMERA):
        from dovetail.perceive.camera import load_camera

        load_camera(name)
        _wants_images(text, query)
    elif name != TWIN:
        _by_name(text)


def without_images(text: str) -> str:
    """Return the tracker that has a camera's delay, rate and noise but no pictures."""
    return f"{text}?images=0" if text.endswith(CAMERA) else text


def _wants_images(text: str, query: str) -> bool:
    if query not in ("", "images=0", "images=1"):
        raise ConfigError(
            f"tracker {text!r}: a camera takes images=0 or images=1, not {query!r}"
        )
    return query != "images=0"


def _camera(name: str, query: str, context: TrackerContext) -> Tracker:
    """Build a camera from its file, or what is like it without pictures."""
    from dovetail.perceive.camera import load_camera

    camera = load_camera(name)
    is_exact = context.twin is None or not any(context.twin.numbers())
    camera.require_calibrated(is_exact=is_exact)
    if not _wants_images(f"{name}?{query}", query):
        shift, turn = camera.deviation[:3], camera.deviation[3:]
        return Late(
            delay=camera.delay,
            rate=camera.rate,
            bias=_FEW * max(shift),
            turn=_FEW * max(turn),
        )
    from dovetail.perceive.open_source import open_source
    from dovetail.trackers.marker import MarkerTracker

    if camera.is_simulated and not context.is_simulated:
        raise ConfigError(
            f"the pictures of camera {name} are simulated, and this arm is not: give "
            "the file another source, device:NUMBER or folder:PATH"
        )
    part, own = camera.board.part, context.cell.fixture.name
    if part not in ("", own):
        raise ConfigError(
            f"the board of camera {name} is on a {part}, and this task's fixture is a "
            f"{own}: take the camera file of that, or correct part in its [board]"
        )
    source = open_source(camera, context.cell, context.twin)
    return MarkerTracker(camera, source, context.cell.robot)


def _of_twin(context: TrackerContext) -> Tracker:
    if context.twin is None:
        raise ConfigError(
            "the tracker twin is the camera of a twin's file: give a --twin whose file "
            "has a table [camera], as `dovetail twin show medium` has, or --tracker "
            "truth"
        )
    camera = context.twin
    return Late(
        delay=camera.delay,
        rate=camera.rate,
        bias=camera.bias,
        turn=camera.turn,
        jitter=camera.jitter,
        dropout=camera.dropout,
    )


def _by_name(text: str) -> Tracker:
    """Build a tracker of `TRACKERS`, or of a module."""
    name, _, query = text.partition("?")
    module, _, kind = name.partition(":")
    if name in TRACKERS:
        make = TRACKERS[name]
    elif not kind:
        raise ConfigError(
            f"tracker {name!r} is unknown{did_you_mean(name, TRACKERS)}; known: "
            f"{', '.join(TRACKERS)}, twin, a camera's file (.toml), or MODULE:CLASS of "
            "your own"
        )
    else:
        try:
            make = import_names(module)[kind]
        except (ImportError, KeyError, ValueError) as error:
            raise ConfigError(
                f"tracker {text!r}: no class {kind!r} in a module {module!r} that "
                f"Python finds ({error})"
            ) from error
    given = parse_qsl(query, keep_blank_values=True)
    usual = _usual(make)
    # A tracker inside another has a default that is no number.
    other = {key for key, default in usual.items() if not isinstance(default, _NUMBER)}
    try:
        if no_number := ", ".join(key for key, _ in given if key in other):
            raise ValueError(f"{no_number} is no number")
        return make(**{key: float(value) for key, value in given})
    except (TypeError, ValueError) as error:
        known = ", ".join(key for key in usual if key not in other)
        raise ConfigError(
            f"tracker {text!r} does not take these arguments: {error}; it takes "
            f"{known or 'none'}, as NAME?ARGUMENT=NUMBER&ARGUMENT=NUMBER"
        ) from error


def _usual(make: object) -> dict[str, object]:
    """Return the arguments of a class with their defaults, where it tells them."""
    try:
        parameters = inspect.signature(make).parameters if callable(make) else {}
    except ValueError:  # of one that is written in C
        return {}
    return {name: parameter.default for name, parameter in parameters.items()}
