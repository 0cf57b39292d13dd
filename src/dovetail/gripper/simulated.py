"""A simulated WSG 50 on a TCP port, true to the text protocol where it is known.

Where the protocol's behaviour is not public, this gripper chooses: a motion before
homing answers "not initialised", one after a fast stop "access denied".
"""

import os
import selectors
import socket
import threading
import time
from types import TracebackType
from typing import Self

from dovetail.errors import GripperError
from dovetail.gripper.facts import LINE_MAX
from dovetail.gripper.fingers import Fingers
from dovetail.gripper.replies import Replies

_TICK = 0.002


class SimulatedWsg50:
    """Serves one client at a time, from a thread of its own."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        part_width: float | None = None,
        speed_up: float = 1.0,
    ) -> None:
        """Open the port; `start` serves it.

        Args:
            host: Address to listen at.
            port: TCP port; 0 takes a free one.
            part_width: Width of the part between the fingers [m]; None is no part.
            speed_up: How much faster than real motions are.

        Raises:
            GripperError: The port is in use or not permitted.
        """
        self.fingers = Fingers(part_width=part_width, speed_up=speed_up)
        self.segment_size = 4096
        """Bytes per segment sent: 1 cuts every line to pieces."""
        self.is_mute = False
        """Answer nothing, as a gripper that hangs."""
        self.num_fast_stops = 0
        """Clients that vanished without the goodbye."""
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise GripperError(
                f"cannot listen at {host}:{port}: "
                f"{os.strerror(error.errno or 0)}; choose another "
                "port, or end the program that has it (ports below 1024 need rights)"
            ) from error
        self.host, self.port = self._listener.getsockname()[:2]
        self._client: socket.socket | None = None
        self._buffer = bytearray()
        self._replies = Replies(self.fingers)
        self._outgoing: list[bytes] = []
        self._lock = threading.Lock()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self.run, daemon=True)

    def __enter__(self) -> Self:
        """Serve."""
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End."""
        self.close()

    def start(self) -> None:
        """Serve in a thread."""
        self._thread.start()

    def close(self) -> None:
        """End the service; harmless when repeated."""
        self._is_over.set()
        if self._thread.is_alive():
            self._thread.join()
        self._drop()
        self._listener.close()

    def send(self, data: bytes) -> None:
        """Send bytes that no command asked for, as a fault of the line would."""
        with self._lock:
            self._outgoing.append(data)

    def run(self) -> None:
        """Serve until `close`; what `start` runs in its thread."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            while not self._is_over.is_set():
                for key, _ in selector.select(_TICK):
                    self._serve(selector, key.fileobj)
                self._tell(selector)

    def _serve(self, selector: selectors.BaseSelector, ready: object) -> None:
        if ready is self._listener:
            client, _ = self._listener.accept()
            if self._client is not None:
                client.close()  # one client at a time
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client
            selector.register(client, selectors.EVENT_READ)
            return
        try:
            data = self._client.recv(4096) if self._client else b""
        except OSError:
            data = b""
        if not data:
            self._lose(selector)
            return
        self._buffer += data
        while (end := self._buffer.find(b"\n")) >= 0:
            line = bytes(self._buffer[:end]).decode("ascii", "replace").strip()
            del self._buffer[: end + 1]
            if line:
                self._answer(selector, line)
        if len(self._buffer) > LINE_MAX:
            del self._buffer[:]
            self._answer(selector, "?")

    def _answer(self, selector: selectors.BaseSelector, line: str) -> None:
        if line == "BYE()":
            self._transmit(["ACK BYE"])
            self._forget(selector)
        else:
            self._transmit(self._replies.to(line))

    def _tell(self, selector: selectors.BaseSelector) -> None:
        """Send what comes by itself: ends of motions, values, and injected bytes."""
        self._transmit(self._replies.spontaneous(time.monotonic()))
        with self._lock:
            outgoing, self._outgoing = self._outgoing, []
        for data in outgoing:
            self._write(data)

    def _transmit(self, lines: list[str]) -> None:
        if lines and not self.is_mute:
            self._write("".join(f"{line}\n" for line in lines).encode("ascii"))

    def _write(self, data: bytes) -> None:
        if self._client is None:
            return
        try:
            for start in range(0, len(data), self.segment_size):
                self._client.sendall(data[start : start + self.segment_size])
        except OSError:
            pass  # the next read finds out that it is gone

    def _lose(self, selector: selectors.BaseSelector) -> None:
        """A client went without the goodbye."""
        self._forget(selector)
        self.num_fast_stops += 1
        self.fingers.fast_stop()

    def _forget(self, selector: selectors.BaseSelector) -> None:
        if self._client is not None:
            selector.unregister(self._client)
        self._drop()
        self._replies.clear()
        self._buffer.clear()

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
