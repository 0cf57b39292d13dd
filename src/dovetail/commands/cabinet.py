"""`dovetail cabinet`: a simulated robot behind KUKA's FRI."""

import gc
import sys
import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
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
from dovetail.commands.cabinet_options import (
    CellOptions,
    ConnectionOptions,
    EventOptions,
    LawOptions,
    MotionEndOptions,
    PaceOptions,
    SignalOptions,
)
from dovetail.commands.ended_by_signal import End, ended_by_signal
from dovetail.commands.help_page import sections_of
from dovetail.control.sections import Sectioned
from dovetail.durations import parse_duration
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, PlantError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DrivenPlant
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import TOOL_DOWN, Pose, quat_about_z
from dovetail.printable import printable
from dovetail.robots.find import find_robot

_FIXTURE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
_ABOVE = 0.06
"""Height of the start over the fixture [m]."""
_PLAIN_EVERY = 10.0
"""Time between two status lines where there is no terminal [s]."""


@dataclass(frozen=True, kw_only=True)
class Cabinet(Sectioned):
    """Simulate an LBR iiwa 14 on FRI, for dovetail's and for KUKA's own clients."""

    whose: ClassVar[str] = "the command cabinet"

    cell: CellOptions = field(default_factory=CellOptions)
    """The robot and what stands around it."""
    connection: ConnectionOptions = field(default_factory=ConnectionOptions)
    """Addresses, ports and FRI version."""
    pace: PaceOptions = field(default_factory=PaceOptions)
    """Timing of messages and answers."""
    law: LawOptions = field(default_factory=LawOptions)
    """Client command mode and joint impedance."""
    end: MotionEndOptions = field(default_factory=MotionEndOptions)
    """Conditions that end a motion."""
    signals: SignalOptions = field(default_factory=SignalOptions)
    """IO signals and transformations."""
    events: EventOptions = field(default_factory=EventOptions)
    """Faults, and the log of events."""

    def run(self, console: Console) -> int:
        """Run until Ctrl-C or SIGTERM."""
        config = self.settings()
        events, cell = self.events, self.cell
        faults = parse_faults(events.fault)
        script = read_script(events.script) if events.script else []
        if self.pace.realtime:
            console.print(request_realtime(), soft_wrap=True, highlight=False)
        plant = self._build_plant()
        twin = None if cell.plant else load_twin(cell.twin or "medium")
        if twin is not None and (lack := twin.lacks(find_robot(cell.robot))):
            console.print(f"cabinet: note: {lack}", soft_wrap=True, highlight=False)
        for text in find_unproven(config, faults, twin):
            console.print(f"cabinet: warning: {text}", soft_wrap=True, highlight=False)
        with ended_by_signal() as end:
            server = None
            try:
                log = events.log
                server = Server(plant, config, faults=faults, script=script, log=log)
                _announce(server, console)
                _prepare_process()
                server.start()
                _show_status(server, console, end)
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
        place, pace, law, end = self.connection, self.pace, self.law, self.end
        delay, control = end.restart_delay, None
        if place.control != "none":
            control = parse_endpoint(place.control, "--control")
        return CabinetConfig.of(
            version=place.version,
            period=pace.period,
            receive_multiplier=pace.multiplier,
            client=parse_endpoint(place.client, "--client"),
            bind=parse_endpoint(f"{place.bind}:{place.port}", "--bind and --port"),
            control=control,
            mode=law.mode,
            clock=pace.clock,
            patience=parse_duration(pace.patience, "--patience"),
            stiffness=_seven(law.stiffness, "--stiffness"),
            damping=_seven(law.damping, "--damping"),
            fair_from=min(end.good_from, QualityRule.fair_from),
            good_from=end.good_from,
            excellent_from=max(end.good_from, QualityRule.excellent_from),
            mirror_tolerance=law.mirror_tolerance,
            hold_slots=end.hold_slots,
            stop_slots=end.stop_slots,
            restart_delay=(
                None if delay == "never" else parse_duration(delay, "--restart-delay")
            ),
            io=tuple(parse_signal(text) for text in self.signals.io),
            transformations=self.signals.transformation,
        )

    def _build_plant(self) -> DrivenPlant:
        """Return the arm, at rest over the fixture."""
        given = self.cell
        if given.twin is not None and given.plant is not None:
            raise ConfigError(
                "--twin and --plant exclude each other: a twin has its own"
            )
        cell = find_cell(given.env, given.robot, **given.task_options)
        if given.plant is not None:
            plant = make_plant(given.plant, cell)
        else:
            plant = make_twin(given.twin or "medium", cell)
        above = _FIXTURE.position + np.array([0.0, 0.0, _ABOVE])
        robot = plant.robot
        pose = Pose(above, TOOL_DOWN)
        start = robot.inverse_kinematics(pose, robot.posture("rest"))
        plant.reset(start, _FIXTURE)
        return plant


GROUPS = sections_of(Cabinet)


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
    """Keep pauses short."""
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
    return printable(f"{line}  {why}" if why else line)


def _show_status(server: Server, console: Console, end: End) -> None:
    """Show the cabinet's status until it ends or a signal ends it."""
    if console.is_terminal:
        with Live(console=console, refresh_per_second=5, transient=True) as live:
            while server.is_running and not end.wait(0.2):
                status = server.request({"do": "status"})
                if status["ok"]:
                    live.update(Text(describe_status(status), no_wrap=True))
    else:
        _print_status(server, console, end)
    if end.is_requested():
        console.print("cabinet: ends, says IDLE to the client")


def _print_status(server: Server, console: Console, end: End) -> None:
    """Print a line where the state changes, and now and then."""
    last, printed = "", 0.0
    while server.is_running and not end.wait(0.05):
        status = server.request({"do": "status"})
        now = time.monotonic()
        if status["ok"] and (status["state"] != last or now > printed + _PLAIN_EVERY):
            last, printed = status["state"], now
            line = describe_status(status)
            console.print(line, soft_wrap=True, highlight=False, markup=False)
