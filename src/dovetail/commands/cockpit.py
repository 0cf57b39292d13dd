"""`dovetail cockpit`: see the arm in the browser, start and stop it, touch it."""

from dataclasses import field
from pathlib import Path
from typing import Any

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.cockpit.choice import Choice
from dovetail.cockpit.server import PORT, PageServer, open_server
from dovetail.commands.demo import DEFAULT_TWIN
from dovetail.commands.ended_by_signal import ended_by_signal
from dovetail.commands.unproven import note_cell, warn_of_arm
from dovetail.control.limits import DeclaredErrors
from dovetail.errors import ConfigError
from dovetail.files import dated_folder, require_writable
from dovetail.options import Period, Placement
from dovetail.settings import settings
from dovetail.tasks.shipped import DEFAULT_POLICY
from dovetail.workcell.cell_config import CellFile


@settings()
class ShownPolicyOptions:
    """The policy that runs."""

    policy: str = DEFAULT_POLICY
    """Policy: the name of a shipped one, a file, or none."""
    env: str | None = None
    """Environment of the policy; needed for one of your own, MODULE:ID. --part FILE has
    its own task."""
    task_options: dict[str, Any] = field(default_factory=dict)
    """Fields of the task; left out, they are the policy's."""
    tare: bool | None = None
    """Measure at each reset the weight that gravity compensation misses. Default as in
    `evaluate`."""
    accept_contact: bool = False
    """Yes to a policy on a robot whose contact settings are laxer than the defaults."""


@settings()
class ShownPlaceOptions:
    """Twin or arm to run on, one of the two."""

    twin: str | None = None
    """Twin to run on: a shipped one's name or a .toml file; default medium."""
    arm: str | None = None
    """Arm to run on: mujoco, bullet, drake, twin:NAME, fri://HOST:PORT, grpc://HOST:PORT."""


@settings()
class ShownCellOptions:
    """Robot, tracker, control period and fixture."""

    robot: str | None = None
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    Default the policy's."""
    tracker: str | None = None
    """Tracker of the fixture: truth, delayed or noisy; MODULE:CLASS is one of your
    own."""
    period: Period | None = None
    """Control period: 1ms, 2ms, 2.5ms or 5ms; default that of the policy's training."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where fixtures stand; default that of the
    policy's training."""
    fixture: Placement = None
    """Place of the fixture: x y z [m] of its frame and yaw [rad], world axes; two more
    numbers are its tilts B C [rad], about y and x. Default the task's first trial pose.
    Needed for an arm that cannot move it."""


@settings()
class PageOptions:
    """The page."""

    port: int = PORT
    """Port of the page, on this machine alone; 0 is any free one."""
    keep_running: bool = False
    """Let the arm go on when the driver closes the page; otherwise it is held."""
    logs: Path | None = None
    """Folder for the Episode logs; default a new one, by the time, in cockpit-logs."""


@settings()
class Cockpit(
    ShownPolicyOptions, ShownPlaceOptions, ShownCellOptions, DeclaredErrors, PageOptions
):
    """Show an arm in the browser: start, stop, pull it, move its fixture, replay it."""

    def run(self, console: Console) -> int:
        """Show the page until Ctrl-C or SIGTERM, then hold the arm and close."""
        self.show(console, self.logs or dated_folder("cockpit-logs"))
        return 0

    def show(self, console: Console, logs: Path) -> list[Path]:
        """Show the page until it is ended; return the demonstrations that were kept.

        Raises:
            ConfigError: Nothing can be written into the folder of the logs.
        """
        from dovetail.cockpit.page import Page
        from dovetail.cockpit.session import Session

        require_writable(logs, "--logs")
        choice = self.choice()
        warn_of_arm(console, None, choice.place, declared=self)
        session = Session(choice, logs=logs, fixture=self.fixture)
        try:
            note_cell(console, session.core.cell, None, choice.place)
            server = open_server(self.port)
            try:
                keep_running = self.keep_running
                page = Page(server, session, keep_running=keep_running)
                serve_page(server, console, is_driven=True)
                page.close()
            finally:
                session.close()
                server.stop()
        finally:
            session.close()
        for file in session.logger.files:
            console.print(f"  {file}", highlight=False, soft_wrap=True)
        if session.logger.problem:
            console.print(session.logger.problem, soft_wrap=True)
        return session.logger.demonstrations

    def choice(self) -> Choice:
        """Return what runs at first.

        Raises:
            ConfigError: Both a twin and an arm.
        """
        if self.twin is not None and self.arm is not None:
            raise ConfigError("--twin and --arm exclude each other; give one")
        twin = self.twin or DEFAULT_TWIN
        if Path(twin).suffix == ".toml":
            twin = str(Path(twin).expanduser().absolute())
        names = ("robot", "tracker", "period", "cell")
        given = {name: vars(self)[name] for name in names}
        settings: dict[str, Any] = {k: v for k, v in given.items() if v is not None}
        settings |= self.task_options
        settings |= self.declared_errors()
        if self.tare is not None:
            settings["tare"] = self.tare
        place = self.arm or f"twin:{twin}"
        parse_address(place)
        return Choice(
            policy=self.policy,
            place=place,
            env=self.env,
            settings=settings,
            accept_contact=self.accept_contact,
        )


COMMON = (
    *("policy", "twin", "arm", "env", "task_options", "robot", "tracker", "period"),
    *("cell", "fixture", "accept_contact", "port", "keep_running", "logs"),
)
"""Settings that `--help` lists."""


def serve_page(server: PageServer, console: Console, *, is_driven: bool) -> None:
    """Say where the page is, and wait until it is ended.

    Args:
        server: The page's.
        console: Where it is said.
        is_driven: Say the address that only watches, too.
    """
    with ended_by_signal() as end:
        lines = [f"the page is {server.address}", "Ctrl-C ends it"]
        if is_driven:
            lines[1:1] = [
                "  who knows that address may drive: keep it to yourself",
                f"to watch, and stop: {server.watch_address}",
            ]
        console.print("\n".join(lines), highlight=False, soft_wrap=True, markup=False)
        while not end.wait(0.5):
            pass
