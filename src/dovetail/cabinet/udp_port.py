"""UDP port of the cabinet: datagrams to and from its client only."""

import errno
import socket
from collections import Counter

from dovetail.cabinet.config import Endpoint
from dovetail.errors import ConfigError

_MAX_DATAGRAM = 1500


def resolve(endpoint: Endpoint, name: str) -> tuple[str, int]:
    """Return an endpoint's IPv4 address.

    Raises:
        ConfigError: The host has none.
    """
    try:
        found = socket.getaddrinfo(*endpoint, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise ConfigError(
            f"{name} {endpoint} has no IPv4 address: {error}; give a number as in "
            "192.170.10.1, or check the name"
        ) from error
    host, port = found[0][4][:2]
    return str(host), int(port)


def bind_error(endpoint: Endpoint, name: str, error: OSError) -> ConfigError:
    """Say why an address cannot be bound, and what to do."""
    if error.errno == errno.EADDRINUSE:
        advice = (
            "the port is in use: stop the program that holds it (another cabinet?), or "
            "give another port"
        )
    elif error.errno in (errno.EACCES, errno.EPERM):
        advice = "no permission: give a port from 1024 up"
    elif error.errno == errno.EADDRNOTAVAIL:
        advice = "this machine has no such address: see `ip addr`, or give 0.0.0.0"
    else:
        advice = str(error)
    return ConfigError(f"{name} {endpoint} cannot be opened: {advice}")


class UdpPort:
    """Sends to the client; gives what comes from the client's address and port.

    Two sockets share the address. The kernel gives the client's datagrams to the one
    that is connected to it and everybody else's to the other, so that strangers can
    neither be taken for the client nor fill the buffer its commands wait in.
    """

    def __init__(
        self, bind: Endpoint, client: Endpoint, counts: "Counter[str]"
    ) -> None:
        """Open the port.

        Args:
            bind: Own address; port 0 takes a free one.
            client: The client's address.
            counts: Where foreign, refused and oversized datagrams are counted.

        Raises:
            ConfigError: The address is in use, not ours, or has no IPv4 number.
        """
        own = resolve(bind, "UDP address")
        self.client = resolve(client, "client")
        self.is_refused = False
        """True if the last `receive` found no listener at the client's address."""
        self._counts = counts
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(own)  # fails where another program has the port
                own = probe.getsockname()
            self._stray = self._open(own)
            self._socket = self._open(own)
        except OSError as error:
            raise bind_error(bind, "UDP address", error) from error
        try:
            self._socket.connect(self.client)
        except OSError as error:
            self.close()
            raise ConfigError(
                f"client {client} cannot be reached from {bind}: {error}; bind to an "
                "address of the network that the client is in"
            ) from error
        while self.receive() is not None:
            pass  # came before the connection, from any sender
        self.address = Endpoint(*self._socket.getsockname()[:2])

    @staticmethod
    def _open(address: tuple[str, int]) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind(address)
        except OSError:
            opened.close()
            raise
        opened.setblocking(False)
        return opened

    def fileno(self) -> int:
        """Return the number of the client's socket, for select."""
        return self._socket.fileno()

    def send(self, payload: bytes) -> None:
        """Send a datagram; a client that does not listen is no error."""
        for _ in range(2):  # an earlier refusal is reported in place of sending
            try:
                self._socket.send(payload)
            except ConnectionRefusedError:
                self._counts["refused"] += 1
            except OSError:
                self._counts["unsent"] += 1
                return
            else:
                return

    def receive(self) -> bytes | None:
        """Return the client's next datagram, or None where there is none."""
        self.is_refused = False
        try:
            payload = self._socket.recv(_MAX_DATAGRAM + 1)
        except ConnectionRefusedError:
            self._counts["refused"] += 1
            self.is_refused = True
            return None
        except OSError:
            return None
        if len(payload) > _MAX_DATAGRAM:
            self._counts["undecodable"] += 1
            return None
        return payload

    def count_foreign(self) -> None:
        """Count and drop what others have sent, as far as their buffer held it."""
        for _ in range(256):
            try:
                self._stray.recv(1)
            except OSError:
                return
            self._counts["foreign"] += 1

    def close(self) -> None:
        """Close the sockets; harmless when repeated."""
        self._socket.close()
        self._stray.close()
