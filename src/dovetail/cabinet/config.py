"""Settings of the cabinet, and how addresses are written."""

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from dovetail.cabinet.protocol import VERSIONS
from dovetail.cabinet.quality import QualityRule
from dovetail.cabinet.signals import Signal, require_signals, require_transformations
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.errors import ConfigError
from dovetail.types import JOINTS

_RANGES: dict[str, tuple[float, float, str]] = {
    "mirror_tolerance": (0.0, math.pi, "rad"),
    "axis_delta_max": (0.0, math.pi, "rad"),
    "command_speed_factor": (0.0, 100.0, "1"),
    "speed_factor": (0.0, 100.0, "1"),
    "external_filter": (0.0, 10.0, "s"),
    "watchdog": (0.01, 3600.0, "s"),
}
_WORDS = {
    "clock": ("wall", "lockstep"),
    "mode": ("torque", "position", "wrench"),
}
_LEAST = {
    "receive_multiplier": 1,
    "sync_slots": 1,
    "drive_slots": 0,
    "ready_slots": 0,
    "hold_slots": 0,
    "stop_slots": 1,
}
_HOLD, _STOP = (3, 0.005), (10, 0.05)
"""Missed commands, and the time in which as many [s]: the sooner counts."""


class Endpoint(NamedTuple):
    """An address of a socket."""

    host: str
    port: int

    def __str__(self) -> str:
        """Return it as it is written: HOST:PORT."""
        return f"{self.host}:{self.port}"


_CLIENT = Endpoint("127.0.0.1", 30200)
_BIND = Endpoint("127.0.0.1", 30300)
_CONTROL = Endpoint("127.0.0.1", 30301)


def parse_endpoint(text: str, name: str) -> Endpoint:
    """Read HOST:PORT.

    Raises:
        ConfigError: It is not of that form, or the port is out of range.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal():
        raise ConfigError(f"{name} is {text!r}; give HOST:PORT, as in 127.0.0.1:30200")
    if int(port) > 65535:
        raise ConfigError(f"{name} has port {port}; allowed is 0 to 65535")
    return Endpoint(host, int(port))


@dataclass(frozen=True, kw_only=True)
class CabinetConfig:
    """Everything about a cabinet but the arm behind it."""

    version: str = "1.15"
    """Wire version: 1.15 (1.14 to 1.16), 2.5 or 2.7; client and cabinet must agree."""
    period: float = DEFAULT_PERIOD
    """Send period [s], 1 to 100 ms in whole ms."""
    receive_multiplier: int = 1
    """The client answers every so many messages."""
    client: Endpoint = _CLIENT
    """Where messages go, and the only address commands are taken from."""
    bind: Endpoint = _BIND
    """The cabinet's own UDP address; port 0 takes a free one."""
    control: Endpoint | None = _CONTROL
    """Control port (TCP); None for none, port 0 for a free one."""
    mode: Literal["torque", "position", "wrench"] = "torque"
    """What the overlay wants from the client, besides the position in every command."""
    clock: Literal["wall", "lockstep"] = "wall"
    """wall sends by the clock; lockstep sends when the reply to the last has come."""
    watchdog: float = 10.0
    """How long lockstep waits for a reply before it counts as missed [s]."""
    stiffness: tuple[float, ...] = (0.0,) * 7
    """Stiffness of the joint impedance [Nm/rad]; 0 leaves the arm to the client."""
    damping: tuple[float, ...] = (0.0,) * 7
    """Damping ratio of the joint impedance, 0 to 1 [1]."""
    coriolis: bool = True
    """The cabinet compensates Coriolis and centrifugal torques where its impedance
    acts; real cabinets probably do under an overlay, but no source says so."""
    quality: QualityRule = field(default_factory=QualityRule)
    """When the link is poor, fair, good or excellent."""
    mirror_tolerance: float = 0.15
    """Distance of the command from the interpolator in COMMANDING_WAIT [rad]."""
    sync_slots: int = 10
    """Mirrored commands in a row that make the client synchronised."""
    drive_slots: int = 5
    """Messages until the drives are active."""
    ready_slots: int = 10
    """Messages in MONITORING_READY before a motion starts by itself."""
    restart_delay: float | None = 0.5
    """Time after a motion that ended with an error until the next [s]; None waits for
    the control port's resume."""
    hold_slots: int | None = None
    """Missed commands for which the last one is held; None is 3, but 5 ms at most."""
    stop_slots: int | None = None
    """Missed commands in a row that end the motion; None is 10, but 50 ms at most.
    Between, the drives stop the arm on its path."""
    axis_delta_max: float = math.radians(10.0)
    """Distance of commanded from measured position that stops the motion [rad]."""
    command_speed_factor: float = 3.0
    """Speed of the position command over the joint's limit that stops the motion."""
    speed_factor: float = 1.2
    """Speed of the joint over its limit that stops the motion [1]."""
    measured_sign: Literal[-1, 1] = -1
    """Sign of the measured torque on the wire over the torque on the joint."""
    commanded_sign: Literal[-1, 1] = -1
    """Sign of the commanded torque on the wire over the torque on the joint."""
    external_sign: Literal[-1, 1] = 1
    """Sign of the external torque on the wire over the push on the joint."""
    commanded_torque: Literal["overlay", "total"] = "overlay"
    """What the commanded torque on the wire contains; total adds gravity and
    impedance."""
    external_filter: float = 0.02
    """Time constant of the external torque's estimate [s]."""
    io: tuple[Signal, ...] = ()
    """IO signals that the Java application has registered."""
    transformations: tuple[str, ...] = ()
    """Names of the transformations that the cabinet requests."""

    def __post_init__(self) -> None:
        """Refuse settings out of range, by name."""
        if self.version not in VERSIONS:
            raise ConfigError(
                f"FRI version {self.version!r} is unknown; known versions: "
                f"{', '.join(VERSIONS)} (1.14 and 1.16 speak 1.15)"
            )
        period_ms = 1e3 * self.period
        if not (0.999 < period_ms < 100.001 and abs(period_ms % 1.0 - 0.5) > 0.499):
            raise ConfigError(
                f"send period is {period_ms:g} ms; allowed are whole ms, 1 to 100, as "
                "on the wire (dovetail's controller takes 1, 2 and 5 ms, and 2.5 ms "
                "only on arms in its own process)"
            )
        object.__setattr__(self, "period", 1e-3 * round(period_ms))
        for name, known in _WORDS.items():
            if getattr(self, name) not in known:
                raise ConfigError(
                    f"{name} {getattr(self, name)!r} is unknown; known {name}s: "
                    f"{', '.join(known)}"
                )
        for name, low in _LEAST.items():
            value = getattr(self, name)
            if value is not None and value < low:
                raise ConfigError(f"{name} is {value}; give >= {low}")
        if self.stop_misses < self.held_misses:
            raise ConfigError(
                f"stop_slots is {self.stop_misses}, less than hold_slots "
                f"{self.held_misses}: the motion would stop while a command is held"
            )
        for name, (low, high, unit) in _RANGES.items():
            _require_range(name, getattr(self, name), low, high, unit)
        if self.restart_delay is not None:
            _require_range("restart_delay", self.restart_delay, 0.0, 3600.0, "s")
        self._require_impedance("stiffness", 1e4, "Nm/rad")
        self._require_impedance("damping", 1.0, "1")
        require_signals(self.io)
        require_transformations(self.transformations)

    def _require_impedance(self, name: str, high: float, unit: str) -> None:
        values = tuple(float(v) for v in getattr(self, name))
        if len(values) != 7:
            raise ConfigError(f"{name} has {len(values)} elements, needs 7")
        for joint, value in zip(JOINTS, values, strict=True):
            _require_range(f"{name}[{joint}]", value, 0.0, high, unit)
        object.__setattr__(self, name, values)

    @property
    def held_misses(self) -> int:
        """Missed commands for which the last one is held."""
        return self._misses(*_HOLD) if self.hold_slots is None else self.hold_slots

    @property
    def stop_misses(self) -> int:
        """Missed commands in a row that end the motion."""
        if self.stop_slots is not None:
            return self.stop_slots
        return max(self._misses(*_STOP), self.held_misses + 1)

    def _misses(self, most: int, duration: float) -> int:
        slot = self.period * self.receive_multiplier
        return max(1, min(most, math.floor(duration / slot + 1e-9)))

    @property
    def period_ms(self) -> int:
        """Send period as on the wire [ms]."""
        return round(1e3 * self.period)


def _require_range(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise ConfigError(
            f"cabinet {name} is {value:g} {unit}, allowed is {low:g} to {high:g} {unit}"
        )
