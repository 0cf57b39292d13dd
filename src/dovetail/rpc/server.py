"""The server process's side: a port, the service behind it, and an orderly end."""

import errno
import os
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Self

import grpc

from dovetail.errors import ConfigError
from dovetail.rpc.arm_host import ArmBuilder, ArmHost
from dovetail.rpc.arm_service import LASTING_MAX, ArmService
from dovetail.rpc.calls import KEEPALIVE, MESSAGE_MAX, REQUEST_MAX, make_handler
from dovetail.rpc.security import Certificates, server_credentials, split_address

LISTEN = "127.0.0.1:50051"
"""Where the service listens if nothing else is asked for: this machine only."""

# So that a stop finds a thread. A short call whose request never comes holds one, too,
# until its connection ends; threads that are never needed are never made.
_THREADS = LASTING_MAX + 100
_CALLS_MAX = 8 * _THREADS  # calls beyond the threads wait; only a flood is refused
_GRACE = 0.5  # s for the calls under way when the service closes


class ArmServer:
    """An arm on a TCP port; a context manager, closed at its end."""

    def __init__(
        self,
        builder: ArmBuilder,
        listen: str = LISTEN,
        files: Certificates | None = None,
        notify: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Open the port; `start` begins to serve.

        Args:
            builder: Makes the arm; closed with the server.
            listen: HOST:PORT; port 0 is any free one.
            files: Certificates; needed for any host but this machine's loopback.
            notify: Called with a line for each thing that a person should know.

        Raises:
            ConfigError: No such address, in use, not permitted, or open to the network
                without certificates.
        """
        host, port = split_address(listen)
        credentials = server_credentials(host, files)
        self._host = ArmHost(builder)
        self.service = ArmService(self._host, notify)
        self._server = grpc.server(
            ThreadPoolExecutor(_THREADS, thread_name_prefix="dovetail-rpc"),
            handlers=[make_handler(self.service)],
            maximum_concurrent_rpcs=_CALLS_MAX,
            options=[
                *KEEPALIVE,
                ("grpc.so_reuseport", 0),
                ("grpc.max_send_message_length", MESSAGE_MAX),
                ("grpc.max_receive_message_length", REQUEST_MAX),
            ],
        )
        spelled = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        try:
            if credentials is None:
                bound = self._server.add_insecure_port(spelled)
            else:
                bound = self._server.add_secure_port(spelled, credentials)
        except RuntimeError as error:
            self.service.leases.close()
            raise ConfigError(_why_not(host, port)) from error
        self.address = f"{spelled.rpartition(':')[0]}:{bound}"
        """HOST:PORT on which it listens."""

    def start(self) -> None:
        """Begin to serve, in threads of its own."""
        self._server.start()

    def close(self) -> None:
        """Hold the arm, end every call and release arm and port."""
        self.service.leases.close()
        self._host.stop("the service closes", is_ordered=False)
        self._server.stop(_GRACE).wait(timeout=5.0)
        self._host.close()

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()


def _why_not(host: str, port: int) -> str:
    """Say why nothing can listen at an address, by trying it with a plain socket."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    number = 0
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.bind((host, port))
    except OSError as error:
        number = error.errno or 0
    reason = os.strerror(number) if number > 0 else "the address is not known"
    if number == errno.EPERM:  # a container's policy says it so
        number = errno.EACCES
    advice = {
        errno.EADDRINUSE: "another program listens there: end it or choose another "
        f"port (who it is: ss -ltnp 'sport = :{port}')",
        errno.EACCES: "ports below 1024 need privileges: choose a higher one",
        errno.EADDRNOTAVAIL: "this machine has no such address: see `ip address`",
    }.get(number, "check host and port")
    return f"cannot listen at {host}:{port}: {reason.lower()}; {advice}"
