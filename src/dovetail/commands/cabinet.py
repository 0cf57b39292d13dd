"""`dovetail cabinet`: a simulated robot behind KUKA's FRI."""

import gc
import sys
import time
from typing import Any

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
from dovetail.durations import parse_duration
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, PlantError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DrivenPlant
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import TOOL_DOWN, Pose
from dovetail.printable import printable
from dovetail.settings import settings

_ABOVE = 0.06
"""Height of the start over the fixture [m]."""
_PLAIN_EVERY = 10.0
"""Time between two status lines where there is no terminal [s]."""


@settings()
class Cabinet(
    CellOptions,
    ConnectionOptions,
    PaceOptions,
    LawOptions,
    MotionEndOptions,
    SignalOptions,
    EventOptions,
):
    """Simulate an LBR iiwa 14 on FRI, for dovetail's and for KUKA's own clients."""

    def run(self, console: Console) -> int:
        """Run until Ctrl-C or SIGTERM."""
        config = self.settings()
        faults = parse_faults(self.fault)
        script = read_script(self.script) if self.script else []
        if self.realtime:
            console.print(request_realtime(), soft_wrap=True, highlight=False)
        plant = self._build_plant()
        twin = None if self.plant else load_twin(self.twin or "medium")
        lack = "" if twin is None else twin.lacks(plant.cell.robot)
        for text in filter(None, (lack, *plant.cell.notes)):
            console.print(f"cabinet: note: {text}", soft_wrap=True, highlight=False)
        for text in find_unproven(config, faults, twin):
            console.print(f"cabinet: warning: {text}", soft_wrap=True, highlight=False)
        with ended_by_signal() as end:
            server = None
            try:
                log = self.log
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
        delay, control = self.restart_delay, None
        if self.control != "none":
            control = parse_endpoint(self.control, "--control")
        return CabinetConfig(
            version=self.version,
            period=self.period,
            receive_multiplier=self.receive_multiplier,
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
                None if delay == "never" else parse_duration(delay, "--restart-delay")
            ),
            io=tuple(parse_signal(text) for text in self.io),
            transformations=self.transformations,
        )

    def _build_plant(self) -> DrivenPlant:
        """Return the arm, at rest over the fixture."""
        if self.twin is not None and self.plant is not None:
            raise ConfigError(
                "--twin and --plant exclude each other: a twin has its own"
            )
        cell = find_cell(self.env, self.robot, self.cell, **self.task_options)
        fixture = cell.place
        if self.plant is not None:
            plant = make_plant(self.plant, cell)
        else:
            plant = make_twin(self.twin or "medium", cell)
        above = fixture.position + np.array([0.0, 0.0, _ABOVE])
        robot = plant.robot
        pose = Pose(above, TOOL_DOWN)
        start = robot.inverse_kinematics(pose, robot.posture("rest"))
        plant.reset(start, fixture)
        return plant


COMMON = (
    *("twin", "plant", "robot", "env", "task_options", "cell", "version", "client"),
    *("bind", "port", "control", "period", "receive_multiplier", "clock", "realtime"),
    *("mode", "stiffness", "damping", "fault", "script", "log"),
)
"""Settings that `--help` lists."""


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
    config = server.config
    console.print(
        f"cabinet: FRI {config.version}, {config.period_ms} ms, clock {config.clock}; "
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
