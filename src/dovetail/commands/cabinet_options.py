"""Options of `dovetail cabinet`, in the groups of its help."""

from dataclasses import field
from pathlib import Path
from typing import Any, Literal

from dovetail.control.period import DEFAULT_PERIOD
from dovetail.options import Period
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.settings import settings
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.workcell.cell_config import CellFile


@settings()
class CellOptions:
    """The robot."""

    twin: str | None = None
    """Twin that plays the robot: the name of a shipped one, or a .toml file."""
    plant: str | None = None
    """Plain plant in place of a twin: mujoco, bullet or drake."""
    robot: str = DEFAULT_ROBOT
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    Its client needs the same."""
    env: str = DEFAULT_ENV
    """Task whose parts stand in the cell: a Gymnasium id, or MODULE:ID of your own."""
    task_options: dict[str, Any] = field(default_factory=dict)
    """Fields of the task; left out, they are its own."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where fixtures stand. Its client needs the
    same."""


@settings()
class ConnectionOptions:
    """The connection."""

    version: str = "1.15"
    """FRI version on the wire: 1.15 (1.14 to 1.16), 2.5 or 2.7."""
    client: str = "127.0.0.1:30200"
    """The client's address; commands from any other are counted and ignored."""
    bind: str = "127.0.0.1"
    """Own address, of the network the client is in."""
    port: int = 30300
    """Own UDP port. KUKA's clients that were given the cabinet's name expect 30200."""
    control: str = "127.0.0.1:30301"
    """Control port (TCP), or none."""


@settings()
class PaceOptions:
    """Time."""

    period: Period = DEFAULT_PERIOD
    """Send period: whole milliseconds, 1ms to 100ms. An arm of dovetail takes 1ms, 2ms
    and 5ms, with the receive multiplier counted."""
    receive_multiplier: int = 1
    """The client answers every so many messages."""
    clock: Literal["wall", "lockstep"] = "wall"
    """wall sends by the clock; lockstep sends when the last message was answered."""
    patience: str = "10s"
    """Longest wait of lockstep for an answer."""
    realtime: bool = False
    """Ask for real-time priority (SCHED_FIFO)."""


@settings()
class LawOptions:
    """Control."""

    mode: Literal["torque", "position", "wrench"] = "torque"
    """Client command mode of the overlay."""
    stiffness: str = "0"
    """Joint stiffness [Nm/rad]: one number, or seven separated by commas."""
    damping: str = "0"
    """Joint damping ratio, 0 to 1: one number, or seven separated by commas."""
    mirror_tolerance: float = 0.15
    """Distance from the interpolator that COMMANDING_WAIT accepts [rad]."""


@settings()
class MotionEndOptions:
    """Conditions that end a motion."""

    good_from: float = 0.80
    """Share of the last 100 answers in time that commanding needs."""
    hold_slots: int | None = None
    """Missing commands for which the last one is held; by default 3, at most 5 ms."""
    stop_slots: int | None = None
    """Missing commands in a row that end the motion; by default 10, at most 50 ms."""
    restart_delay: str = "500ms"
    """Time after a motion that ended with an error until the next, or never."""


@settings()
class SignalOptions:
    """IO signals and transformations."""

    io: tuple[str, ...] = ()
    """IO signals, each NAME:TYPE:DIRECTION[=VALUE]; TYPE is boolean, digital or analog,
    DIRECTION input or output."""
    transformations: tuple[str, ...] = ()
    """Names of transformations that are requested from the client."""


@settings()
class EventOptions:
    """Faults and events."""

    fault: str = "none"
    """Faults from the start, as loss=0.02,delay=3ms."""
    script: Path | None = None
    """File of faults by time: lines TIME FAULTS, as 2s loss=0.1."""
    log: Path | None = None
    """File for the events, as JSON lines; it is appended to."""
