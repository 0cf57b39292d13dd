"""The control port: a line of JSON in, a line of JSON out, over TCP.

The first line that is no JSON object ends its connection: a web page can have a browser
send an HTTP request here, and nothing behind that request's first line is read.
"""

import json
import selectors
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from dovetail.cabinet.config import Endpoint
from dovetail.cabinet.udp_port import bind_error, resolve
from dovetail.errors import ConfigError
from dovetail.page import finite
from dovetail.reading import parse_json

MAX_LINE = 65536
"""Longest request [bytes]."""
MAX_LINES = 100
"""Requests of a connection that may wait: while it is answered no other one is."""
MAX_CONNECTIONS = 16
"""Connections at one time. One more takes the place of the one silent for longest, and
of one that never asked anything before those that did."""
SILENCE_MAX = 5.0
"""A connection that has not asked anything for so long is closed [s]."""
_LOOK = 1.0
"""Time between two looks for connections that were silent for too long [s]."""


class _Client:
    """One connection, and what has come of its next request."""

    def __init__(self, connection: socket.socket) -> None:
        """Begin without a request."""
        self.connection = connection
        self.buffer = bytearray()
        self.has_asked = False
        self.heard = time.monotonic()

    @property
    def worth(self) -> tuple[bool, float]:
        """The least goes first where there are too many."""
        return self.has_asked, self.heard


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
        self._clients: dict[socket.socket, _Client] = {}
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close every connection and the port; harmless when repeated."""
        if self._thread.is_alive():
            self._stop.send(b"x")
            self._thread.join()
        for opened in (self._listener, self._stop, self._stopped, *self._clients):
            opened.close()
        self._selector.close()

    def _serve(self) -> None:
        while True:
            is_any_silent = not all(c.has_asked for c in self._clients.values())
            for key, _ in self._selector.select(_LOOK if is_any_silent else None):
                if key.fileobj is self._stopped:
                    return
                if key.fileobj is self._listener:
                    self._accept()
                elif key.fileobj in self._clients:  # not dropped meanwhile
                    self._read(key.data)
            oldest = time.monotonic() - SILENCE_MAX
            for client in list(self._clients.values()):
                if not client.has_asked and client.heard < oldest:
                    self._drop(client)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        if len(self._clients) >= MAX_CONNECTIONS:
            self._drop(min(self._clients.values(), key=lambda client: client.worth))
        connection.setblocking(False)  # an answer that is not fetched blocks nothing
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = self._clients[connection] = _Client(connection)
        self._selector.register(connection, selectors.EVENT_READ, client)

    def _drop(self, client: _Client) -> None:
        self._selector.unregister(client.connection)
        del self._clients[client.connection]
        client.connection.close()

    def _read(self, client: _Client) -> None:
        try:
            data = client.connection.recv(MAX_LINE)
            client.buffer += data
            if not data or not self._answer_all(client):
                self._drop(client)
        except OSError:
            self._drop(client)

    def _answer_all(self, client: _Client) -> bool:
        """Answer every line that has come; return whether to go on listening."""
        *lines, client.buffer = client.buffer.split(b"\n")
        if max(map(len, (*lines, client.buffer))) > MAX_LINE:
            return self._refuse(client, f"a request has more than {MAX_LINE} bytes")
        if len(lines) > MAX_LINES:
            return self._refuse(client, f"more than {MAX_LINES} requests wait")
        for line in lines:
            if not line.strip():
                continue
            try:
                request = parse_json(bytes(line), "the line")
            except ConfigError as error:
                return self._refuse(client, str(error))
            if not isinstance(request, dict):
                return self._refuse(client, "the line is no JSON object")
            self._reply(client, self._answer(request))
            client.has_asked, client.heard = True, time.monotonic()
        return True

    def _refuse(self, client: _Client, error: str) -> bool:
        self._reply(client, {"ok": False, "error": f"{error}; connection closed"})
        return False

    def _reply(self, client: _Client, answer: dict[str, Any]) -> None:
        line = json.dumps(finite(answer), allow_nan=False)
        client.connection.sendall(line.encode() + b"\n")
