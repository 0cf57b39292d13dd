"""`dovetail gripper`: one command to a WSG 50, or a simulated one to try it on."""

import signal
import time
from dataclasses import dataclass
from typing import Literal

from rich.console import Console

from dovetail.arms.arm_address import parse_endpoint
from dovetail.errors import ConfigError
from dovetail.gripper.facts import PORT
from dovetail.gripper.simulated import SimulatedWsg50
from dovetail.gripper.wsg50 import Wsg50


@dataclass(frozen=True, kw_only=True)
class Gripper:
    """Home, move, grip or release with a WSG 50; or simulate one until Ctrl-C."""

    at: str = f"127.0.0.1:{PORT}"
    """The gripper's HOST:PORT; with --simulate its own, port 0 any free one."""
    do: Literal["state", "home", "move", "grip", "release", "stop", "acknowledge"] = (
        "state"
    )
    """Action to perform."""
    width: float | None = None
    """move: opening [m]; grip: width of the part [m], unknown without; release: how
    much further to open [m]."""
    force: float = 20.0
    """grip: force [N], 5 to 80."""
    speed: float = 0.05
    """Speed of the fingers [m/s], up to 0.42."""
    simulate: bool = False
    """Play a gripper in place of driving one."""
    part: float | None = None
    """With --simulate: width of the part between the fingers [m]; default no part."""

    def run(self, console: Console) -> int:
        """Do it, and say how the gripper is then."""
        host, port = parse_endpoint(self.at, "--at", is_own=self.simulate)
        if self.simulate:
            return self._simulate(host, port, console)
        with Wsg50(host, port) as gripper:
            self._do(gripper)
            state = gripper.state()
        console.print(
            f"width {1e3 * state.width:.2f} mm, speed {1e3 * state.speed:.1f} mm/s, "
            f"force {state.force:.1f} N, {state.grip.name.lower().replace('_', ' ')}",
            highlight=False,
        )
        return 0

    def _do(self, gripper: Wsg50) -> None:
        if self.do == "home":
            gripper.home()
        elif self.do == "move":
            if self.width is None:
                raise ConfigError("--do move needs --width, the opening [m]")
            gripper.move(self.width, self.speed)
        elif self.do == "grip":
            gripper.grip(self.force, self.width, self.speed)
        elif self.do == "release":
            gripper.release(0.01 if self.width is None else self.width, self.speed)
        elif self.do == "stop":
            gripper.stop()
        elif self.do == "acknowledge":
            gripper.acknowledge()

    def _simulate(self, host: str, port: int, console: Console) -> int:
        ends: list[int] = []
        with SimulatedWsg50(host, port, part_width=self.part) as server:
            # Noted, not raised: an exception in the middle of a print cuts it short.
            # SIGINT too, which a shell's background job starts with ignored.
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda number, frame: ends.append(number))
            console.print(
                f"gripper: simulated WSG 50 at {server.host}:{server.port}; Ctrl-C "
                "ends it",
                highlight=False,
            )
            while not ends:
                time.sleep(0.1)
            console.print("gripper: ends")
        return 0
