"""Faults of the link and of the robot, on request: how they are written.

A fault is a text such as ``loss=0.02,delay=3ms,jitter=1ms``; ``none`` ends all faults.
A script is a file with one line per change, ``TIME FAULTS``, time since the cabinet
was started: ``2s loss=0.1`` and then ``5s none``. Lines may have a # comment.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from dovetail.cabinet.protocol import Quality, SafetyState
from dovetail.durations import parse_duration
from dovetail.errors import ConfigError

DIRECTIONS = ("both", "to_client", "from_client")


@dataclass(frozen=True, kw_only=True)
class FaultConfig:
    """Faults that act together; the defaults are none."""

    loss: float = 0.0
    """Share of datagrams that are lost [1]."""
    duplicate: float = 0.0
    """Share that arrive twice [1]."""
    reorder: float = 0.0
    """Share that arrive after the next one [1]."""
    corrupt: float = 0.0
    """Share in which bytes are changed [1]; 1.x has no checksum of its own, so that
    a changed command may be obeyed."""
    truncate: float = 0.0
    """Share that are cut short [1]."""
    delay: float = 0.0
    """Time that every datagram takes [s], each way."""
    jitter: float = 0.0
    """Largest further time, uniformly distributed [s]."""
    direction: Literal["both", "to_client", "from_client"] = "both"
    """Which way the faults above act."""
    freeze: float = 0.0
    """Time for which the cabinet stands still, once [s]."""
    quality: Quality | None = None
    """Quality that the cabinet claims, whatever it sees."""
    stop_at: float | None = None
    """Time after which the safety controller stops the arm, once [s]."""
    stop: int = SafetyState.STOP_1
    """Which stop that is, 1 to 3 as on the wire."""
    stop_time: float = 0.5
    """How long the safety controller then keeps the arm stopped [s]."""
    values: int = 7
    """Joint values in each array of the messages; a real cabinet sends 7."""
    seed: int = 0
    """Start of the random numbers."""

    @property
    def touches_link(self) -> bool:
        """Whether datagrams are handled any differently."""
        return any(vars(self)[name] for name in (*_PROBABILITIES, "delay", "jitter"))

    def describe(self) -> str:
        """Return the faults as `parse_faults` reads them."""
        parts = []
        for f in fields(self):
            value = vars(self)[f.name]
            if value == f.default:
                continue
            if isinstance(value, Quality):
                value = value.name.lower()
            unit = "s" if f.name in _TIMES else ""
            parts.append(f"{f.name}={value}{unit}")
        return ",".join(parts) or "none"


_PROBABILITIES = ("loss", "duplicate", "reorder", "corrupt", "truncate")
_TIMES = {
    "delay": 1.0,
    "jitter": 1.0,
    "freeze": 60.0,
    "stop_at": 1e6,
    "stop_time": 3600.0,
}
_WHOLE = {"stop": (1, 3), "values": (0, 14), "seed": (0, 2**32 - 1)}


def _probability(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise ConfigError(f"fault {name} is {text!r}; give a share from 0 to 1")
    return value


def _time(name: str, text: str) -> float:
    value = parse_duration(text, f"fault {name}")
    if not 0.0 <= value <= _TIMES[name]:
        raise ConfigError(f"fault {name} is {text}; allowed is 0 to {_TIMES[name]:g} s")
    return value


def _whole(name: str, text: str) -> int:
    low, high = _WHOLE[name]
    if not text.isdecimal() or not low <= int(text) <= high:
        raise ConfigError(
            f"fault {name} is {text!r}; give a whole number from {low} to {high}"
        )
    return int(text)


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
    **dict.fromkeys(_PROBABILITIES, _probability),
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
    known = ", ".join(f.name for f in fields(FaultConfig))
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


def read_script(path: Path) -> list[tuple[float, FaultConfig]]:
    """Read a fault script: its changes in the order of time.

    Raises:
        ConfigError: The file cannot be read, or a line is wrong; with its number.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
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
