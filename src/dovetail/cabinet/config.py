"""Settings of the cabinet, and how addresses are written."""

import math
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import model_validator

from dovetail.cabinet.protocol import VERSIONS
from dovetail.cabinet.quality import QualityRule
from dovetail.cabinet.signals import Signal, require_signals, require_transformations
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.errors import ConfigError
from dovetail.settings import Range, fill_in, settings
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


@settings(owner="cabinet")
class ConnectionConfig:
    """The ports, and what is spoken there."""

    version: str = "1.15"
    """Wire version: 1.15 (1.14 to 1.16), 2.5 or 2.7; client and cabinet must agree."""
    client: Endpoint = _CLIENT
    """Address of the client; commands from any other are dropped."""
    bind: Endpoint = _BIND
    """The cabinet's own UDP address; port 0 takes a free one."""
    control: Endpoint | None = _CONTROL
    """Control port (TCP); None for none, port 0 for a free one."""

    @model_validator(mode="after")
    def _check_connection_config(self) -> Self:
        """Refuse a version that is not known."""
        if self.version not in VERSIONS:
            raise ConfigError(
                f"FRI version {self.version!r} is unknown; known versions: "
                f"{', '.join(VERSIONS)} (1.14 and 1.16 speak 1.15)"
            )
        return self


@settings(owner="cabinet")
class PaceConfig:
    """Timing of messages and answers."""

    period: float = DEFAULT_PERIOD
    """Send period [s], 1 to 100 ms in whole ms."""
    receive_multiplier: Annotated[int, Range(1, _SLOTS_MAX, "messages")] = 1
    """The client answers every so many messages."""
    clock: Literal["wall", "lockstep"] = "wall"
    """wall sends by the clock; lockstep sends when the reply to the last has come."""
    patience: Annotated[float, Range(0.01, 3600.0, "s")] = 10.0
    """Longest wait of lockstep for a reply before it counts as missed [s]."""

    @model_validator(mode="after")
    def _check_pace_config(self) -> Self:
        """Refuse a period that the wire cannot tell."""
        period_ms = 1e3 * self.period
        if not (0.999 < period_ms < 100.001 and abs(period_ms % 1.0 - 0.5) > 0.499):
            raise ConfigError(
                f"send period is {period_ms:g} ms; allowed are whole ms, 1 to 100, as "
                "on the wire (dovetail's controller takes 1, 2 and 5 ms, and 2.5 ms "
                "only on arms in its own process)"
            )
        fill_in(self, period=1e-3 * round(period_ms))
        return self

    @property
    def period_ms(self) -> int:
        """Send period as on the wire [ms]."""
        return round(1e3 * self.period)

    @property
    def slot(self) -> float:
        """Time between two answers [s]."""
        return self.period * self.receive_multiplier


@settings(owner="cabinet")
class LawConfig:
    """Control law of the arm, besides its own gravity compensation."""

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


@settings(owner="cabinet")
class MotionStartConfig:
    """Conditions for the start of a motion."""

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


@settings(owner="cabinet")
class MotionEndConfig:
    """Errors that end a motion."""

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


@settings(owner="cabinet")
class WireTorqueConfig:
    """Torques on the wire: signs, content and filter."""

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


@settings(owner="cabinet")
class SignalConfig:
    """IO signals and requested transformations."""

    io: tuple[Signal, ...] = ()
    """IO signals that the Java application has registered."""
    transformations: tuple[str, ...] = ()
    """Names of the transformations that the cabinet requests."""

    @model_validator(mode="after")
    def _check_signal_config(self) -> Self:
        """Refuse what a message cannot carry."""
        require_signals(self.io)
        require_transformations(self.transformations)
        return self


@settings()
class CabinetConfig(
    ConnectionConfig,
    PaceConfig,
    LawConfig,
    QualityRule,
    MotionStartConfig,
    MotionEndConfig,
    WireTorqueConfig,
    SignalConfig,
):
    """Everything about a cabinet but the arm behind it."""

    @model_validator(mode="after")
    def _check_cabinet_config(self) -> Self:
        """Refuse to stop a motion while a command is held."""
        if self.stop_misses < self.held_misses:
            raise ConfigError(
                f"stop_slots is {self.stop_misses}, less than hold_slots "
                f"{self.held_misses}: the motion would stop while a command is held"
            )
        return self

    @property
    def held_misses(self) -> int:
        """Missed commands for which the last one is held."""
        given = self.hold_slots
        return self._misses(*_HOLD) if given is None else given

    @property
    def stop_misses(self) -> int:
        """Missed commands in a row that end the motion."""
        if self.stop_slots is not None:
            return self.stop_slots
        return max(self._misses(*_STOP), self.held_misses + 1)

    def _misses(self, most: int, duration: float) -> int:
        return max(1, min(most, math.floor(duration / self.slot + 1e-9)))
