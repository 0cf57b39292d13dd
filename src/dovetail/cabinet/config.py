"""Settings of the cabinet, and how addresses are written."""

import math
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal, NamedTuple

from dovetail.cabinet.protocol import VERSIONS
from dovetail.cabinet.quality import QualityRule
from dovetail.cabinet.signals import Signal, require_signals, require_transformations
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.ranges import Range
from dovetail.control.sections import Section, Sectioned
from dovetail.errors import ConfigError
from dovetail.types import JOINTS

_SLOTS_MAX = 1_000_000
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
class ConnectionConfig(Section):
    """The ports, and what is spoken there."""

    owner: ClassVar[str] = "cabinet"

    version: str = "1.15"
    """Wire version: 1.15 (1.14 to 1.16), 2.5 or 2.7; client and cabinet must agree."""
    client: Endpoint = _CLIENT
    """Address of the client; commands from any other are dropped."""
    bind: Endpoint = _BIND
    """The cabinet's own UDP address; port 0 takes a free one."""
    control: Endpoint | None = _CONTROL
    """Control port (TCP); None for none, port 0 for a free one."""

    def __post_init__(self) -> None:
        """Refuse a version that is not known."""
        if self.version not in VERSIONS:
            raise ConfigError(
                f"FRI version {self.version!r} is unknown; known versions: "
                f"{', '.join(VERSIONS)} (1.14 and 1.16 speak 1.15)"
            )
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class PaceConfig(Section):
    """Timing of messages and answers."""

    owner: ClassVar[str] = "cabinet"

    period: float = DEFAULT_PERIOD
    """Send period [s], 1 to 100 ms in whole ms."""
    receive_multiplier: Annotated[int, Range(1, _SLOTS_MAX, "messages")] = 1
    """The client answers every so many messages."""
    clock: Literal["wall", "lockstep"] = "wall"
    """wall sends by the clock; lockstep sends when the reply to the last has come."""
    patience: Annotated[float, Range(0.01, 3600.0, "s")] = 10.0
    """Longest wait of lockstep for a reply before it counts as missed [s]."""

    def __post_init__(self) -> None:
        """Refuse a period that the wire cannot tell."""
        period_ms = 1e3 * self.period
        if not (0.999 < period_ms < 100.001 and abs(period_ms % 1.0 - 0.5) > 0.499):
            raise ConfigError(
                f"send period is {period_ms:g} ms; allowed are whole ms, 1 to 100, as "
                "on the wire (dovetail's controller takes 1, 2 and 5 ms, and 2.5 ms "
                "only on arms in its own process)"
            )
        object.__setattr__(self, "period", 1e-3 * round(period_ms))
        super().__post_init__()

    @property
    def period_ms(self) -> int:
        """Send period as on the wire [ms]."""
        return round(1e3 * self.period)

    @property
    def slot(self) -> float:
        """Time between two answers [s]."""
        return self.period * self.receive_multiplier


@dataclass(frozen=True, kw_only=True)
class LawConfig(Section):
    """Control law of the arm, besides its own gravity compensation."""

    owner: ClassVar[str] = "cabinet"

    mode: Literal["torque", "position", "wrench"] = "torque"
    """Command expected from the client, besides the position that each one has."""
    stiffness: Annotated[tuple[float, ...], Range(0.0, 1e4, "Nm/rad", JOINTS)] = (
        0.0,
    ) * 7
    """Stiffness of the joint impedance [Nm/rad]; 0 leaves the arm to the client."""
    damping: Annotated[tuple[float, ...], Range(0.0, 1.0, "1", JOINTS)] = (0.0,) * 7
    """Damping ratio of the joint impedance, 0 to 1 [1]."""
    coriolis: bool = True
    """The cabinet compensates Coriolis and centrifugal torques where its impedance
    acts; real cabinets probably do under an overlay, but no source says so."""


@dataclass(frozen=True, kw_only=True)
class MotionStartConfig(Section):
    """Conditions for the start of a motion."""

    owner: ClassVar[str] = "cabinet"

    mirror_tolerance: Annotated[float, Range(0.0, math.pi, "rad")] = 0.15
    """Distance of the command from the interpolator in COMMANDING_WAIT [rad]."""
    sync_slots: Annotated[int, Range(1, _SLOTS_MAX, "slots")] = 10
    """Mirrored commands in a row that make the client synchronised."""
    drive_slots: Annotated[int, Range(0, _SLOTS_MAX, "slots")] = 5
    """Messages until the drives are active."""
    ready_slots: Annotated[int, Range(0, _SLOTS_MAX, "slots")] = 10
    """Messages in MONITORING_READY before a motion starts by itself."""
    restart_delay: Annotated[float | None, Range(0.0, 3600.0, "s")] = 0.5
    """Time after a motion that ended with an error until the next [s]; None waits for
    the control port's resume."""


@dataclass(frozen=True, kw_only=True)
class MotionEndConfig(Section):
    """Errors that end a motion."""

    owner: ClassVar[str] = "cabinet"

    hold_slots: Annotated[int | None, Range(0, _SLOTS_MAX, "slots")] = None
    """Missed commands for which the last one is held; None is 3, but 5 ms at most."""
    stop_slots: Annotated[int | None, Range(1, _SLOTS_MAX, "slots")] = None
    """Missed commands in a row that end the motion; None is 10, but 50 ms at most.
    Between, the drives stop the arm on its path."""
    axis_delta_max: Annotated[float, Range(0.0, math.pi, "rad")] = math.radians(10.0)
    """Distance of commanded from measured position that stops the motion [rad]."""
    command_speed_factor: Annotated[float, Range(0.0, 100.0, "1")] = 3.0
    """Speed of the position command over the joint's limit that stops the motion."""
    speed_factor: Annotated[float, Range(0.0, 100.0, "1")] = 1.2
    """Speed of the joint over its limit that stops the motion [1]."""


@dataclass(frozen=True, kw_only=True)
class WireTorqueConfig(Section):
    """Torques on the wire: signs, content and filter."""

    owner: ClassVar[str] = "cabinet"

    measured_sign: Literal[-1, 1] = -1
    """Sign of the measured torque on the wire over the torque on the joint."""
    commanded_sign: Literal[-1, 1] = -1
    """Sign of the commanded torque on the wire over the torque on the joint."""
    external_sign: Literal[-1, 1] = 1
    """Sign of the external torque on the wire over the push on the joint."""
    commanded_torque: Literal["overlay", "total"] = "overlay"
    """Content of the commanded torque on the wire; total adds gravity and
    impedance."""
    external_filter: Annotated[float, Range(0.0, 10.0, "s")] = 0.02
    """Time constant of the external torque's estimate [s]."""


@dataclass(frozen=True, kw_only=True)
class SignalConfig(Section):
    """IO signals and requested transformations."""

    owner: ClassVar[str] = "cabinet"

    io: tuple[Signal, ...] = ()
    """IO signals that the Java application has registered."""
    transformations: tuple[str, ...] = ()
    """Names of the transformations that the cabinet requests."""

    def __post_init__(self) -> None:
        """Refuse what a message cannot carry."""
        super().__post_init__()
        require_signals(self.io)
        require_transformations(self.transformations)


@dataclass(frozen=True, kw_only=True)
class CabinetConfig(Sectioned):
    """Everything about a cabinet but the arm behind it.

    `CabinetConfig.of(period=0.002, clock="lockstep")` takes the settings of every
    section by their short names; `flat` gives them back.
    """

    whose: ClassVar[str] = "a cabinet"

    connection: ConnectionConfig = field(default_factory=ConnectionConfig)
    """The ports, and what is spoken there."""
    pace: PaceConfig = field(default_factory=PaceConfig)
    """Timing of messages and answers."""
    law: LawConfig = field(default_factory=LawConfig)
    """Control law of the arm."""
    quality: QualityRule = field(default_factory=QualityRule)
    """Thresholds of a poor, fair, good or excellent link."""
    start: MotionStartConfig = field(default_factory=MotionStartConfig)
    """Conditions for the start of a motion."""
    end: MotionEndConfig = field(default_factory=MotionEndConfig)
    """Errors that end a motion."""
    torques: WireTorqueConfig = field(default_factory=WireTorqueConfig)
    """Torques on the wire."""
    signals: SignalConfig = field(default_factory=SignalConfig)
    """IO signals and requested transformations."""

    def __post_init__(self) -> None:
        """Refuse to stop a motion while a command is held."""
        if self.stop_misses < self.held_misses:
            raise ConfigError(
                f"stop_slots is {self.stop_misses}, less than hold_slots "
                f"{self.held_misses}: the motion would stop while a command is held"
            )

    @property
    def held_misses(self) -> int:
        """Missed commands for which the last one is held."""
        given = self.end.hold_slots
        return self._misses(*_HOLD) if given is None else given

    @property
    def stop_misses(self) -> int:
        """Missed commands in a row that end the motion."""
        if self.end.stop_slots is not None:
            return self.end.stop_slots
        return max(self._misses(*_STOP), self.held_misses + 1)

    def _misses(self, most: int, duration: float) -> int:
        return max(1, min(most, math.floor(duration / self.pace.slot + 1e-9)))
