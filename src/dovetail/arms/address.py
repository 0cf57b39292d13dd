"""Where an arm is, in one word: `mujoco`, `twin:medium`, `fri://0.0.0.0:30200`, ..."""

from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import IPv4Address
from pathlib import Path
from typing import Literal, TypeAlias
from urllib.parse import parse_qsl, urlsplit

from dovetail.control.period import (
    FRI_PERIODS,
    PERIODS,
    format_period,
    require_period,
)
from dovetail.durations import parse_time
from dovetail.errors import ConfigError
from dovetail.plants.plant import PLANTS

SCHEMES = (*PLANTS, "twin:NAME", "fri://HOST:PORT", "grpc://HOST:PORT")
"""How an address may look."""

FRI_PORT, GRPC_PORT = 30200, 50051
FRI_VERSIONS = {"1.14": "1.15", "1.15": "1.15", "1.16": "1.15", "2.5": "2.5"} | {
    "2.7": "2.7"
}
"""Known FRI versions, and the one whose wire format each has."""
FRI_NAME = "control period of an arm behind FRI"
LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, kw_only=True)
class PlantAddress:
    """An ideal plant in this process."""

    engine: str
    """Physics engine: mujoco or bullet."""


@dataclass(frozen=True, kw_only=True)
class TwinAddress:
    """A twin in this process."""

    twin: str
    """Name of a shipped twin, or path of a .toml file."""


@dataclass(frozen=True, kw_only=True)
class FriAddress:
    """A cabinet, real or simulated, that sends its messages to this machine."""

    host: str
    """Address of this machine to listen at; 0.0.0.0 is every one of them."""
    port: int
    """UDP port to listen at; a real cabinet sends to 30200 to 30209."""
    version: Literal["1.15", "2.5", "2.7"] = "1.15"
    """Wire format; the messages themselves do not name it."""
    period: float | None = None
    """Time between two commands [s]: send period times receive multiplier, one of
    FRI_PERIODS."""
    clock: Literal["wall", "lockstep"] = "wall"
    """Lockstep: a simulated cabinet waits for the learner."""
    control: str | None = None
    """Control port HOST:PORT of a simulated cabinet; a real one has none."""
    reset: Literal["move", "place"] = "move"
    """How an episode starts: move there, or be placed, which only a simulated cabinet
    can do, and does where nothing else is asked."""
    approach: bool = False
    """Move to a start that is far away, too."""
    timeout: float = 10.0
    """How long to wait for the cabinet [s]."""
    watchdog: float = 0.15
    """Time without a new target after which the arm is held [s]; wall clock only."""
    peer: str | None = None
    """The cabinet's IPv4 address: datagrams of no other are taken."""
    realtime: bool = False
    """Ask the system for real-time priority and locked memory."""
    margins: Literal["model", "hardware"] = "hardware"
    """Limit margins: for an arm that is as the model says, or for one that is not."""
    measured_sign: int = -1
    """Sign of the measured torque on the wire over the torque on the joint."""
    commanded_sign: int = -1
    """The same of the commanded torque."""
    external_sign: int = 1
    """The same of the external torque."""
    commanded_is_total: bool = False
    """The commanded torque on the wire contains gravity."""


@dataclass(frozen=True, kw_only=True)
class GrpcAddress:
    """An arm that `dovetail serve` offers."""

    text: str
    """The address as it was given."""
    host: str
    """Machine on which the service runs."""
    port: int
    """TCP port."""
    ca: Path | None = None
    """Certificate of the authority that signed the service's certificate."""
    cert: Path | None = None
    """Own certificate."""
    key: Path | None = None
    """Own private key."""
    period: float | None = None
    """Time between two commands [s]; a cabinet behind the service dictates it."""
    margins: Literal["model", "hardware"] = "hardware"
    """Limit margins: for an arm that is as the model says, or for one that is not."""


ArmAddress: TypeAlias = PlantAddress | TwinAddress | FriAddress | GrpcAddress


def parse_address(text: str) -> ArmAddress:
    """Read an arm's address.

    Args:
        text: mujoco, bullet, twin:NAME, fri://HOST:PORT?KEY=VALUE&... or
            grpc://HOST:PORT?KEY=VALUE&...

    Raises:
        ConfigError: Unknown scheme or key (lists the known ones), or a value out of
            range.
    """
    if text in PLANTS:
        return PlantAddress(engine=text)
    if text.startswith("twin:") and len(text) > len("twin:"):
        return TwinAddress(twin=text.removeprefix("twin:"))
    scheme = text.partition("://")[0] if "://" in text else ""
    if scheme == "fri":
        return _fri(text)
    if scheme == "grpc":
        return _grpc(text)
    raise ConfigError(f"arm {text!r} is unknown; known addresses: {', '.join(SCHEMES)}")


def is_simulated_here(address: ArmAddress) -> bool:
    """Say whether the arm is a simulation of this process: any number can be built."""
    return isinstance(address, (PlantAddress, TwinAddress))


def places_fixture(address: ArmAddress) -> bool:
    """Say whether the arm can put the fixture where an episode wants it.

    A cabinet without a control port cannot: there the fixture is where it is. Of an arm
    behind a service only the service knows (`RemoteArm.places_fixture`); this says yes.
    """
    return not isinstance(address, FriAddress) or address.control is not None


def with_approach(text: str) -> str:
    """Return the address of an arm that may move to a start far away.

    Raises:
        ConfigError: It is none behind FRI.
    """
    address = parse_address(text)
    if not isinstance(address, FriAddress):
        where = "add approach=yes to the address of `dovetail serve`"
        if is_simulated_here(address):
            where = "leave --approach out: a simulated arm is put at its start"
        raise ConfigError(
            f"approach is asked of {text!r}, which is not fri://; {where}"
        )
    if address.approach:
        return text
    return f"{text}{'&' if '?' in text else '?'}approach=yes"


def period_of(address: ArmAddress | None, asked: float | None, usual: float) -> float:
    """Return the control period [s] at which an arm is commanded.

    Args:
        address: Of the arm, which may give the period; None is a simulation here.
        asked: What is asked for beside the address [s], if anything.
        usual: Where neither says anything [s].

    Raises:
        ConfigError: The two differ, or a period that the arm cannot have.
    """
    own = getattr(address, "period", None)
    if asked is not None and own not in (None, asked):
        raise ConfigError(
            f"period is {format_period(asked)} and the arm's address says "
            f"{format_period(own)}; give one of them"
        )
    period = own or asked or usual
    if isinstance(address, FriAddress):
        return require_period(period, FRI_NAME, FRI_PERIODS)
    return require_period(period, "period")


def parse_endpoint(text: str, name: str) -> tuple[str, int]:
    """Return host and port from HOST:PORT.

    Args:
        text: The two, an IPv6 address in brackets.
        name: What it is, for messages.
    """
    try:
        parts = urlsplit(f"//{text}")
        host, port = parts.hostname, parts.port
        is_alone = not (parts.path or parts.query or parts.username)
    except ValueError:
        host, port, is_alone = None, None, False
    if not host or not port or not is_alone:
        raise ConfigError(
            f"{name} is {text!r}; give HOST:PORT, such as 127.0.0.1:30301, the port "
            "1 to 65535"
        )
    return host, port


def _split(text: str, default_port: int) -> tuple[str, int, dict[str, str]]:
    """Return host, port and the keys after the question mark."""
    parts = urlsplit(text)
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ConfigError(f"arm {text!r}: {error}; allowed: 1 to 65535") from error
    if not host or port == 0 or parts.path not in ("", "/") or parts.username:
        raise ConfigError(
            f"arm {text!r} is no address: give {parts.scheme}://HOST:PORT, the port 1 "
            f"to 65535 (default {default_port}), then ?KEY=VALUE&KEY=VALUE"
        )
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    keys = dict(pairs)
    if len(keys) < len(pairs):
        twice = next(name for name, _ in pairs if [n for n, _ in pairs].count(name) > 1)
        raise ConfigError(f"arm {text!r} gives {twice} twice; give it once")
    return host, port or default_port, keys


def _require_known(text: str, keys: Mapping[str, str], known: tuple[str, ...]) -> None:
    unknown = [key for key in keys if key not in known]
    if unknown:
        raise ConfigError(
            f"arm {text!r}: unknown keys: {', '.join(unknown)}; known keys: "
            f"{', '.join(known)}"
        )


def _choice(keys: Mapping[str, str], name: str, known: tuple[str, ...]) -> str:
    value = keys.get(name, known[0])
    if value not in known:
        raise ConfigError(f"arm {name} is {value!r}; known: {', '.join(known)}")
    return value


_FRI_KEYS = (
    *("version", "period", "clock", "control", "reset", "approach"),
    *("timeout", "watchdog", "realtime", "margins", "peer"),
    *("measured_sign", "commanded_sign", "external_sign", "commanded_is_total"),
)
_SIGNS = {"measured_sign": "-1", "commanded_sign": "-1", "external_sign": "1"}


def _fri(text: str) -> FriAddress:
    host, port, keys = _split(text, FRI_PORT)
    _require_known(text, keys, _FRI_KEYS)
    version = FRI_VERSIONS.get(keys.get("version", "1.15"))
    if version is None:
        raise ConfigError(
            f"FRI version is {keys['version']!r}; known: {', '.join(FRI_VERSIONS)}; "
            "the robot's own is in its Sunrise project (for 3.0 try 2.7)"
        )
    control = keys.get("control")
    if control is not None:
        parse_endpoint(control, "arm control")
    clock = _choice(keys, "clock", ("wall", "lockstep"))
    usual = ("move", "place") if control is None else ("place", "move")
    reset = _choice(keys, "reset", usual)
    if reset == "place" and control is None:
        raise ConfigError(
            "arm reset=place needs control=HOST:PORT, the control port of a simulated "
            "cabinet; a real arm starts its episodes with reset=move"
        )
    return FriAddress(
        host=host,
        port=port,
        version=version,  # type: ignore[arg-type]
        period=_period(keys, FRI_PERIODS),
        clock=clock,  # type: ignore[arg-type]
        control=control,
        reset=reset,  # type: ignore[arg-type]
        approach=_choice(keys, "approach", ("no", "yes")) == "yes",
        timeout=_time(keys, "timeout", FriAddress.timeout),
        watchdog=_time(keys, "watchdog", FriAddress.watchdog),
        realtime=_choice(keys, "realtime", ("no", "yes")) == "yes",
        peer=_peer(keys),
        margins=_choice(keys, "margins", ("hardware", "model")),  # type: ignore[arg-type]
        commanded_is_total=_choice(keys, "commanded_is_total", ("no", "yes")) == "yes",
        **_signs(keys),
    )


def _time(keys: Mapping[str, str], name: str, usual: float) -> float:
    return parse_time(keys[name], f"arm {name}") if name in keys else usual


def _peer(keys: Mapping[str, str]) -> str | None:
    """Return the cabinet's address, which is a number: names can be forged."""
    peer = keys.get("peer")
    try:
        return None if peer is None else str(IPv4Address(peer))
    except ValueError as error:
        raise ConfigError(
            f"arm peer is {peer!r}; give the cabinet's IPv4 address, such as "
            "192.170.10.2"
        ) from error


def _signs(keys: Mapping[str, str]) -> dict[str, int]:
    """Return the signs of torques on the wire."""
    signs = {}
    for name, usual in _SIGNS.items():
        other = "1" if usual == "-1" else "-1"
        signs[name] = int(_choice(keys, name, (usual, other)))
    return signs


def _period(keys: Mapping[str, str], allowed: tuple[float, ...]) -> float | None:
    if "period" not in keys:
        return None
    period = parse_time(keys["period"], "arm period")
    return require_period(period, "arm period", allowed)


def _grpc(text: str) -> GrpcAddress:
    host, port, keys = _split(text, GRPC_PORT)
    _require_known(text, keys, ("ca", "cert", "key", "period", "margins"))
    margins = _choice(keys, "margins", ("hardware", "model"))
    period = _period(keys, PERIODS)
    keys = {name: keys[name] for name in ("ca", "cert", "key") if name in keys}
    if ("cert" in keys) != ("key" in keys):
        given, needed = ("cert", "key") if "cert" in keys else ("key", "cert")
        raise ConfigError(
            f"arm {text!r} gives {given} without {needed}; give both or none"
        )
    if not keys and host not in LOOPBACK:
        raise ConfigError(
            f"arm {text!r}: {host} is another machine and needs certificates: add "
            "?ca=FILE&cert=FILE&key=FILE"
        )
    files = {name: Path(value).expanduser() for name, value in keys.items()}
    for name, path in files.items():
        if not path.is_file():
            raise ConfigError(f"arm {name} {str(path)!r} is no file")
    return GrpcAddress(
        text=text,
        host=host,
        port=port,
        period=period,
        margins=margins,  # type: ignore[arg-type]
        **files,
    )
