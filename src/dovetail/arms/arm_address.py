"""Base class of arm addresses: facts known before the arm is built, and its builder.

Each transport has a subclass.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, Self, TypeVar
from urllib.parse import parse_qsl, urlsplit

from dovetail.control.period import PERIODS, require_period
from dovetail.durations import format_ms, parse_time
from dovetail.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from dovetail.arms.arm import Arm
    from dovetail.control.settings import ControllerSettings
    from dovetail.plants.plant import DynamicsConfig
    from dovetail.workcell.workcell import Workcell

_Word = TypeVar("_Word", bound=str)


@dataclass(frozen=True, kw_only=True)
class ArmAddress(ABC):
    """Address of an arm, with the facts known before `build` builds it."""

    text: str = field(default="", compare=False)
    """The address as it was given."""
    period: float | None = None
    """Time between two commands [s], where the address says it."""
    margins: Literal["model", "hardware"] = "hardware"
    """Limit margins: for an arm that is as the model says, or for one that is not."""

    is_here: ClassVar[bool] = False
    """True for a simulation in this process: any number can be built."""
    is_service: ClassVar[bool] = False
    """True if another process owns the arm and its controller."""
    measures_contact: ClassVar[bool] = True
    """True if contact forces may be known; behind a service, it alone knows."""
    periods: ClassVar[tuple[float, ...]] = PERIODS
    """Control periods that it can have [s]."""
    period_name: ClassVar[str] = "period"
    """Name of the period in messages."""

    @property
    def is_real_time(self) -> bool:
        """True if the arm moves on while the learner thinks."""
        return True

    @property
    def places_fixture(self) -> bool:
        """True if the arm can put the fixture where an episode wants it.

        Always True for an arm behind a service, which alone knows.
        """
        return True

    @property
    def twin(self) -> str:
        """Name or file of the twin that plays the robot; empty where none is known."""
        return ""

    @abstractmethod
    def build(self, cell: "Workcell", settings: "ControllerSettings") -> "Arm":
        """Build the arm.

        Args:
            cell: What stands around it.
            settings: Made for the cell's robot and this address's margins.

        Raises:
            ConfigError: A setting that this arm cannot have.
            ArmError: It cannot be had.
            MissingDependencyError: What it needs is not installed.
        """

    @abstractmethod
    def describe_ground(self) -> str:
        """Return where a result on this arm was found, in words."""

    def with_engine(self, engine: str) -> Self:
        """Return the address of a twin in another physics engine.

        Raises:
            ConfigError: It is none.
        """
        raise ConfigError(
            f"engine is {engine!r}, which is a twin's, and no twin is given; add twin, "
            "or give plant"
        )

    def with_dynamics(self, dynamics: "DynamicsConfig") -> Self:
        """Return the address of a plant with other physics.

        Raises:
            ConfigError: It is none.
        """
        raise ConfigError(
            "dynamics can be given to a plant of this process only; the arm behind the "
            "address has its own"
        )

    @property
    def may_be_robot(self) -> bool:
        """True if a real arm may move there; False only if it is surely simulated."""
        return True

    @property
    def can_be_disturbed(self) -> bool:
        """True if this end can push the arm and move its fixture."""
        return False

    @property
    def unproven_margins(self) -> str:
        """Reason why limits with these margins are unproven; empty if they are proven.

        A simulated arm can be exactly its model, and does no harm where it is not.
        """
        if self.margins == "hardware" or not self.may_be_robot:
            return ""
        return (
            f"arm {self.text!r} has margins=model, those of an arm that is exactly its "
            "model: the limits of a robot are unproven with them, and one wrong sample "
            "can throw it; leave margins out, or use them with a simulated arm"
        )

    def with_approach(self) -> str:
        """Return the address of the arm where it may move to a start far away.

        Raises:
            ConfigError: It does not drive to its starts itself.
        """
        raise ConfigError(
            f"approach is asked of {self.text!r}, which is not fri://; leave "
            "--approach out: a simulated arm is put at its start"
        )

    def with_realtime(self) -> Self:
        """Return the address of the arm with real-time priority.

        Raises:
            ConfigError: It has no clock of its own.
        """
        raise ConfigError(
            f"--realtime is for fri:// arms: {self.text} is a simulation, which has no "
            "clock to keep"
        )

    def control_period(self, asked: float | None, usual: float) -> float:
        """Return the control period [s] at which the arm is commanded.

        Args:
            asked: What is asked for beside the address [s], if anything.
            usual: Where neither says anything [s].

        Raises:
            ConfigError: The two differ, or a period that the arm cannot have.
        """
        if asked is not None and self.period not in (None, asked):
            raise ConfigError(
                f"period is {format_ms(asked)} and the arm's address says "
                f"{format_ms(self.period or asked)}; give one of them"
            )
        period = self.period or asked or usual
        return require_period(period, self.period_name, self.periods)


class Keys:
    """Host and port of an address, and its KEY=VALUE pairs after the question mark."""

    def __init__(
        self,
        text: str,
        port: int,
        known: Sequence[str],
    ) -> None:
        """Split an address.

        Args:
            text: SCHEME://HOST:PORT?KEY=VALUE&...
            port: Where it gives none.
            known: Keys that it may have.

        Raises:
            ConfigError: It is not of that form, or a key is unknown or given twice.
        """
        self.text = text
        self.host, self.port, self._keys = _split(text, port)
        unknown = [key for key in self._keys if key not in known]
        if unknown:
            names = ", ".join(key + did_you_mean(key, known) for key in unknown)
            raise ConfigError(
                f"arm {text!r}: unknown keys: {names}; known keys: {', '.join(known)}"
            )

    def get(self, name: str) -> str | None:
        """Return a key's text, None where it is not given."""
        return self._keys.get(name)

    def choice(self, name: str, known: Sequence[_Word]) -> _Word:
        """Return one of the known words; the first where none is given."""
        given = self._keys.get(name, known[0])
        for word in known:
            if word == given:
                return word
        raise ConfigError(f"arm {name} is {given!r}; known: {', '.join(known)}")

    def is_on(self, name: str) -> bool:
        """Return whether a switch is yes; it is no where it is not given."""
        return self.choice(name, ("no", "yes")) == "yes"

    def time(self, name: str, usual: float) -> float:
        """Return a time [s]."""
        given = self._keys.get(name)
        return usual if given is None else parse_time(given, f"arm {name}")

    def period(self, allowed: tuple[float, ...]) -> float | None:
        """Return the control period [s], if it is given."""
        given = self._keys.get("period")
        if given is None:
            return None
        return require_period(parse_time(given, "arm period"), "arm period", allowed)


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


def parse_endpoint(text: str, name: str, *, is_own: bool = False) -> tuple[str, int]:
    """Return host and port from HOST:PORT.

    Args:
        text: The two, an IPv6 address in brackets.
        name: What it is, for messages.
        is_own: To listen at: port 0 is any free one.
    """
    try:
        parts = urlsplit(f"//{text}")
        host, port = parts.hostname, parts.port
        is_alone = not (parts.path or parts.query or parts.username)
    except ValueError:
        host, port, is_alone = None, None, False
    if not host or port is None or not (port or is_own) or not is_alone:
        raise ConfigError(
            f"{name} is {text!r}; give HOST:PORT, such as 127.0.0.1:30301, the port "
            f"{0 if is_own else 1} to 65535"
        )
    return host, port
