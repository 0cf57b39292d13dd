"""Address of an arm behind FRI: `fri://0.0.0.0:30200?KEY=VALUE&...`.

The cabinet, real or simulated, sends its messages to this host and port.
"""

from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from typing import ClassVar, Literal, Self, TypeAlias

from dovetail.arms.arm_address import ArmAddress, Keys, parse_endpoint
from dovetail.control.period import FRI_PERIODS
from dovetail.errors import ConfigError

PORT = 30200
Version = Literal["1.15", "2.5", "2.7"]
VERSIONS: dict[str, Version] = {
    **{"1.14": "1.15", "1.15": "1.15", "1.16": "1.15"},
    **{"2.5": "2.5", "2.7": "2.7"},
}
"""Known FRI versions, and the one whose wire format each has."""
Clock: TypeAlias = Literal["wall", "lockstep"]
Reset: TypeAlias = Literal["move", "place"]
CLOCKS: tuple[Clock, ...] = ("wall", "lockstep")
RESETS: tuple[Reset, ...] = ("move", "place")
_SIGNS = {"measured_sign": "-1", "commanded_sign": "-1", "external_sign": "1"}
_KEYS = (
    *("version", "period", "clock", "control", "reset", "approach"),
    *("timeout", "target_timeout", "realtime", "margins", "peer"),
    *_SIGNS,
    "commanded_is_total",
)


@dataclass(frozen=True, kw_only=True)
class FriAddress(ArmAddress):
    """A cabinet, real or simulated, that sends its messages to this machine."""

    transport: ClassVar[str] = "fri"
    measures_contact: ClassVar[bool] = False
    periods: ClassVar[tuple[float, ...]] = FRI_PERIODS
    period_name: ClassVar[str] = "control period of an arm behind FRI"

    host: str
    """Address of this machine to listen at; 0.0.0.0 is every one of them."""
    port: int
    """UDP port to listen at; a real cabinet sends to 30200 to 30209."""
    version: Version = "1.15"
    """Wire format; the messages themselves do not name it."""
    control: str | None = None
    """Control port HOST:PORT of a simulated cabinet; a real one has none."""
    peer: str | None = None
    """The cabinet's IPv4 address: datagrams of no other are taken."""
    measured_sign: int = -1
    """Sign of the measured torque on the wire over the torque on the joint."""
    commanded_sign: int = -1
    """The same of the commanded torque."""
    external_sign: int = 1
    """The same of the external torque."""
    commanded_is_total: bool = False
    """The commanded torque on the wire contains gravity."""
    clock: Clock = "wall"
    """Lockstep: a simulated cabinet waits for the learner."""
    timeout: float = 10.0
    """Longest wait for the cabinet [s]."""
    target_timeout: float = 0.15
    """Time without a new target after which the arm is held [s]; wall clock only."""
    realtime: bool = False
    """Ask the system for real-time priority and locked memory."""
    reset: Reset | None = None
    """Way to the start: "move" below the limits, or "place", which needs a simulated
    cabinet. None is place with a control port, else move."""
    approach: bool = False
    """Move to a start that is far away, too."""

    def __post_init__(self) -> None:
        """Choose the reset if none is given; refuse one that the cabinet cannot do."""
        control = self.control
        if self.reset is None:
            object.__setattr__(self, "reset", "move" if control is None else "place")
        if self.reset == "place" and control is None:
            raise ConfigError(
                "arm reset=place needs control=HOST:PORT, the control port of a "
                "simulated cabinet; a real arm starts its episodes with reset=move"
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address.

        Raises:
            ConfigError: Unknown key (lists the known ones), or a value out of range.
        """
        keys = Keys(text, PORT, _KEYS)
        given = keys.get("version")
        version = VERSIONS.get("1.15" if given is None else given)
        if version is None:
            raise ConfigError(
                f"FRI version is {given!r}; known: {', '.join(VERSIONS)}; "
                "the robot's own is in its Sunrise project (for 3.0 try 2.7)"
            )
        control = keys.get("control")
        if control is not None:
            parse_endpoint(control, "arm control")
        return cls(
            text=text,
            host=keys.host,
            port=keys.port,
            version=version,
            period=keys.period(FRI_PERIODS),
            clock=keys.choice("clock", CLOCKS),
            control=control,
            reset=None if keys.get("reset") is None else keys.choice("reset", RESETS),
            approach=keys.is_on("approach"),
            timeout=keys.time("timeout", cls.timeout),
            target_timeout=keys.time("target_timeout", cls.target_timeout),
            realtime=keys.is_on("realtime"),
            peer=_peer(keys.get("peer")),
            margins=keys.choice("margins", ("hardware", "model")),
            commanded_is_total=keys.is_on("commanded_is_total"),
            **_signs(keys),
        )

    @property
    def is_real_time(self) -> bool:
        """True if the arm moves on while the learner thinks."""
        return self.clock == "wall"

    @property
    def places_fixture(self) -> bool:
        """True if it can place the fixture: with a control port."""
        return self.control is not None

    def describe_ground(self) -> str:
        """Return where a result was found."""
        if self.control is not None:
            return f"simulated cabinet ({self.text})"
        return f"the arm at {self.text.partition('?')[0]}"

    @property
    def may_be_robot(self) -> bool:
        """True if a real arm may move there: without a control port."""
        return self.control is None

    @property
    def undisturbed(self) -> str:
        """Reason why nothing can push the arm; empty with a control port."""
        if self.control is not None:
            return ""
        return (
            "needs a simulation, or the control port of a simulated cabinet "
            "(control=HOST:PORT); a real arm is pushed by hand"
        )

    def with_approach(self) -> str:
        """Return the address of the arm where it may move to a start far away."""
        if self.approach:
            return self.text
        return f"{self.text}{'&' if '?' in self.text else '?'}approach=yes"

    def with_realtime(self) -> Self:
        """Return the address of the arm with real-time priority."""
        return replace(self, realtime=True)


def _peer(peer: str | None) -> str | None:
    """Return the cabinet's address, which is a number: names can be forged."""
    try:
        return None if peer is None else str(IPv4Address(peer))
    except ValueError as error:
        raise ConfigError(
            f"arm peer is {peer!r}; give the cabinet's IPv4 address, such as "
            "192.170.10.2"
        ) from error


def _signs(keys: Keys) -> dict[str, int]:
    """Return the signs of torques on the wire."""
    signs = {}
    for name, usual in _SIGNS.items():
        other = "1" if usual == "-1" else "-1"
        signs[name] = int(keys.choice(name, (usual, other)))
    return signs
