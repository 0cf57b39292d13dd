"""Versions that both ends must agree on before anything else."""

from dovetail.distribution import installed_version
from dovetail.errors import ConfigError
from dovetail.rpc import dovetail_pb2 as pb

PROTOCOL = 6
"""Version of `proto/dovetail.proto`; it grows when an old peer would misunderstand."""


def own_version() -> pb.Version:
    """Return the versions of this end."""
    return pb.Version(protocol=PROTOCOL, package=installed_version("dovetail"))


def require_version(other: pb.Version, who: str) -> None:
    """Refuse a peer that speaks another version.

    Args:
        other: What the peer said of itself.
        who: What the peer is: "client" or "service".

    Raises:
        ConfigError: Names both versions.
    """
    if other.protocol == PROTOCOL:
        return
    own = own_version()
    here = "client" if who == "service" else "service"
    raise ConfigError(
        f"the {who} speaks protocol {other.protocol} "
        f"(dovetail {other.package or 'unknown'}), this {here} speaks "
        f"{own.protocol} (dovetail {own.package}): install the same dovetail on both"
    )
