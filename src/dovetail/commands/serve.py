"""`dovetail serve`: the controller process; learners reach its arm over gRPC."""

import resource
from dataclasses import field, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.console import Console
from rich.text import Text

from dovetail.arms.address import parse_address
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.local_address import LocalAddress
from dovetail.commands.ended_by_signal import End, ended_by_signal
from dovetail.commands.unproven import cell_of, warn_of_arm
from dovetail.control.limits import DeclaredErrors
from dovetail.durations import format_ms
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.options import Delay, Period
from dovetail.printable import printable
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.settings import ranges_of, settings
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.workcell.cell_config import CellFile

if TYPE_CHECKING:
    from dovetail.rpc.offered_arm import OfferedArm

_STATUS_PERIOD = 0.5  # s


@settings()
class OfferedArmOptions:
    """The arm."""

    arm: str = "mujoco"
    """Arm: mujoco, bullet, drake, twin:NAME or fri://HOST:PORT?KEY=VALUE&..."""
    twin: str | None = None
    """Twin to offer: the same as --arm twin:NAME."""
    period: Period | None = None
    """Control period that a learner has to ask for: 1ms, 2ms, 2.5ms or 5ms; default the
    one in the arm's address, or else whichever it asks for."""
    realtime: bool = False
    """Ask the system for real-time priority and locked memory; fri:// only."""


@settings()
class OfferedCellOptions:
    """Robot, and the parts around it."""

    env: str = DEFAULT_ENV
    """Task whose parts stand in the cell: a Gymnasium id, or MODULE:ID of your own."""
    robot: str = DEFAULT_ROBOT
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    A learner needs the same."""
    task_options: dict[str, Any] = field(default_factory=dict)
    """Fields of the task; left out, they are its own."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where fixtures stand. A learner needs the
    same."""


@settings()
class ServiceOptions:
    """Address and certificates of the service."""

    listen: str = "127.0.0.1:50051"
    """Own address of the service, HOST:PORT; other than loopback needs certificates.
    On loopback a learner needs the token that is printed, or that of DOVETAIL_TOKEN."""
    cert: Path | None = None
    """Certificate of this service, PEM."""
    key: Path | None = None
    """Its private key, PEM, not encrypted."""
    client_ca: Path | None = None
    """Certificate of the authority that signs the clients' certificates, PEM."""


@settings()
class KnownErrors(DeclaredErrors):
    """Known differences between the arm and its model, which a learner must declare."""

    delay: Annotated[Delay, ranges_of(DeclaredErrors)["delay"]] = 0.0
    """Delay from a measurement to the torque it leads to [s], the period not counted.
    A learner that declares less is refused."""
    mass_error: Annotated[float, ranges_of(DeclaredErrors)["mass_error"]] = 0.0
    """Error of a link's mass, as a share [1]."""
    payload_error: Annotated[float, ranges_of(DeclaredErrors)["payload_error"]] = 0.0
    """Error of the payload's mass [kg]."""


@settings()
class Serve(OfferedArmOptions, KnownErrors, OfferedCellOptions, ServiceOptions):
    """Offer an arm to one learner at a time, and to watchers, until Ctrl-C."""

    def run(self, console: Console) -> int:
        """Serve until Ctrl-C or SIGTERM, then hold the arm and close."""
        try:
            from dovetail.rpc.security import certificates
            from dovetail.rpc.server import ArmServer
        except ModuleNotFoundError as error:
            raise MissingDependencyError(
                f"serving an arm needs gRPC ({error.name} is not installed): "
                f"{install_command('rpc')}"
            ) from error
        names = ("--cert", "--key", "--client-ca")
        files = certificates(
            cert=self.cert, key=self.key, ca=self.client_ca, names=names
        )

        def notify(line: str) -> None:
            now = datetime.now().astimezone()
            console.print(
                f"{now:%H:%M:%S} {line}", markup=False, highlight=False, soft_wrap=True
            )

        address = _address(self)
        arm = _offered(self, address, self)
        warn_of_arm(console, self.twin, self.arm, cell_of(self), self)
        _allow_many_connections()
        server = ArmServer(arm, self.listen, files, notify)
        with ended_by_signal() as end, server:
            how = "mutual TLS" if files else "this machine only, no TLS"
            learners = server.url
            if address.period is not None:
                mark = "&" if "?" in learners else "?"
                learners += f"{mark}period={format_ms(address.period)}"
            notify(f"{address.text} is served at {learners} ({how})")
            _show_status(console, server, end)
            notify("closing: the arm is held")
        notify(f"closed after {server.service.steps} steps")
        return 0


def _allow_many_connections() -> None:
    """Open as many files as the system allows: each connection is one.

    Otherwise a thousand silent connections keep a new one waiting for seconds.
    """
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _show_status(console: Console, server: Any, end: End) -> None:
    """Keep a status line on a terminal; elsewhere the events are enough."""
    if not console.is_terminal:
        end.wait()
        return
    with console.status("") as line:
        while True:
            line.update(Text(printable(server.service.status)))
            if end.wait(_STATUS_PERIOD):
                return


def _offered(
    around: OfferedCellOptions, address: ArmAddress, declared: DeclaredErrors
) -> "OfferedArm":
    from dovetail.rpc.offered_arm import OfferedArm

    cell = find_cell(around.env, around.robot, around.cell, **around.task_options)
    if isinstance(address, LocalAddress):
        address.make_plant(cell).close()  # what is wrong is said now, not to a learner
    return OfferedArm(address, cell, declared)


def _address(settings: OfferedArmOptions) -> ArmAddress:
    text = settings.arm
    if settings.twin is not None:
        if text != OfferedArmOptions.arm:
            raise ConfigError("--arm and --twin exclude each other; give one")
        text = f"twin:{settings.twin}"
    address = parse_address(text)
    if address.is_service:
        raise ConfigError(
            f"the arm at {text} is served already: learners can use that address; "
            "give mujoco, bullet, drake, twin:NAME or fri://HOST:PORT"
        )
    if settings.period is not None:
        period = address.control_period(settings.period, settings.period)
        address = replace(address, period=period)
    return address.with_realtime() if settings.realtime else address
