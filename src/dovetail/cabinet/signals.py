"""IO signals and transformations that the cabinet has registered with FRI."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from dovetail.cabinet.protocol import (
    MAX_IO,
    MAX_NAME,
    MAX_TRANSFORMATIONS,
    IoDirection,
    IoType,
)
from dovetail.errors import ConfigError


@dataclass(frozen=True)
class Signal:
    """An IO signal as the Java application registered it."""

    name: str
    """Name, "Group.Signal"."""
    type: IoType
    """Boolean, digital (whole number) or analog."""
    direction: IoDirection
    """Direction: the cabinet writes an input, the client an output."""
    initial: float = 0.0
    """Value until it is written."""


def parse_signal(text: str) -> Signal:
    """Read NAME:TYPE:DIRECTION, with =VALUE behind where it does not start at 0.

    Raises:
        ConfigError: Not of that form, or an unknown type or direction.
    """
    body, _, value = text.partition("=")
    parts = body.split(":")
    form = "NAME:TYPE:DIRECTION[=VALUE], as in FRI.Out_Integer_Seconds:digital:output"
    if len(parts) != 3 or not parts[0]:
        raise ConfigError(f"IO signal is {text!r}; give {form}")
    kinds = {t.name.lower(): t for t in IoType}
    directions = {d.name.lower(): d for d in IoDirection}
    if parts[1] not in kinds or parts[2] not in directions:
        raise ConfigError(
            f"IO signal {text!r}: known types are {', '.join(kinds)}; known directions "
            f"are {', '.join(directions)}; give {form}"
        )
    try:
        initial = float(value) if value else 0.0
    except ValueError:
        raise ConfigError(f"IO signal {text!r}: value {value!r} is no number") from None
    return Signal(parts[0], kinds[parts[1]], directions[parts[2]], initial)


def require_signals(signals: Iterable[Signal]) -> None:
    """Refuse signals that a message cannot carry.

    Raises:
        ConfigError: More than ten, a name twice or too long, or an unfit value.
    """
    signals = tuple(signals)
    if len(signals) > MAX_IO:
        raise ConfigError(f"{len(signals)} IO signals; FRI carries {MAX_IO} at most")
    _require_names("IO signal", [signal.name for signal in signals])
    for signal in signals:
        if not _fits(signal.type, signal.initial):
            raise ConfigError(
                f"IO signal {signal.name!r} is {signal.type.name.lower()} and cannot "
                f"start at {signal.initial:g}"
            )


def require_transformations(names: Iterable[str]) -> None:
    """Refuse transformation names that a message cannot carry.

    Raises:
        ConfigError: More than five, a name twice or too long.
    """
    names = tuple(names)
    if len(names) > MAX_TRANSFORMATIONS:
        raise ConfigError(
            f"{len(names)} transformations; FRI carries {MAX_TRANSFORMATIONS} at most"
        )
    _require_names("transformation", list(names))


def _require_names(what: str, names: list[str]) -> None:
    for name in names:
        size = len(name.encode())
        if not 0 < size <= MAX_NAME or "\0" in name:
            raise ConfigError(
                f"{what} name {name!r} has {size} bytes; allowed are 1 to {MAX_NAME} "
                "without a NUL"
            )
        if names.count(name) > 1:
            raise ConfigError(f"{what} {name!r} is registered twice")


def _fits(kind: IoType, value: Any) -> bool:
    if isinstance(value, bool):
        value = int(value)
    if not isinstance(value, (int, float)) or not math.isfinite(value):
        return False
    if kind is IoType.ANALOG:
        return True
    if value != int(value):
        return False
    return value in (0, 1) if kind is IoType.BOOLEAN else 0 <= value < 2**64


class SignalTable:
    """Current values of the signals; checks every write."""

    def __init__(self, signals: Iterable[Signal]) -> None:
        """Begin with the initial values."""
        self.signals = {signal.name: signal for signal in signals}
        self.values = {name: signal.initial for name, signal in self.signals.items()}
        self.writes = 0
        """Writes taken from the client."""
        self.rejected = 0
        """Writes of the client that were refused."""
        self.last_refusal = ""

    def write(self, name: str, kind: int, direction: int, value: Any) -> bool:
        """Take a write of the client.

        Args:
            name: Signal's name.
            kind: IoType as sent.
            direction: IoDirection as sent.
            value: Value as sent, None where absent.

        Returns:
            Whether it was taken; `last_refusal` says why not.
        """
        reason = self._refusal(name, kind, direction, value)
        if reason:
            self.rejected += 1
            self.last_refusal = reason
            return False
        self.writes += 1
        self.values[name] = value
        return True

    def _refusal(self, name: str, kind: int, direction: int, value: Any) -> str:
        signal = self.signals.get(name)
        if signal is None:
            known = ", ".join(self.signals) or "none"
            return f"IO write to unknown signal {name!r}; registered: {known}"
        if signal.direction is not IoDirection.OUTPUT or direction != signal.direction:
            return f"IO write to {name!r}, which is an input of the client"
        if kind != signal.type:
            return f"IO write to {name!r} as type {kind}, it is {signal.type.name}"
        if not _fits(signal.type, value):
            return f"IO write of {value!r} to {name!r}, which is {signal.type.name}"
        return ""

    def set(self, name: str, value: float) -> None:
        """Set an input, as the Java application does.

        Raises:
            ConfigError: Unknown signal, or a value that does not fit its type.
        """
        signal = self.signals.get(name)
        if signal is None or not _fits(signal.type, value):
            known = ", ".join(self.signals) or "none"
            raise ConfigError(
                f"IO signal {name!r} cannot be set to {value!r}; registered: {known}"
            )
        self.values[name] = value
