"""A client's connection: the handshake, every error in words, and why it failed."""

import os
import socket
import ssl
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import grpc

from dovetail.errors import ArmError, ConfigError, DovetailError
from dovetail.printable import printable
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.calls import KEEPALIVE, MESSAGE_MAX, Stub
from dovetail.rpc.problems import error_of, problem_in
from dovetail.rpc.security import Certificates, channel_credentials, tls_context
from dovetail.rpc.token import AUTHORIZATION, bearer
from dovetail.rpc.version import own_version, require_version

_PROBE = 2.0  # s for finding out why a connection failed


class Connection:
    """A channel to a service, its calls, and what the service said of itself."""

    def __init__(
        self,
        host: str,
        port: int,
        files: Certificates | None,
        timeout: float,
        token: str | None = None,
    ) -> None:
        """Connect and agree on the version.

        Args:
            host: Name or address of the service's machine.
            port: TCP port.
            files: Certificates; None speaks without TLS.
            timeout: Longest time to wait for the service [s].
            token: The service's, where it has one.

        Raises:
            ArmError: No answer from there; says what to check.
            ConfigError: The service speaks another version.
        """
        self.host, self.port, self.files = host, port, files
        self.address = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        options = [
            *KEEPALIVE,
            ("grpc.max_receive_message_length", MESSAGE_MAX),
            ("grpc.enable_http_proxy", 0),
            # A new channel must not inherit an old one's failed connection.
            ("grpc.use_local_subchannel_pool", 1),
        ]
        if files is None:
            self.channel = grpc.insecure_channel(self.address, options)
        else:
            self.channel = grpc.secure_channel(
                self.address, channel_credentials(files), options
            )
        shown = [] if token is None else [(AUTHORIZATION, bearer(token))]
        self.stub = Stub(self.channel, shown)
        try:
            with self.words("cannot reach the arm"):
                self.info: pb.Info = self.stub.get_info(
                    pb.InfoRequest(version=own_version()), timeout=timeout
                )
            require_version(self.info.version, "service")
        except BaseException:
            self.channel.close()
            raise

    @contextmanager
    def words(self, doing: str) -> Iterator[None]:
        """Turn a failed call into the error that the service had, or into words.

        Args:
            doing: What fails, for the message.
        """
        try:
            yield
        except grpc.RpcError as call:
            raise self.error(call, doing) from call

    def error(self, call: Any, doing: str) -> DovetailError:
        """Return a failed call as an exception."""
        if (problem := problem_in(call)) is not None:
            return error_of(problem)
        code, details = call.code(), printable(call.details() or "")
        if code == grpc.StatusCode.UNAVAILABLE:
            reason = explain(self.host, self.port, self.files)
            return ArmError(f"{doing} at {self.address}: {reason or details}")
        if code in (grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.CANCELLED):
            return ArmError(
                f"{doing} at {self.address}: no answer in time; is the arm behind the "
                "service still there?"
            )
        if code == grpc.StatusCode.UNIMPLEMENTED:
            return ConfigError(
                f"{doing} at {self.address}: what listens there is no dovetail "
                f"service of this version ({details})"
            )
        return ArmError(f"{doing} at {self.address}: {code.name.lower()}: {details}")

    def close(self) -> None:
        """Close the channel; harmless when repeated."""
        self.channel.close()


def client_name() -> str:
    """Return how this program is called in messages to others."""
    program = Path(sys.argv[0] or "python").name
    return f"{program} (pid {os.getpid()} on {socket.gethostname()})"


def explain(host: str, port: int, files: Certificates | None) -> str:
    """Say why a service cannot be reached, by trying it step by step.

    Returns:
        What to do; empty if nothing wrong was found.
    """
    try:
        with socket.create_connection((host, port), timeout=_PROBE) as connection:
            return _explain_tls(connection, host, files)
    except ConnectionRefusedError:
        return (
            "nothing listens there; start `dovetail serve --arm ... --listen "
            f"{host}:{port}` on that machine, and check the port"
        )
    except socket.gaierror as error:
        return f"the name {host!r} cannot be resolved ({error.strerror})"
    except TimeoutError:
        return "the machine does not answer; check cable, address and firewall"
    except OSError as error:
        return f"{error.strerror or error}; check cable, address and firewall"


def _explain_tls(
    connection: socket.socket, host: str, files: Certificates | None
) -> str:
    if files is None:
        try:
            with tls_context(None, verify=False).wrap_socket(connection):
                return _NEEDS_TLS
        except ssl.SSLError as error:
            return _NEEDS_TLS if "ALERT" in str(error.reason) else ""
        except OSError:
            return ""
    refused = (
        f"the service refuses the certificate {files.cert}, which must be signed by "
        "the authority that the service was given as --client-ca: "
    )
    try:
        with tls_context(files, verify=True).wrap_socket(
            connection, server_hostname=host
        ) as tls:
            tls.settimeout(0.5)
            # In TLS 1.3 the own certificate is refused here, after the handshake.
            return "" if tls.recv(1) else refused + "it has closed the connection"
    except ssl.SSLCertVerificationError as error:
        return (
            f"the service's certificate is refused here: {error.verify_message}; it "
            f"must be signed by {files.ca} and made for the name {host!r}"
        )
    except TimeoutError:
        return ""
    except ssl.SSLError as error:
        reason = str(error.reason).lower().replace("_", " ")
        if "alert" in reason:
            return refused + reason
        return f"TLS fails: {reason}; was the service started with certificates?"
    except ConnectionError as error:
        return refused + str(error.strerror or error).lower()
    except OSError as error:
        return f"TLS fails: {error}; was the service started with certificates?"


_NEEDS_TLS = (
    "the service wants TLS: give its authority, a certificate and a key, "
    "grpc://HOST:PORT?ca=FILE&cert=FILE&key=FILE"
)
