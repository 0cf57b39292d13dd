"""Driver of the Weiss / Schunk WSG 50 by its text protocol over TCP.

Outside: metres, metres per second, newtons. On the wire: millimetres. In the gripper's
web page the command interface must be set to the text protocol. If a client vanishes
without the goodbye, the gripper stops fast and must be acknowledged.
"""

import math
from types import TracebackType
from typing import Literal, NamedTuple, Self

from dovetail.errors import ConfigError, GripperError
from dovetail.gripper.facts import (
    FORCE_RANGE,
    NAMES,
    PORT,
    SPEED_MAX,
    WIDTH_MAX,
    Code,
    Flag,
    GripState,
    describe,
)
from dovetail.gripper.lines import LineSocket


class GripperState(NamedTuple):
    """Measured state of the gripper."""

    width: float
    """Opening between the fingers [m]."""
    speed: float
    """Speed of the fingers [m/s]."""
    force: float
    """Grip force [N]."""
    grip: GripState
    """State of the fingers."""


class Wsg50:
    """One connection to one gripper; not for several threads at once."""

    def __init__(
        self,
        host: str,
        port: int = PORT,
        *,
        timeout: float = 2.0,
        motion_timeout: float = 30.0,
    ) -> None:
        """Connect.

        Args:
            host: The gripper's address.
            port: Its TCP port.
            timeout: Longest wait for an answer [s].
            motion_timeout: Longest wait for the end of a motion [s].

        Raises:
            GripperError: No gripper there; says what to check.
        """
        for name, value in (("timeout", timeout), ("motion_timeout", motion_timeout)):
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"gripper {name} is {value} s; it must be > 0")
        self._motion_timeout = motion_timeout
        self._timeout = timeout
        self._line = LineSocket(host, port, timeout)
        self._pending: str | None = None
        self.latest: dict[str, float] = {}
        """Newest values that came by `autosend`: POS [m], SPEED [m/s], FORCE [N]."""

    def __enter__(self) -> Self:
        """Use the connection."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Say goodbye."""
        self.close()

    def home(self, towards: Literal["default", "closed", "open"] = "default") -> None:
        """Run to the end stop; needed once before any motion.

        Args:
            towards: Which end stop; default is the gripper's setting.
        """
        if towards not in ("default", "closed", "open"):
            raise ConfigError(
                f"home towards {towards!r} is unknown; known: default, closed, open"
            )
        number = {"default": "", "closed": "0", "open": "1"}[towards]
        self._move("HOME", number)

    def move(self, width: float, speed: float = 0.1) -> None:
        """Move the fingers.

        Args:
            width: Opening [m], 0 to 0.110.
            speed: Speed [m/s], above 0 to 0.420.

        Raises:
            GripperError: Not homed, something in the way, fast stop, or no answer.
        """
        self._move("MOVE", f"{_width(width)},{_speed(speed)}")

    def grip(
        self, force: float = 20.0, width: float | None = None, speed: float = 0.05
    ) -> GripState:
        """Close until the force is there.

        Args:
            force: Grip force [N], 5 to 80.
            width: Width that the part should have [m]; without it the gripper cannot
                tell a part from none and always ends holding.
            speed: Speed [m/s], above 0 to 0.420.

        Returns:
            HOLDING, or NO_PART.

        Raises:
            GripperError: Not homed, holding already, a part of another width, or no
                answer.
        """
        words = [_force(force)]
        if width is not None:
            words += [_width(width), _speed(speed)]
        try:
            self._move("GRIP", ",".join(words))
        except GripperError as error:
            if error.code != Code.FAILED:
                raise
            if (state := self.state().grip) != GripState.NO_PART:
                raise
            return state
        return self.state().grip

    def release(self, pullback: float = 0.01, speed: float = 0.05) -> None:
        """Open after a grip.

        Args:
            pullback: How much further to open [m], 0 to 0.110.
            speed: Speed [m/s], above 0 to 0.420.

        Raises:
            GripperError: Nothing was gripped, or no answer.
        """
        self._move("RELEASE", f"{_width(pullback, 'pullback')},{_speed(speed)}")

    def start_move(self, width: float, speed: float = 0.1) -> None:
        """Begin to move the fingers; `wait` or `stop` ends it."""
        self._begin("MOVE", f"{_width(width)},{_speed(speed)}")

    def wait(self) -> None:
        """Wait for the end of a motion that was begun.

        Raises:
            GripperError: It failed, or took longer than `motion_timeout`.
        """
        while self._pending is not None:
            self._read(self._motion_timeout)

    def stop(self) -> None:
        """Stop a motion; what was under way is given up."""
        self._give_up("STOP")

    def fast_stop(self) -> None:
        """Stop as fast as possible; nothing moves before `acknowledge`."""
        self._give_up("FASTSTOP")

    def acknowledge(self) -> None:
        """Acknowledge a fast stop."""
        self._command("FSACK")

    def state(self) -> GripperState:
        """Ask for width, speed, force and what the fingers do."""
        grip = self.query("GRIPSTATE")
        try:
            state = GripState(int(grip))
        except ValueError as error:
            raise GripperError(
                f"gripper answers GRIPSTATE={grip}; known: 0 to {max(GripState)}"
            ) from error
        return GripperState(
            self._number("POS") * 1e-3,
            self._number("SPEED") * 1e-3,
            self._number("FORCE"),
            state,
        )

    def flag(self, flag: Flag) -> bool:
        """Ask for one system flag."""
        return self.query(f"SYSFLAGS[{int(flag)}]") == "1"

    def query(self, name: str) -> str:
        """Ask for one value by its name on the wire, such as VERSION or TEMP."""
        self._line.send(f"{name}?")
        while True:
            line = self._read(self._timeout, answers=(name,))
            if line is not None and line.startswith(f"{name}="):
                return line.partition("=")[2].strip().strip('"')

    def autosend(self, name: Literal["POS", "SPEED", "FORCE"], interval: float) -> None:
        """Have a value sent again and again; it appears in `latest` with every answer.

        Args:
            name: POS, SPEED or FORCE.
            interval: Time between two [s], 1 ms to 10 s; 0 ends it. The gripper's unit
                is not documented; milliseconds are sent.
        """
        if name not in ("POS", "SPEED", "FORCE"):
            raise ConfigError(f"autosend of {name!r}; known: POS, SPEED, FORCE")
        if not (interval == 0.0 or 0.001 <= interval <= 10.0):
            raise ConfigError(
                f"autosend interval is {interval} s; allowed: 0, or 0.001 to 10 s"
            )
        self._command("AUTOSEND", f'"{name}",{round(1e3 * interval)}')

    def close(self) -> None:
        """Say goodbye, so that the gripper does not stop fast; harmless if repeated."""
        if self._line.is_open:
            try:
                self._command("BYE")
            except GripperError:
                pass  # it is gone: no goodbye is needed
            finally:
                self._line.close()

    def _move(self, name: str, arguments: str) -> None:
        self._begin(name, arguments)
        self.wait()

    def _begin(self, name: str, arguments: str) -> None:
        if self._pending is not None:
            raise GripperError(
                f"gripper {name}: {self._pending} is still under way; wait for it, or "
                "stop it"
            )
        self._command(name, arguments)
        self._pending = name

    def _give_up(self, name: str) -> None:
        self._pending = None
        self._command(name)

    def _command(self, name: str, arguments: str = "") -> None:
        """Send a command and wait until it is accepted."""
        self._line.send(f"{name}({arguments})")
        while self._read(self._timeout, answers=(name,)) != f"ACK {name}":
            pass

    def _read(self, timeout: float, answers: tuple[str, ...] = ()) -> str | None:
        """Read a line; raise what it says went wrong with what is waited for.

        Returns:
            The line if it answers what is waited for, else None.
        """
        line = self._line.read(timeout)
        if line.startswith("@"):
            self._note(line[1:])
            return None
        kind, _, rest = line.partition(" ")
        name, _, word = rest.partition(" ")
        awaited = (*answers, self._pending) if self._pending else answers
        if kind == "FIN":
            if name == self._pending:
                self._pending = None
            return None
        if kind == "ERR":
            if name in awaited or not word:
                if name not in answers:
                    self._pending = None
                raise _error(name, (word or name).strip())
            return None
        if kind == "ACK" or line.partition("=")[0] in answers:
            return line
        if "=" in line:  # an answer that came after its time was up
            return None
        raise GripperError(
            f"gripper sends {line[:60]!r}, which is no line of the text protocol; "
            "select the text protocol in its web page (Command Interface)"
        )

    def _note(self, text: str) -> None:
        name, _, word = text.partition("=")
        try:
            value = float(word)
        except ValueError:
            return  # one value of many; the next one comes soon
        self.latest[name] = value * (1.0 if name == "FORCE" else 1e-3)

    def _number(self, name: str) -> float:
        word = self.query(name)
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise GripperError(f"gripper answers {name}={word}, which is no number")
        return value


def _error(name: str, word: str) -> GripperError:
    code = int(word) if word.isdecimal() else NAMES.get(word)
    return GripperError(f"gripper {name}: {describe(code, word)}", code=code)


def _width(value: float, name: str = "width") -> str:
    return _millimetres(name, value, 0.0, WIDTH_MAX, "m")


def _speed(value: float) -> str:
    if value == 0.0:
        raise ConfigError(f"gripper speed is 0 m/s; allowed: above 0 to {SPEED_MAX:g}")
    return _millimetres("speed", value, 0.0, SPEED_MAX, "m/s")


def _force(value: float) -> str:
    low, high = FORCE_RANGE
    if not low <= value <= high:
        raise ConfigError(
            f"gripper force is {value:g} N; allowed: {low:g} to {high:g} N"
        )
    return f"{value:.3f}"


def _millimetres(name: str, value: float, low: float, high: float, unit: str) -> str:
    if not low <= value <= high:
        raise ConfigError(
            f"gripper {name} is {value:g} {unit}; allowed: {low:g} to {high:g} {unit}"
        )
    return f"{1e3 * value:.3f}"
