"""The server process's side: a port, the service behind it, and an orderly end."""

import asyncio
import errno
import functools
import os
import socket
import threading
from collections.abc import Callable, Coroutine
from types import TracebackType
from typing import Any, Self, TypeVar

import grpc

from dovetail.errors import ConfigError
from dovetail.rpc.arm_host import ArmHost
from dovetail.rpc.arm_service import ArmService
from dovetail.rpc.calls import KEEPALIVE, MESSAGE_MAX, REQUEST_MAX, make_handler
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.security import Certificates, server_credentials, split_address
from dovetail.rpc.token import TOKEN, make_token

LISTEN = "127.0.0.1:50051"
"""Default address that the service listens on: this machine only."""

_GRACE = 0.5  # s for the calls under way when the service closes
_OPTIONS = (
    *KEEPALIVE,
    ("grpc.so_reuseport", 0),
    ("grpc.max_send_message_length", MESSAGE_MAX),
    ("grpc.max_receive_message_length", REQUEST_MAX),
    ("grpc.max_concurrent_streams", 100),  # of one connection
    # Beyond these gRPC refuses calls, a stop, too: 1000 and 3000 if nothing is said.
    ("grpc.server.max_pending_requests", 2**30),
    ("grpc.server.max_pending_requests_hard_limit", 2**30),
    ("grpc.server_handshake_timeout_ms", 3000),  # of one that says nothing
)
_Result = TypeVar("_Result")


class ArmServer:
    """An arm on a TCP port; a context manager, closed at its end."""

    def __init__(
        self,
        offered: OfferedArm,
        listen: str = LISTEN,
        files: Certificates | None = None,
        notify: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Open the port; `start` begins to serve.

        Args:
            offered: The arm; closed with the server.
            listen: HOST:PORT; port 0 is any free one.
            files: Certificates; needed for any host but this machine's loopback.
                Without them a caller has to show a token: DOVETAIL_TOKEN, or a random
                one.
            notify: Called with a line for each thing that a person should know, in a
                thread of its own.

        Raises:
            ConfigError: No such address, in use, not permitted, or open to the network
                without certificates; or a DOVETAIL_TOKEN that cannot be used.
        """
        host, port = split_address(listen)
        credentials = server_credentials(host, files)
        token = "" if files else make_token()
        self._host = ArmHost(offered)
        spelled = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

        async def build() -> tuple[ArmService, grpc.aio.Server]:
            service = ArmService(self._host, notify, token)
            handlers = [make_handler(service)]
            return service, grpc.aio.server(handlers=handlers, options=_OPTIONS)

        self.service, self._server = _in_loop(build())
        try:
            if credentials is None:
                bound = self._server.add_insecure_port(spelled)
            else:
                bound = self._server.add_secure_port(spelled, credentials)
        except RuntimeError as error:
            self.service.close()
            raise ConfigError(_why_not(host, port)) from error
        self.address = f"{spelled.rpartition(':')[0]}:{bound}"
        """HOST:PORT on which it listens."""
        is_known = not token or token == os.environ.get(TOKEN)
        self.url = f"grpc://{self.address}" + ("" if is_known else f"?token={token}")
        """Address for learners, with the token if that is a random one."""

    def start(self) -> None:
        """Begin to serve, in threads of its own."""
        _in_loop(self._server.start())

    def close(self) -> None:
        """Hold the arm, end every call and release arm and port."""

        async def end() -> None:
            self.service.leases.close()
            self._host.stop("the service closes", is_ordered=False)
            await self._server.stop(_GRACE)

        _in_loop(end())
        self._host.close()
        self.service.close()

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


@functools.cache
def _loop() -> asyncio.AbstractEventLoop:
    """Return the event loop of this process's services, in a thread of its own."""
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="dovetail-rpc", daemon=True).start()
    return loop


def _in_loop(work: Coroutine[Any, Any, _Result]) -> _Result:
    """Do something in that loop, and return its result."""
    return asyncio.run_coroutine_threadsafe(work, _loop()).result()


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
