"""An arm that `dovetail serve` offers, here or on another machine, over gRPC.

Its address is `grpc://HOST:PORT?KEY=VALUE&...`.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self
from urllib.parse import unquote

import numpy as np

from dovetail.arms.arm import ArmFacts, ArmState, ArmTraits
from dovetail.arms.arm_address import ArmAddress, Keys
from dovetail.control.period import PERIODS
from dovetail.control.settings import ControllerSettings
from dovetail.errors import (
    ArmError,
    ConfigError,
    MissingDependencyError,
    install_command,
)
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.robots.same_robot import difference
from dovetail.types import Array, Vec7

if TYPE_CHECKING:
    from dovetail import _core
    from dovetail.rpc import dovetail_pb2 as pb
    from dovetail.rpc.client import Connection
    from dovetail.workcell.workcell import Workcell

PORT = 50051
LOOPBACK = ("localhost", "127.0.0.1", "::1")
_FILES = ("ca", "cert", "key")


@dataclass(frozen=True, kw_only=True)
class GrpcAddress(ArmAddress):
    """A service that owns an arm and its controller, here or on another machine."""

    is_service: ClassVar[bool] = True

    host: str
    """Machine on which the service runs."""
    port: int
    """TCP port."""
    ca: Path | None = None
    """Certificate of the authority that signed the service's certificate."""
    cert: Path | None = None
    """Own certificate."""
    key: Path | None = None
    """Own private key."""
    token: str | None = field(default=None, repr=False, compare=False)
    """Token of the service, which `text` leaves out: texts are kept and sent around.
    None is that of the environment variable DOVETAIL_TOKEN."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address.

        Raises:
            ConfigError: Unknown key (lists the known ones), a file that is none, or
                another machine without certificates.
        """
        text, token = split_token(text)  # messages show the text
        keys = Keys(text, PORT, (*_FILES, "token", "period", "margins"))
        files = {
            name: Path(given).expanduser()
            for name in _FILES
            if (given := keys.get(name)) is not None
        }
        if ("cert" in files) != ("key" in files):
            given, needed = ("cert", "key") if "cert" in files else ("key", "cert")
            raise ConfigError(
                f"arm {text!r} gives {given} without {needed}; give both or none"
            )
        if not files and keys.host not in LOOPBACK:
            raise ConfigError(
                f"arm {text!r}: {keys.host} is another machine and needs certificates: "
                "add ?ca=FILE&cert=FILE&key=FILE"
            )
        for name, path in files.items():
            if not path.is_file():
                raise ConfigError(f"arm {name} {str(path)!r} is no file")
        return cls(
            text=text,
            token=token or None,
            host=keys.host,
            port=keys.port,
            period=keys.period(PERIODS),
            margins=keys.choice("margins", ("hardware", "model")),
            ca=files.get("ca"),
            cert=files.get("cert"),
            key=files.get("key"),
        )

    def build(self, cell: "Workcell", settings: ControllerSettings) -> "RemoteArm":
        """Take the lease of the arm; see `RemoteArm`."""
        return RemoteArm(self, settings, robot=cell.loaded_robot(), cell=cell)

    def describe_ground(self) -> str:
        """Return where a result was found."""
        return f"the arm at {self.text.partition('?')[0]}"

    def with_approach(self) -> str:
        """Refuse it: who serves the arm says so."""
        raise ConfigError(
            f"approach is asked of {self.text!r}, which is not fri://; add "
            "approach=yes to the address of `dovetail serve`"
        )


class RemoteArm:
    """An arm in another process; moves bit for bit as it would here.

    It holds the service's lease from construction to `close`: another learner is
    refused meanwhile. The lease is an open stream: if this process dies, the service
    holds the arm at once.
    """

    def __init__(
        self,
        address: GrpcAddress,
        settings: ControllerSettings,
        *,
        robot: Robot | None = None,
        cell: "Workcell | None" = None,
        name: str | None = None,
        timeout: float = 30.0,
        reset_timeout: float = 120.0,
    ) -> None:
        """Connect, take the lease and set the arm up.

        Args:
            address: Where the service is, and the certificates for it.
            settings: Of the controller, made for the robot.
            robot: Controller's model that this program computes with; refused if the
                service has another one. None takes the service's.
            cell: What stands there; refused if the service has another part or
                clearance. None does not ask.
            name: The holder's name, as other clients see it; default the program.
            timeout: Longest wait for an answer, beyond a step's own duration [s].
            reset_timeout: Longest wait for a reset, which may be a motion [s].

        Raises:
            ArmError: No service there, or another client holds the arm.
            ConfigError: Settings, robot, cell or versions do not fit the service's.
            MissingDependencyError: grpcio is not installed.
        """
        _require_grpc()
        from dovetail.rpc.client import client_name
        from dovetail.rpc.step_stream import StepStream

        self._timeout, self._reset_timeout = timeout, reset_timeout
        self._seed: int | None = None
        self._closed = False
        self._lease = ""
        self._steps: StepStream | None = None
        self._connection = _connect(address, timeout)
        self._stub = self._connection.stub
        try:
            info = self._connection.info
            self.facts = ArmFacts(
                robot=_agreed_robot(info, robot),
                osc=settings.osc,
                limits=settings.limits,
                task=settings.task,
                period=settings.period,
                address=address.text,
                traits=ArmTraits(
                    is_simulated=False,
                    is_real_time=info.real_time,
                    places_fixture=info.places_fixture,
                    measures_contact=True,
                ),
            )
            self._steps = StepStream(self._connection, name or client_name(), timeout)
            self._lease = self._steps.lease
            self._configure(settings, cell)
        except BaseException:
            self.close()
            raise

    @property
    def info(self) -> "pb.Info":
        """The service's description of its arm, from when the connection was made."""
        return self._connection.info

    def seed(self, seed: int) -> None:
        """Start a simulation's noise again with the next reset."""
        self._seed = int(seed)

    def reset(self, q: Vec7, fixture: Pose) -> ArmState:
        """Go to q [rad], at rest, with the fixture at its pose; latch what is held.

        Raises:
            ConfigError: Wrong numbers; names them.
            ArmError: The service is gone, or the arm is stopped; says why.
        """
        from dovetail.rpc import dovetail_pb2 as pb
        from dovetail.rpc.messages import read_state, write_pose

        request = pb.ResetRequest(
            lease=self._lease, q=np.asarray(q, dtype=float).tolist(), seed=self._seed
        )
        self._seed = None
        write_pose(fixture, request.fixture)
        with self._connection.words("the reset failed"):
            report = self._stub.reset(request, timeout=self._reset_timeout)
        return read_state(report.state)

    def step(self, target: "_core.Target", duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], a whole number of periods.

        Raises:
            ConfigError: Wrong numbers, or not a whole number of periods.
            PlantError: The simulation behind the service diverged.
            ArmError: The service is gone, the lease is lost or the arm is stopped.
        """
        if self._closed or self._steps is None:
            raise ArmError("this arm is closed: make a new one")
        return self._steps.step(target, duration)

    def stop(self) -> None:
        """Hold the arm now; only `clear` lets it move again."""
        from dovetail.rpc import dovetail_pb2 as pb

        with self._connection.words("the stop failed"):
            request = pb.StopRequest(reason="stopped by its learner")
            self._stub.stop(request, timeout=self._timeout)

    def clear(self) -> None:
        """Let the arm move again after a stop."""
        from dovetail.rpc import dovetail_pb2 as pb

        with self._connection.words("the clear failed"):
            self._stub.clear(pb.Holder(lease=self._lease), timeout=self._timeout)

    def statistics(self) -> dict[str, Any]:
        """Return whether the service still answers; it tells its notes itself."""
        problem = "" if self._steps is None else self._steps.problem
        return {"notes": [], "problem": problem}

    def cycles(self) -> Array:
        """Return every control cycle since the last reset, columns CYCLE_COLUMNS.

        It comes from the service, so that it is whole even if a step was interrupted;
        of a long motion the service keeps the last 120,000 cycles.
        """
        from dovetail.rpc import dovetail_pb2 as pb
        from dovetail.rpc.messages import rows_from_bytes
        from dovetail.rpc.version import own_version

        with self._connection.words("the log cannot be read"):
            request = pb.LogRequest(version=own_version(), lease=self._lease)
            chunks = list(self._stub.get_log(request, timeout=self._timeout))
        blocks = [rows_from_bytes(chunk.rows) for chunk in chunks if chunk.rows]
        return np.vstack([np.empty((0, len(CYCLE_COLUMNS))), *blocks])

    def close(self) -> None:
        """Give the lease back, the arm held; harmless when repeated."""
        if self._closed:
            return
        self._closed = True
        if self._lease:
            from dovetail.rpc import dovetail_pb2 as pb
            from dovetail.rpc.calls import is_failed_call

            try:
                self._stub.release_lease(pb.Holder(lease=self._lease), timeout=2.0)
            except Exception as error:
                if not is_failed_call(error):  # else the service is gone: nothing held
                    raise
        if self._steps is not None:
            self._steps.close()
        self._connection.close()

    def _configure(self, settings: ControllerSettings, cell: "Workcell | None") -> None:
        from dovetail.rpc import dovetail_pb2 as pb
        from dovetail.rpc.settings import write_settings
        from dovetail.rpc.version import own_version

        request = pb.Configuration(lease=self._lease, version=own_version())
        write_settings(settings, request)
        if cell is not None:
            request.cell.name = cell.name
        with self._connection.words("the arm refuses its settings"):
            self._stub.configure(request, timeout=self._reset_timeout)


def _require_grpc() -> None:
    try:
        import dovetail.rpc.calls  # noqa: F401
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"an arm behind a service needs gRPC ({error.name} is not installed): "
            f"{install_command('rpc')}"
        ) from error


def _connect(address: GrpcAddress, timeout: float) -> "Connection":
    from dovetail.rpc.client import Connection
    from dovetail.rpc.security import certificates
    from dovetail.rpc.token import TOKEN

    files = certificates(
        cert=address.cert, key=address.key, ca=address.ca, names=("cert", "key", "ca")
    )
    token = None if files else address.token or os.environ.get(TOKEN)
    return Connection(address.host, address.port, files, timeout, token)


def _agreed_robot(info: "pb.Info", robot: Robot | None) -> Robot:
    """Return the robot that both ends compute with."""
    from dovetail.rpc.robot_message import read_robot

    offered = read_robot(info.robot)
    if robot is None:
        return offered
    if different := difference(robot, offered):
        raise ConfigError(
            f"the service's robot {offered.name} is not this program's {robot.name}: "
            f"{different}; start both with the same --robot, --cell and part",
            name="robot",
            value=offered.name,
        )
    return robot


def split_token(text: str) -> tuple[str, str]:
    """Return an address without the secret in it, and the secret, "" if it has none.

    Raises:
        ConfigError: It has two.
    """
    where, mark, keys = text.partition("?")
    kept, token = [], ""
    for pair in keys.split("&"):
        name, _, value = pair.partition("=")
        if unquote(name) == "token":
            if token:
                raise ConfigError(f"arm {where} gives token twice; give it once")
            token = unquote(value)
        else:
            kept.append(pair)
    return f"{where}{mark}{'&'.join(kept)}".removesuffix("?"), token
