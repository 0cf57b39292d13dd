"""Arm addresses, in one word: `mujoco`, `twin:medium`, `fri://0.0.0.0:30200`, ...

A new transport is a file with a subclass of `ArmAddress`, and a line in `NETWORK`.
"""

from pathlib import Path

from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.franka.arm import FrankaAddress
from dovetail.arms.fri_arm import FriAddress
from dovetail.arms.local_address import PlantAddress, TwinAddress
from dovetail.arms.remote_arm import GrpcAddress
from dovetail.errors import ConfigError, did_you_mean
from dovetail.plants.plant import PLANTS

NETWORK = {"fri": FriAddress, "franka": FrankaAddress, "grpc": GrpcAddress}
"""Addresses on a network by their scheme, what comes before ://."""
SCHEMES = (
    *PLANTS,
    "twin:NAME",
    "fri://HOST:PORT",
    "franka://HOST",
    "grpc://HOST:PORT",
)
"""Accepted forms of an address."""


def parse_address(text: str) -> ArmAddress:
    """Read an arm's address.

    Args:
        text: mujoco, bullet, drake, twin:NAME, fri://HOST:PORT?KEY=VALUE&... or
            grpc://HOST:PORT?KEY=VALUE&...

    Raises:
        ConfigError: Unknown scheme or key (lists the known ones), or a value out of
            range.
    """
    _require_no_keys(text)
    if text in PLANTS:
        return PlantAddress(text=text, engine=text)
    if text.startswith("twin:") and len(text) > len("twin:"):
        return TwinAddress(text=text, config=text.removeprefix("twin:"))
    scheme, separator, _ = text.partition("://")
    if separator and scheme in NETWORK:
        return NETWORK[scheme].parse(text)
    raise ConfigError(
        f"arm {text!r} is unknown{did_you_mean(text, PLANTS)}; known addresses: "
        f"{', '.join(SCHEMES)}"
    )


def _require_no_keys(text: str) -> None:
    """Refuse keys behind a simulation's address, which has none.

    Raises:
        ConfigError: Says which option of the command takes their place.
    """
    name, mark, keys = text.partition("?")
    is_here = name in PLANTS or name.startswith("twin:")
    if mark and is_here and not Path(text.removeprefix("twin:")).is_file():
        raise ConfigError(
            f"arm {text!r} has the keys {keys!r}, which are for addresses on a network "
            f"(fri://, grpc://); give {name!r} and options in their place, as --period"
        )
