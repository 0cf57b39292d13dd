"""The control port: a line of JSON in, a line of JSON out, over TCP."""

import json
import selectors
import socket
import threading
from collections.abc import Callable
from typing import Any

from dovetail.cabinet.config import Endpoint
from dovetail.cabinet.udp_port import bind_error, resolve

MAX_LINE = 65536
"""Longest request [bytes]."""
MAX_CONNECTIONS = 16
"""Connections at one time; more are closed at once."""
_SEND_TIME = 2.0
"""How long an answer may take to leave [s]."""


class ControlPort:
    """Serves several connections in one thread of its own."""

    def __init__(self, bind: Endpoint, answer: Callable[[Any], dict[str, Any]]) -> None:
        """Open the port and begin to serve.

        Args:
            bind: Own address; port 0 takes a free one.
            answer: Does what a request asks; called in the port's thread.

        Raises:
            ConfigError: The address is in use or not ours.
        """
        self._answer = answer
        own = resolve(bind, "control port")
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(own)
            self._listener.listen()
        except OSError as error:
            self._listener.close()
            raise bind_error(bind, "control port", error) from error
        self.address = Endpoint(*self._listener.getsockname()[:2])
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, None)
        self._stop, self._stopped = socket.socketpair()
        self._selector.register(self._stopped, selectors.EVENT_READ, None)
        self._buffers: dict[socket.socket, bytearray] = {}
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close every connection and the port; harmless when repeated."""
        if self._thread.is_alive():
            self._stop.send(b"x")
            self._thread.join()
        for opened in (self._listener, self._stop, self._stopped, *self._buffers):
            opened.close()
        self._selector.close()

    def _serve(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is self._stopped:
                    return
                if key.fileobj is self._listener:
                    self._accept()
                elif isinstance(key.fileobj, socket.socket):
                    self._read(key.fileobj)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        if len(self._buffers) >= MAX_CONNECTIONS:
            connection.close()
            return
        connection.settimeout(_SEND_TIME)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffers[connection] = bytearray()
        self._selector.register(connection, selectors.EVENT_READ, None)

    def _drop(self, connection: socket.socket) -> None:
        self._selector.unregister(connection)
        del self._buffers[connection]
        connection.close()

    def _read(self, connection: socket.socket) -> None:
        buffer = self._buffers[connection]
        try:
            data = connection.recv(MAX_LINE)
            if not data:
                self._drop(connection)
                return
            buffer += data
            while (end := buffer.find(b"\n")) >= 0:
                line = bytes(buffer[:end])
                del buffer[: end + 1]
                if line.strip():
                    self._reply(connection, self._answer_line(line))
            if len(buffer) > MAX_LINE:
                error = f"a request has more than {MAX_LINE} bytes; connection closed"
                self._reply(connection, {"ok": False, "error": error})
                self._drop(connection)
        except OSError:
            self._drop(connection)

    def _answer_line(self, line: bytes) -> dict[str, Any]:
        try:
            if len(line) > MAX_LINE:
                raise ValueError(f"more than {MAX_LINE} bytes")
            request = json.loads(line)
        except (ValueError, RecursionError) as error:
            return {"ok": False, "error": f"the line is no JSON object: {error}"}
        return self._answer(request)

    def _reply(self, connection: socket.socket, answer: dict[str, Any]) -> None:
        connection.sendall(json.dumps(answer).encode() + b"\n")
