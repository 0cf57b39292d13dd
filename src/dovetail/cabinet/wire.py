"""The cabinet's side of the codec: one reused message out, commands in."""

from typing import TYPE_CHECKING, Any, NamedTuple

from dovetail import _core
from dovetail.cabinet.protocol import (
    ControlMode,
    DriveState,
    IoType,
    Overlay,
    SessionState,
)

if TYPE_CHECKING:
    from dovetail.cabinet.robot_controller import RobotController

_AUT = 2  # operation mode: automatic


class Command(NamedTuple):
    """A client's command, as the controller reads it; None where absent."""

    sequence: int
    """Counter of the command."""
    reflected: int
    """Counter of the message that it answers."""
    q: list[float] | None
    """Position [rad]."""
    tau: list[float] | None
    """Torque overlay [Nm]."""
    wrench: list[float] | None
    """Wrench feed-forward [N, Nm]."""
    io: tuple[tuple[str, int, int, Any], ...]
    """Writes: name, type, direction, value."""
    transformations: tuple[tuple[str, list[float]], ...]
    """Answers to requested transformations: name and numbers."""


class Wire:
    """Encodes the controller's state, decodes commands; one version."""

    def __init__(self, controller: "RobotController") -> None:
        """Prepare the message's constant parts."""
        config = controller.config
        self._controller = controller
        self._version = _core.fri_version(config.version)
        self._has_q_commanded = config.version == "1.15"
        message = _core.FriMonitoring()
        message.num_joints = 7
        message.send_period_ms = config.period_ms
        message.receive_multiplier = config.receive_multiplier
        message.operation_mode = _AUT
        message.requested_transformations = [
            _core.FriTransformation(name) for name in config.transformations
        ]
        self._message = message
        self._last: tuple[Any, ...] = ()

    def encode(self, stamp: tuple[int, int]) -> bytes:
        """Return the datagram of the controller's present state.

        Args:
            stamp: Unix time of the cabinet [s, ns].
        """
        controller, message = self._controller, self._message
        body, torques = controller.body, controller.config
        now = (
            controller.state,
            controller.quality_value,
            controller.drive_state,
            controller.safety,
            controller.policy.q_ipo,
        )
        if now != self._last:
            self._last = now
            self._fill_slow(message)
        message.sequence = controller.sequence
        message.reflected = controller.reflected
        message.stamp = stamp
        message.tracking = controller.tracking
        message.q_measured = body.q
        sensors = body.sensors
        message.tau_measured = torques.measured_sign * sensors.joint
        message.tau_external = torques.external_sign * sensors.external
        is_overlay = torques.commanded_torque == "overlay"
        tau = body.overlay if is_overlay else body.tau + body.gravity
        message.tau_commanded = torques.commanded_sign * tau
        if self._has_q_commanded:
            message.q_commanded = controller.q_commanded
        if controller.config.io:
            message.io = self._signals()
        return message.encode(self._version)

    def _fill_slow(self, message: Any) -> None:
        """Write what changes only when the session does."""
        controller = self._controller
        drives = controller.drive_state
        is_commanding = controller.state >= SessionState.COMMANDING_WAIT
        message.state = int(controller.state)
        message.quality = int(controller.quality_value)
        message.safety = int(controller.safety)
        message.drive_states = [int(drives)] * 7
        held = ControlMode.JOINT_IMPEDANCE
        if controller.config.mode == "position":
            held = ControlMode.POSITION
        is_off = drives is DriveState.OFF
        message.control_mode = int(ControlMode.NO_CONTROL if is_off else held)
        message.command_mode = int(controller.command_mode)
        is_wrench = controller.config.mode == "wrench"
        kind = Overlay.CARTESIAN if is_wrench else Overlay.JOINT
        message.overlay = int(kind if is_commanding else Overlay.NONE)
        message.ipo_q = controller.q_ipo

    def _signals(self) -> list[Any]:
        table = self._controller.signals
        entries = []
        for name, signal in table.signals.items():
            value = table.values[name]
            is_analog = signal.type is IoType.ANALOG
            field: dict[str, Any] = (
                {"analog": float(value)} if is_analog else {"digital": int(value)}
            )
            entries.append(
                _core.FriIo(name, int(signal.type), int(signal.direction), **field)
            )
        return entries

    def decode(self, payload: bytes) -> Command:
        """Read a datagram.

        Raises:
            ValueError: It is no command of this version, with the reason.
        """
        command = _core.FriCommand.decode(self._version, payload)
        q, tau, wrench = command.q, command.tau, command.wrench
        return Command(
            command.sequence,
            command.reflected,
            None if q is None else q.tolist(),
            None if tau is None else tau.tolist(),
            None if wrench is None else wrench.tolist(),
            tuple(
                (io.name, int(io.type), int(io.direction), _io_value(io))
                for io in command.io
            ),
            tuple((t.name, list(t.values)) for t in command.transformations),
        )


def _io_value(io: Any) -> Any:
    return io.analog if int(io.type) == IoType.ANALOG else io.digital
