"""A hostile client, frame by frame: calls that are begun and never completed."""

import selectors
import socket
import threading

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RST_STREAM, SETTINGS, PING, GOAWAY = 0, 1, 3, 4, 6, 7
ACK = END_STREAM = 1
END_HEADERS = 4
SLOW_DATA = b"\0\0\0\0\x64abc"
"""Prefix of a message of 100 bytes, and three of them."""


def frame(kind, flags, stream, payload=b""):
    head = len(payload).to_bytes(3, "big") + bytes([kind, flags])
    return head + stream.to_bytes(4, "big") + payload


def header(name, value):
    """A literal field without indexing, RFC 7541 6.2.2; texts below 127 bytes."""
    texts = [text.encode() for text in (name, value)]
    return b"\0" + b"".join(bytes([len(text)]) + text for text in texts)


def fields_of(method, token=None):
    fields = {
        ":method": "POST",
        ":scheme": "http",
        ":path": f"/dovetail.Arm/{method}",
        ":authority": "localhost",
        "content-type": "application/grpc",
        "te": "trailers",
    }
    if token:
        fields["authorization"] = f"Bearer {token}"
    return b"".join(header(name, value) for name, value in fields.items())


class HalfOpen:
    """Connections with calls on them that have headers and no message.

    It answers pings and acknowledges settings, so that no connection looks dead.
    """

    def __init__(self, address):
        host, port = address.rsplit(":", 1)
        self._address = host, int(port)
        self._sockets = selectors.DefaultSelector()
        self._buffers, self._streams = {}, {}
        self._lock = threading.Lock()
        self._closed = False
        self.ended = 0
        """Calls that the service has ended."""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def connect(self):
        connection = socket.create_connection(self._address, timeout=10)
        connection.sendall(PREFACE + frame(SETTINGS, 0, 0))
        self._buffers[connection], self._streams[connection] = b"", 1
        with self._lock:
            self._sockets.register(connection, selectors.EVENT_READ)
        return connection

    def call(self, connection, method, token=None, data=b""):
        """Begin a call; without data only its headers are sent."""
        stream = self._streams[connection]
        self._streams[connection] += 2
        sent = frame(HEADERS, END_HEADERS, stream, fields_of(method, token))
        if data:
            sent += frame(DATA, 0, stream, data)
        connection.sendall(sent)

    def close(self):
        self._closed = True
        self._reader.join(timeout=5)
        for connection in self._buffers:
            connection.close()

    def _read(self):
        while not self._closed:
            with self._lock:
                ready = self._sockets.select(timeout=0.0)
            if not ready:
                threading.Event().wait(0.01)
            for key, _ in ready:
                try:
                    received = key.fileobj.recv(65536)
                except OSError:
                    received = b""
                if not received:
                    self._sockets.unregister(key.fileobj)
                    continue
                self._buffers[key.fileobj] += received
                self._answer(key.fileobj)

    def _answer(self, connection):
        buffer = self._buffers[connection]
        while len(buffer) >= 9:
            size = int.from_bytes(buffer[:3], "big")
            if len(buffer) < 9 + size:
                break
            kind, flags, payload = buffer[3], buffer[4], buffer[9 : 9 + size]
            buffer = buffer[9 + size :]
            if kind in (PING, SETTINGS) and not flags & ACK:
                payload = payload if kind == PING else b""
                connection.sendall(frame(kind, ACK, 0, payload))
            self.ended += kind == RST_STREAM or (
                kind == HEADERS and bool(flags & END_STREAM)
            )
        self._buffers[connection] = buffer
