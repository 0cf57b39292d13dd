"""`dovetail serve`: the controller process; learners reach its arm over gRPC."""

import signal
import threading
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from rich.console import Console

from dovetail.arms.address import (
    ArmAddress,
    FriAddress,
    GrpcAddress,
    PlantAddress,
    TwinAddress,
    parse_address,
    period_of,
    places_fixture,
)
from dovetail.arms.arm import Arm
from dovetail.control.period import require_period
from dovetail.control.period_option import Period
from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.plants.plant import DynamicsConfig, Plant, make_plant
from dovetail.scene import PegShape, SceneConfig

if TYPE_CHECKING:
    from dovetail.rpc.arm_host import ArmBuilder
    from dovetail.rpc.settings import Settings

_STATUS_PERIOD = 0.5  # s


@dataclass(frozen=True, kw_only=True)
class Serve:
    """Offer an arm to one learner at a time, and to watchers, until Ctrl-C."""

    arm: str = "mujoco"
    """Arm: mujoco, bullet, twin:NAME or fri://HOST:PORT?KEY=VALUE&..."""
    twin: str | None = None
    """Twin to offer: the same as --arm twin:NAME."""
    period: Period | None = None
    """Control period that a learner has to ask for: 1ms, 2ms, 2.5ms or 5ms; default the
    one in the arm's address, or else whichever it asks for."""
    peg: PegShape = "square"
    """Shape of peg and hole: square, triangle or round."""
    clearance: float = 0.0005
    """Gap between peg and hole on each side [m]."""
    listen: str = "127.0.0.1:50051"
    """Where to listen; anything but this machine's loopback needs certificates."""
    cert: Path | None = None
    """Certificate of this service, PEM."""
    key: Path | None = None
    """Its private key, PEM, not encrypted."""
    client_ca: Path | None = None
    """Certificate of the authority that signs the clients' certificates, PEM."""
    realtime: bool = False
    """Ask the system for real-time priority and locked memory; fri:// only."""

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
        end = threading.Event()

        def notify(line: str) -> None:
            now = datetime.now().astimezone()
            console.print(
                f"{now:%H:%M:%S} {line}", markup=False, highlight=False, soft_wrap=True
            )

        builder = _builder(self)
        try:
            server = ArmServer(builder, self.listen, files, notify)
        except BaseException:
            builder.close()
            raise
        before = {
            number: signal.signal(number, lambda *_: end.set())
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        try:
            with server:
                how = "mutual TLS" if files else "this machine only, no TLS"
                notify(f"{builder.name} is served at grpc://{server.address} ({how})")
                _show_status(console, server, end)
                notify("closing: the arm is held")
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
        notify(f"closed after {server.service.steps} steps")
        return 0


def _show_status(console: Console, server: Any, end: threading.Event) -> None:
    """Keep a status line on a terminal; elsewhere the events are enough."""
    if not console.is_terminal:
        end.wait()
        return
    with console.status(server.service.status) as line:
        while not end.wait(_STATUS_PERIOD):
            line.update(server.service.status)


def _builder(settings: Serve) -> "ArmBuilder":
    from dovetail.rpc.builders import LocalBuilder

    address = _address(settings)
    scene = SceneConfig(peg=settings.peg, clearance=settings.clearance)
    if isinstance(address, FriAddress):
        return _fri_builder(settings.arm, address, scene)
    period = None if settings.period is None else require_period(settings.period)
    if isinstance(address, PlantAddress):
        plant = make_plant(address.engine, scene, DynamicsConfig())
        return LocalBuilder(address.engine, plant, period)
    assert isinstance(address, TwinAddress)
    from dovetail.plants.twin import TwinPlant, load_twin

    twin = cast("Plant", TwinPlant(load_twin(address.twin), scene))
    return LocalBuilder(f"twin:{address.twin}", twin, period)


def _address(settings: Serve) -> ArmAddress:
    text = settings.arm
    if settings.twin is not None:
        if text != Serve.arm:
            raise ConfigError("--arm and --twin exclude each other; give one")
        text = f"twin:{settings.twin}"
    address = parse_address(text)
    if isinstance(address, GrpcAddress):
        raise ConfigError(
            f"the arm at {text} is served already: learners can use that address; "
            "give mujoco, bullet, twin:NAME or fri://HOST:PORT"
        )
    if isinstance(address, FriAddress) and settings.period is not None:
        period = period_of(address, settings.period, settings.period)
        address = replace(address, period=period)
    if not settings.realtime:
        return address
    if not isinstance(address, FriAddress):
        raise ConfigError(
            f"--realtime is for fri:// arms: {text} is a simulation, which has no "
            "clock to keep"
        )
    return replace(address, realtime=True)


def _fri_builder(name: str, address: FriAddress, scene: SceneConfig) -> "ArmBuilder":
    from dovetail.envs.arm_setup import build_fri_arm
    from dovetail.rpc.builders import RebuiltArm, require_offered

    def make(s: "Settings") -> Arm:
        require_offered(name, address.period, s)
        return build_fri_arm(address, scene, s.osc, s.limits, s.task, s.period)

    return RebuiltArm(
        name,
        scene,
        make,
        is_real_time=address.clock == "wall",
        places_fixture=places_fixture(address),
    )
