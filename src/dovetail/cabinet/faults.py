"""Faults of the link and of the robot, on request: how they are written.

A fault is a text such as ``loss=0.02,delay=3ms,jitter=1ms``; ``none`` ends all faults.
A script is a file with one line per change, ``TIME FAULTS``, time since the cabinet
was started: ``2s loss=0.1`` and then ``5s none``. Lines may have a # comment.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from dovetail.cabinet.protocol import Quality, SafetyState
from dovetail.durations import parse_duration
from dovetail.errors import ConfigError
from dovetail.reading import read_text
from dovetail.settings import Range, defaults_of, ranges_of, settings, values_of

DIRECTIONS = ("both", "to_client", "from_client")
Share = Annotated[float, Range(0.0, 1.0, "1")]
"""A share of the datagrams."""


@settings(owner="fault")
class LinkFaults:
    """Faults of the link."""

    loss: Share = 0.0
    """Share of datagrams that are lost [1]."""
    duplicate: Share = 0.0
    """Share that arrive twice [1]."""
    reorder: Share = 0.0
    """Share that arrive after the next one [1]."""
    corrupt: Share = 0.0
    """Share in which bytes are changed [1]; 1.x has no checksum of its own, so that
    a changed command may be obeyed."""
    truncate: Share = 0.0
    """Share that are cut short [1]."""
    delay: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    """Time that every datagram takes [s], each way."""
    jitter: Annotated[float, Range(0.0, 1.0, "s")] = 0.0
    """Largest further time, uniformly distributed [s]."""
    direction: Literal["both", "to_client", "from_client"] = "both"
    """Direction in which the faults above act."""

    @property
    def is_clear(self) -> bool:
        """True if every datagram passes at once and unchanged."""
        names = (*_PROBABILITIES, "delay", "jitter")
        return not any(vars(self)[name] for name in names)


@settings(owner="fault")
class RobotFaults:
    """Faults of the robot, its cabinet and its safety controller."""

    freeze: Annotated[float, Range(0.0, 60.0, "s")] = 0.0
    """Time for which the cabinet stands still, once [s]."""
    quality: Quality | None = None
    """Quality that the cabinet reports, in place of the true one."""
    stop_at: Annotated[float | None, Range(0.0, 1e6, "s")] = None
    """Time after which the safety controller stops the arm, once [s]."""
    stop: Annotated[int, Range(1, 3, "1")] = SafetyState.STOP_1
    """Kind of that stop, 1 to 3 as on the wire: STOP 0 to STOP 2."""
    stop_time: Annotated[float, Range(0.0, 3600.0, "s")] = 0.5
    """Time for which the safety controller then keeps the arm stopped [s]."""
    values: Annotated[int, Range(0, 14, "values")] = 7
    """Joint values in each array of the messages; a real cabinet sends 7."""


@settings(owner="fault")
class FaultConfig(LinkFaults, RobotFaults):
    """Faults that act together; the defaults are none."""

    seed: Annotated[int, Range(0, 2**32 - 1, "1")] = 0
    """Start of the random numbers."""

    def describe(self) -> str:
        """Return the faults as `parse_faults` reads them."""
        parts = []
        for name, value in values_of(self).items():
            if value == _DEFAULTS[name]:
                continue
            if isinstance(value, Quality):
                value = value.name.lower()
            unit = "s" if name in _TIMES else ""
            parts.append(f"{name}={value}{unit}")
        return ",".join(parts) or "none"


_DEFAULTS = defaults_of(FaultConfig)
_RANGES = ranges_of(FaultConfig)
_PROBABILITIES = ("loss", "duplicate", "reorder", "corrupt", "truncate")
_TIMES = tuple(name for name, allowed in _RANGES.items() if allowed.unit == "s")
_WHOLE = ("stop", "values", "seed")


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise ConfigError(f"fault {name} is {text!r}, which is no number") from error


def _time(name: str, text: str) -> float:
    return parse_duration(text, f"fault {name}")


def _whole(name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise ConfigError(f"fault {name} is {text!r}; give a whole number") from error


def _quality(name: str, text: str) -> Quality:
    known = {quality.name.lower(): quality for quality in Quality}
    if text.lower() not in known:
        raise ConfigError(f"fault {name} is {text!r}; known: {', '.join(known)}")
    return known[text.lower()]


def _direction(name: str, text: str) -> str:
    if text not in DIRECTIONS:
        raise ConfigError(f"fault {name} is {text!r}; known: {', '.join(DIRECTIONS)}")
    return text


_READERS: dict[str, Callable[[str, str], Any]] = {
    **dict.fromkeys(_PROBABILITIES, _number),
    **dict.fromkeys(_TIMES, _time),
    **dict.fromkeys(_WHOLE, _whole),
    "quality": _quality,
    "direction": _direction,
}


def parse_faults(text: str) -> FaultConfig:
    """Read faults as they are written: NAME=VALUE, separated by commas; none for none.

    Raises:
        ConfigError: Unknown name, a name twice, or a value out of range; the message
            lists the known names.
    """
    known = ", ".join(_DEFAULTS)
    values: dict[str, Any] = {}
    for part in text.split(","):
        if part.strip() in ("", "none"):
            continue
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if name not in _READERS:
            raise ConfigError(f"fault {name!r} is unknown; known faults: {known}")
        if not equals or not value:
            raise ConfigError(f"fault {name} has no value; give {name}=VALUE")
        if name in values:
            raise ConfigError(f"fault {name} is given twice in {text!r}")
        values[name] = _READERS[name](name, value)
    return FaultConfig(**values)


_SCRIPT_BYTES = 1_000_000
"""Largest fault script [bytes]."""


def read_script(path: Path) -> list[tuple[float, FaultConfig]]:
    """Read a fault script: its changes in the order of time.

    Raises:
        ConfigError: The file cannot be read, or a line is wrong; with its number.
    """
    try:
        lines = read_text(path, _SCRIPT_BYTES).splitlines()
    except OSError as error:
        raise ConfigError(
            f"fault script {path} cannot be read: {error.strerror}"
        ) from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"fault script {path} cannot be read: {error}") from error
    changes = []
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].split(maxsplit=1)
        if not words:
            continue
        try:
            time = parse_duration(words[0], "time")
            if time < 0.0:
                raise ConfigError(f"time is {words[0]}; give 0s or later")
            if len(words) < 2:
                raise ConfigError("no faults; give TIME FAULTS, as in 2s loss=0.1")
            changes.append((time, parse_faults(words[1])))
        except ConfigError as error:
            raise ConfigError(f"fault script {path}, line {number}: {error}") from error
    return sorted(changes, key=lambda change: change[0])
