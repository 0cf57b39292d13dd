"""`dovetail cabinet`: a simulated robot behind KUKA's FRI."""

import gc
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from rich.console import Console
from rich.live import Live
from rich.text import Text

from dovetail.cabinet.cabinet import Cabinet as Server
from dovetail.cabinet.config import CabinetConfig, parse_endpoint
from dovetail.cabinet.faults import parse_faults, read_script
from dovetail.cabinet.proven import find_unproven
from dovetail.cabinet.quality import QualityRule
from dovetail.cabinet.realtime import request_realtime
from dovetail.cabinet.signals import parse_signal
from dovetail.commands.help_page import Groups
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.period_option import Period
from dovetail.durations import parse_duration
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, PlantError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DrivenPlant
from dovetail.plants.twin import TwinPlant, load_twin
from dovetail.poses import TOOL_DOWN, Pose, quat_about_z
from dovetail.robots.find import DEFAULT_ROBOT, find_robot
from dovetail.tasks.options import TaskOptions
from dovetail.tasks.shipped import DEFAULT_ENV

_FIXTURE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
_ABOVE = 0.06
"""Height of the start over the fixture [m]."""
_PLAIN_EVERY = 10.0
"""Time between two status lines where there is no terminal [s]."""

GROUPS: Groups = {
    "the robot": ("twin", "plant", "robot", "env", "task_options"),
    "the connection": ("version", "client", "bind", "port", "control"),
    "time": ("period", "multiplier", "clock", "patience", "realtime"),
    "control": ("mode", "stiffness", "damping", "mirror_tolerance"),
    "when a motion ends": ("good_from", "hold_slots", "stop_slots", "restart_delay"),
    "what is passed along": ("io", "transformation"),
    "faults and events": ("fault", "script", "log"),
}


@dataclass(frozen=True, kw_only=True)
class Cabinet:
    """Simulate an LBR iiwa 14 on FRI, for dovetail's and for KUKA's own clients."""

    twin: str | None = None
    """Twin that plays the robot: the name of a shipped one, or a .toml file."""
    plant: str | None = None
    """Plain plant in place of a twin: mujoco or bullet."""
    version: str = "1.15"
    """FRI version on the wire: 1.15 (1.14 to 1.16), 2.5 or 2.7."""
    period: Period = DEFAULT_PERIOD
    """Send period: whole milliseconds, 1ms to 100ms. An arm of dovetail takes 1ms, 2ms
    and 5ms, the multiplier counted."""
    multiplier: int = 1
    """Receive multiplier: the client answers every so many messages."""
    client: str = "127.0.0.1:30200"
    """The client's address; commands from any other are counted and ignored."""
    bind: str = "127.0.0.1"
    """Own address, of the network the client is in."""
    port: int = 30300
    """Own UDP port. KUKA's clients that were given the cabinet's name expect 30200."""
    control: str = "127.0.0.1:30301"
    """Control port (TCP), or none."""
    mode: Literal["torque", "position", "wrench"] = "torque"
    """What the overlay wants from the client."""
    clock: Literal["wall", "lockstep"] = "wall"
    """wall sends by the clock; lockstep sends when the last message was answered."""
    patience: Annotated[str, tyro.conf.arg(aliases=["--watchdog"])] = "10s"
    """How long lockstep waits for an answer."""
    stiffness: str = "0"
    """Joint stiffness [Nm/rad]: one number, or seven separated by commas."""
    damping: str = "0"
    """Joint damping ratio, 0 to 1: one number, or seven separated by commas."""
    mirror_tolerance: float = 0.15
    """Distance from the interpolator that COMMANDING_WAIT accepts [rad]."""
    good_from: float = 0.80
    """Share of the last 100 answers in time that commanding needs."""
    hold_slots: int | None = None
    """Missing commands for which the last one is held; by default 3, at most 5 ms."""
    stop_slots: int | None = None
    """Missing commands in a row that end the motion; by default 10, at most 50 ms."""
    restart_delay: str = "500ms"
    """Time after a motion that ended with an error until the next, or never."""
    env: str = DEFAULT_ENV
    """Task whose parts stand in the cell: a Gymnasium id, or MODULE:ID of your own."""
    robot: str = DEFAULT_ROBOT
    """Robot in the cell: one of dovetail's, or MODULE:FUNCTION of your own."""
    task_options: TaskOptions = field(default_factory=TaskOptions)
    """Fields of the task; left out, they are its own."""
    io: tuple[str, ...] = ()
    """IO signals, each NAME:TYPE:DIRECTION[=VALUE]; TYPE is boolean, digital or analog,
    DIRECTION input or output."""
    transformation: tuple[str, ...] = ()
    """Names of transformations that are requested from the client."""
    fault: str = "none"
    """Faults from the start, as loss=0.02,delay=3ms."""
    script: Path | None = None
    """File of faults by time: lines TIME FAULTS, as 2s loss=0.1."""
    log: Path | None = None
    """File for the events, as JSON lines; it is appended to."""
    realtime: bool = False
    """Ask for real-time priority (SCHED_FIFO)."""

    def run(self, console: Console) -> int:
        """Run until interrupted."""
        config = self.settings()
        faults = parse_faults(self.fault)
        script = read_script(self.script) if self.script else []
        if self.realtime:
            console.print(request_realtime(), soft_wrap=True, highlight=False)
        plant = self._build_plant()
        if self.plant is None:
            lack = load_twin(self.twin or "medium").lacks(find_robot(self.robot))
            if lack:
                console.print(f"cabinet: note: {lack}", soft_wrap=True, highlight=False)
        for text in find_unproven(config, faults, plant.command_delay):
            console.print(f"cabinet: warning: {text}", soft_wrap=True, highlight=False)
        server = None
        try:
            server = Server(plant, config, faults=faults, script=script, log=self.log)
            _announce(server, console)
            _prepare_process()
            server.start()
            _show_status(server, console)
        except KeyboardInterrupt:
            console.print("cabinet: ends, says IDLE to the client")
        finally:
            if server is not None:
                server.close()
            plant.close()
            gc.unfreeze()
        if server is not None and server.failure:
            raise PlantError(f"the cabinet ended: {server.failure}")
        return 0

    def settings(self) -> CabinetConfig:
        """Return the cabinet's settings, checked.

        Raises:
            ConfigError: One of them is wrong.
        """
        never = self.restart_delay == "never"
        control = None
        if self.control != "none":
            control = parse_endpoint(self.control, "--control")
        return CabinetConfig.of(
            version=self.version,
            period=self.period,
            receive_multiplier=self.multiplier,
            client=parse_endpoint(self.client, "--client"),
            bind=parse_endpoint(f"{self.bind}:{self.port}", "--bind and --port"),
            control=control,
            mode=self.mode,
            clock=self.clock,
            patience=parse_duration(self.patience, "--patience"),
            stiffness=_seven(self.stiffness, "--stiffness"),
            damping=_seven(self.damping, "--damping"),
            fair_from=min(self.good_from, QualityRule.fair_from),
            good_from=self.good_from,
            excellent_from=max(self.good_from, QualityRule.excellent_from),
            mirror_tolerance=self.mirror_tolerance,
            hold_slots=self.hold_slots,
            stop_slots=self.stop_slots,
            restart_delay=(
                None if never else parse_duration(self.restart_delay, "--restart-delay")
            ),
            io=tuple(parse_signal(text) for text in self.io),
            transformations=self.transformation,
        )

    def _build_plant(self) -> DrivenPlant:
        """Return the arm, at rest over the fixture."""
        if self.twin is not None and self.plant is not None:
            raise ConfigError(
                "--twin and --plant exclude each other: a twin has its own"
            )
        cell = find_cell(self.env, self.robot, **self.task_options)
        if self.plant is not None:
            plant = make_plant(self.plant, cell)
        else:
            twin = load_twin(self.twin or "medium")
            plant = TwinPlant(twin, cell)
        above = _FIXTURE.position + np.array([0.0, 0.0, _ABOVE])
        robot = plant.robot
        pose = Pose(above, TOOL_DOWN)
        start = robot.inverse_kinematics(pose, robot.posture("rest"))
        plant.reset(start, _FIXTURE)
        return plant


def _seven(text: str, name: str) -> tuple[float, ...]:
    """Read one number for all joints, or seven.

    Raises:
        ConfigError: Another count, or no numbers.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (1, 7):
        raise ConfigError(
            f"{name} is {text!r}; give one number for all joints, or seven separated "
            "by commas"
        )
    return values * 7 if len(values) == 1 else values


def _prepare_process() -> None:
    """Keep pauses short, and end on SIGTERM as on Ctrl-C."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.setswitchinterval(1e-4)  # the cabinet's thread waits no longer for this one
    gc.collect()
    gc.freeze()


def _announce(server: Server, console: Console) -> None:
    config, pace = server.config.connection, server.config.pace
    console.print(
        f"cabinet: FRI {config.version}, {pace.period_ms} ms, clock {pace.clock}; "
        f"UDP {server.address} to client {config.client}; control "
        f"{server.control_address or 'none'}; Ctrl-C ends it",
        soft_wrap=True,
        highlight=False,
    )


def describe_status(status: dict[str, Any]) -> str:
    """Return the status line: state, quality, rate and what went wrong."""
    counts = status["counts"]
    line = (
        f"{status['state']:17} {status['quality']:9} {status['rate']:7.1f}/s "
        f"t {status['time']:.1f} s  missed {counts.get('active_missed', 0)} of "
        f"{counts.get('active_due', 0)} while active  stops {counts.get('stops', 0)}"
    )
    for name in ("undecodable", "foreign", "late", "overruns"):
        if counts.get(name):
            line += f"  {name} {counts[name]}"
    reasons = ("stop_reason", "waits_for", "last_error", "log_failure")
    why = next((status[name] for name in reasons if status.get(name)), "")
    if not why and not counts.get("received"):
        why = "nothing heard from the client yet"
    line = f"{line}  {why}" if why else line
    return line.encode("utf-8", "backslashreplace").decode()


def _show_status(server: Server, console: Console) -> None:
    """Show how the cabinet is until it ends or Ctrl-C comes."""
    if console.is_terminal:
        with Live(console=console, refresh_per_second=5, transient=True) as live:
            while server.is_running:
                status = server.request({"do": "status"})
                if status["ok"]:
                    live.update(Text(describe_status(status), no_wrap=True))
                time.sleep(0.2)
        return
    last, printed = "", 0.0
    while server.is_running:
        status = server.request({"do": "status"})
        now = time.monotonic()
        if status["ok"] and (status["state"] != last or now > printed + _PLAIN_EVERY):
            last, printed = status["state"], now
            line = describe_status(status)
            console.print(line, soft_wrap=True, highlight=False, markup=False)
        time.sleep(0.05)
