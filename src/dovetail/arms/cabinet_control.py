"""A simulated cabinet's control port: places the arm and the fixture."""

import json
import socket
import time
from typing import TYPE_CHECKING, Any

from dovetail.arms.arm_address import parse_endpoint
from dovetail.errors import ArmError, ConfigError
from dovetail.poses import Pose
from dovetail.printable import printable
from dovetail.reading import parse_json
from dovetail.robots.robot_text import write_robot_text
from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from dovetail.workcell.workcell import Workcell

_LONGEST = 1 << 20
_PAUSE = 0.05
"""Time between two tries to reach a cabinet that is still starting [s]."""


class CabinetControl:
    """One connection; it is opened again where it has broken."""

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        """Take the address; nothing is sent yet.

        Args:
            address: HOST:PORT.
            timeout: How long to wait for an answer [s].

        Raises:
            ConfigError: The address is not of that form.
        """
        self.address = address
        self._where = parse_endpoint(address, "control")
        self._timeout = timeout
        self._socket: socket.socket | None = None

    def request(self, do: str, **what: Any) -> dict[str, Any]:
        """Ask the cabinet to do something and return its answer.

        Raises:
            ArmError: It cannot be reached, or refuses.
        """
        line = json.dumps({"do": do, **what}).encode() + b"\n"
        try:
            answer = parse_json(self._exchange(line), "its answer")
        except (OSError, ConfigError) as error:
            self.close()
            raise ArmError(
                f"control port {self.address} of the simulated cabinet does not "
                f"answer: {error}; is `dovetail cabinet --control {self.address}` "
                "running? A real cabinet has none: leave control= out",
                "no_control",
            ) from error
        if not isinstance(answer, dict) or not answer.get("ok"):
            why = answer.get("error") if isinstance(answer, dict) else answer
            why = printable(str(why)).removeprefix(f"{do}: ")
            text = f"the cabinet refuses to {do}: {why}"
            raise ArmError(text, "refused")
        return answer

    def agree(self, cell: "Workcell", patience: float) -> None:
        """Refuse a cabinet that stands in for another robot, or has another cell file.

        Args:
            cell: Robot and cell file here.
            patience: How long to wait for a cabinet that is still starting [s].

        Raises:
            ArmError: It has, and names both; or it cannot be reached.
        """
        end = time.monotonic() + patience
        while True:
            try:
                self.request("agree", **_said_of(cell))
                return
            except ArmError as error:
                is_starting = isinstance(error.__cause__, ConnectionRefusedError)
                if not is_starting or time.monotonic() > end:
                    raise
            time.sleep(_PAUSE)

    def place(
        self,
        q: Vec7,
        fixture: Pose,
        seed: int | None = None,
        cell: "Workcell | None" = None,
    ) -> dict[str, Any]:
        """Put arm and fixture; the running motion ends and another begins.

        Args:
            q: Configuration [rad].
            fixture: Where the fixture is put.
            seed: Of the noise; None lets it go on.
            cell: Robot and cell file here, see `agree`; None is not compared.
        """
        more: dict[str, Any] = {} if seed is None else {"seed": int(seed)}
        if cell is not None:
            more |= _said_of(cell)
        return self.request(
            "place", q=list(map(float, q)), fixture=_pose(fixture), **more
        )

    def move_fixture(
        self, fixture: Pose, velocity: Vec3 | None = None
    ) -> dict[str, Any]:
        """Put the fixture; the arm stays. It then moves at a velocity [m/s]."""
        more = {} if velocity is None else {"velocity": list(map(float, velocity))}
        return self.request("fixture", fixture=_pose(fixture), **more)

    def grasp(self, offset: Pose) -> dict[str, Any]:
        """Displace the held part in the fingers, from the next `place` on."""
        return self.request("grasp", offset=_pose(offset))

    def push(self, force: Vec3, duration: float) -> dict[str, Any]:
        """Push the TCP with a force [N], world axes, for a duration [s]."""
        return self.request("push", force=list(map(float, force)), duration=duration)

    def _exchange(self, line: bytes) -> bytes:
        """Send a request and return its answer.

        The cabinet may have closed a connection that was silent for long: then it has
        not read the request, which is sent once more on a new one.
        """
        if self._socket is not None:
            try:
                if answer := self._ask(self._socket, line):
                    return answer
            except ConnectionError:
                pass
            self.close()
        self._socket = socket.create_connection(self._where, self._timeout)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if answer := self._ask(self._socket, line):
            return answer
        raise ConnectionError("it closed the connection")

    def _ask(self, connection: socket.socket, line: bytes) -> bytes:
        """Return the answer to a line; nothing if the connection ends before it."""
        connection.sendall(line)
        answer = b""
        while not answer.endswith(b"\n"):
            part = connection.recv(65536)
            if not part and not answer:
                return b""
            if not part or len(answer) > _LONGEST:
                raise OSError("it closed the connection")
            answer += part
        return answer

    def close(self) -> None:
        """Close the connection; harmless when repeated."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _said_of(cell: "Workcell") -> dict[str, str]:
    return {"cell": cell.own, "robot": write_robot_text(cell.robot)}


def _pose(pose: Pose) -> dict[str, list[float]]:
    return {
        "position": list(map(float, pose.position)),
        "quat_wxyz": list(map(float, pose.quat_wxyz)),
    }
