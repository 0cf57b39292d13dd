"""Lines over a TCP socket, however they are cut into segments."""

import socket
import time

from dovetail.errors import GripperError
from dovetail.gripper.facts import LINE_MAX


class LineSocket:
    """A connection on which both sides speak in lines of ASCII."""

    def __init__(self, host: str, port: int, timeout: float) -> None:
        """Connect.

        Args:
            host: The other side's address.
            port: Its TCP port.
            timeout: Longest wait for the connection [s].

        Raises:
            GripperError: No gripper there; says what to check.
        """
        self._place = f"{host}:{port}"
        self._buffer = bytearray()
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except OSError as error:
            raise GripperError(
                f"no gripper at {self._place}: {error.strerror or error}; check its "
                "power, its address, its port (Command Interface in its web page), "
                "and that no other client is connected"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.is_open = True

    def send(self, line: str) -> None:
        """Send one line."""
        try:
            self._socket.sendall(f"{line}\n".encode("ascii"))
        except OSError as error:
            raise self._lost(error) from error

    def read(self, timeout: float) -> str:
        """Return the next line that is not empty, without its end.

        Raises:
            GripperError: None came in time [s], the connection is lost, or what came is
                no text.
        """
        deadline = time.monotonic() + timeout
        while True:
            while (end := self._buffer.find(b"\n")) >= 0:
                line = bytes(self._buffer[:end])
                del self._buffer[: end + 1]
                if text := self._decode(line).strip():
                    return text
            self._require_text()
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise GripperError(
                    f"the gripper at {self._place} did not answer within {timeout:g} s"
                )
            self._socket.settimeout(left)
            try:
                data = self._socket.recv(4096)
            except TimeoutError:
                continue
            except OSError as error:
                raise self._lost(error) from error
            if not data:
                raise self._lost(None)
            self._buffer += data

    def close(self) -> None:
        """Close the connection; harmless when repeated."""
        self.is_open = False
        self._socket.close()

    def _require_text(self) -> None:
        """Refuse what cannot become a line."""
        if self._buffer[:3] == b"\xaa\xaa\xaa":
            self.close()
            raise GripperError(
                f"the gripper at {self._place} speaks the binary protocol; select the "
                "text protocol in its web page (Command Interface)"
            )
        if len(self._buffer) > LINE_MAX:
            self.close()
            raise GripperError(
                f"the gripper at {self._place} sends lines of more than {LINE_MAX} "
                "bytes: is this a gripper?"
            )

    def _decode(self, line: bytes) -> str:
        try:
            return line.decode("ascii")
        except UnicodeDecodeError as error:
            raise GripperError(
                f"the gripper at {self._place} sends {line[:20]!r}, which is no text; "
                "select the text protocol in its web page (Command Interface)"
            ) from error

    def _lost(self, error: OSError | None) -> GripperError:
        self.close()
        reason = (error.strerror or error) if error else "the other side closed it"
        return GripperError(
            f"the connection to the gripper at {self._place} is lost: {reason}; "
            "connect again, and acknowledge the fast stop that may follow"
        )
