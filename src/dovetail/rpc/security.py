"""Access to a service: this machine with a token, others with mutual TLS only."""

import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path

import grpc

from dovetail.errors import ConfigError

PORT_MAX = 65535


@dataclass(frozen=True, kw_only=True)
class Certificates:
    """The three files that each end of mutual TLS needs, PEM."""

    cert: Path
    """Own certificate."""
    key: Path
    """Its private key, not encrypted."""
    ca: Path
    """Authority that signed the other end's certificate."""

    def check(self) -> "Certificates":
        """Return self if the files can be read and fit together.

        Raises:
            ConfigError: A file is missing or none, or the key is another one's.
        """
        for name in ("cert", "key", "ca"):
            path = vars(self)[name]
            try:
                path.read_bytes()
            except OSError as error:
                raise ConfigError(
                    f"the {name} file {path} cannot be read: {error.strerror}"
                ) from error
        tls_context(self, verify=True)
        return self


def certificates(
    *, cert: Path | None, key: Path | None, ca: Path | None, names: tuple[str, str, str]
) -> Certificates | None:
    """Return checked certificates, or None if none was given.

    Args:
        cert: Own certificate.
        key: Own private key.
        ca: Authority of the other end.
        names: How the user spells the three.

    Raises:
        ConfigError: Some are given and some are not, or they do not fit.
    """
    given = {"cert": cert, "key": key, "ca": ca}
    missing = [
        name for name, path in zip(names, given.values(), strict=True) if not path
    ]
    if len(missing) == len(names):
        return None
    if cert is None or key is None or ca is None:
        raise ConfigError(
            f"mutual TLS needs {', '.join(names)}: {', '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} missing"
        )
    return Certificates(cert=cert, key=key, ca=ca).check()


def tls_context(files: Certificates | None, *, verify: bool) -> ssl.SSLContext:
    """Return a client's TLS settings, as the library outside gRPC has them.

    Args:
        files: Own certificate and the other end's authority; None for neither.
        verify: Whether the other end's certificate is checked.

    Raises:
        ConfigError: A file is no certificate or key, or the key is another one's.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.set_alpn_protocols(["h2"])
    if not verify:
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE
    if files is None:
        return context
    try:
        context.load_cert_chain(files.cert, files.key, password=lambda: b"")
    except (ssl.SSLError, OSError, ValueError) as error:
        raise ConfigError(
            f"certificate {files.cert} and key {files.key} cannot be used: "
            f"{_words(error)}; both must be PEM, the key without a password and the "
            "certificate's own"
        ) from error
    try:
        context.load_verify_locations(files.ca)
    except (ssl.SSLError, OSError) as error:
        raise ConfigError(
            f"the authority's certificate {files.ca} cannot be used: {_words(error)}"
        ) from error
    return context


def _words(error: Exception) -> str:
    reason = error.reason if isinstance(error, ssl.SSLError) else ""
    return str(reason).lower().replace("_", " ") if reason else str(error)


def split_address(text: str) -> tuple[str, int]:
    """Return host and port of HOST:PORT, an IPv6 host in brackets.

    Raises:
        ConfigError: It is not of that form.
    """
    host, _, port = text.rpartition(":")
    bare = host.removeprefix("[").removesuffix("]")
    if not bare or not port.isdecimal() or int(port) > PORT_MAX:
        raise ConfigError(
            f"{text!r} is no address to listen at: give HOST:PORT with a port from 0 "
            f"(any free one) to {PORT_MAX}, such as 127.0.0.1:50051"
        )
    return bare, int(port)


def is_loopback(host: str) -> bool:
    """Say whether only this machine can reach the host's address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def server_credentials(
    host: str, files: Certificates | None
) -> grpc.ServerCredentials | None:
    """Return how clients are checked; None, by their token alone, on loopback only.

    Raises:
        ConfigError: Another address without certificates.
    """
    if files is None:
        if is_loopback(host):
            return None
        raise ConfigError(
            f"listening at {host} without certificates would let anyone on the network "
            "move the arm: give --cert, --key and --client-ca (mutual TLS), or listen "
            "at 127.0.0.1"
        )
    return grpc.ssl_server_credentials(
        [(files.key.read_bytes(), files.cert.read_bytes())],
        root_certificates=files.ca.read_bytes(),
        require_client_auth=True,
    )


def channel_credentials(files: Certificates) -> grpc.ChannelCredentials:
    """Return how the service is checked and what it is shown."""
    return grpc.ssl_channel_credentials(
        root_certificates=files.ca.read_bytes(),
        private_key=files.key.read_bytes(),
        certificate_chain=files.cert.read_bytes(),
    )
