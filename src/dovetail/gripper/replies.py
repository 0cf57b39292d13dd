"""The text protocol's other end: one command line in, answers out."""

import math
import re
from collections.abc import Callable

from dovetail.gripper.facts import FORCE_RANGE, SPEED_MAX, WIDTH_MAX, Code, Flag
from dovetail.gripper.fingers import Fingers

_COMMAND = re.compile(r"([A-Z]+)\((.*)\)")
_QUERY = re.compile(r"([A-Z]+)(?:\[(\d+)\])?\?")
_SETTING = re.compile(r"([A-Z]+)=(.*)")
_SPEED, _FORCE, _PULLBACK = 0.05, 20.0, 0.01


class _Refused(Exception):  # noqa: N818  (an answer, no error of ours)
    """A command is answered with a code."""

    def __init__(self, code: Code) -> None:
        self.code = code


class Replies:
    """Answers of the gripper, and its automatic messages."""

    def __init__(self, fingers: Fingers) -> None:
        """Speak for these fingers."""
        self._fingers = fingers
        self._sent: dict[str, tuple[float, float]] = {}
        self._is_verbose = False
        self._commands: dict[str, Callable[[list[str]], None]] = {
            "HOME": self._home,
            "MOVE": self._move,
            "GRIP": self._grip,
            "RELEASE": self._release,
            "STOP": lambda words: self._fingers.stop(),
            "FASTSTOP": self._fast_stop,
            "FSACK": lambda words: self._fingers.acknowledge(),
            "AUTOSEND": self._autosend,
        }

    def clear(self) -> None:
        """Forget what a client had asked to be sent."""
        self._sent.clear()

    def to(self, line: str) -> list[str]:
        """Return the answer to a line."""
        if match := _QUERY.fullmatch(line):
            name = line[:-1]
            value = self._value(match[1], match[2])
            if value is None:
                return [f"ERR {name} {self._code(Code.UNKNOWN_COMMAND)}"]
            return [f"{name}={value}"]
        if match := _SETTING.fullmatch(line):
            return self._set(match[1], match[2])
        match = _COMMAND.fullmatch(line)
        if match is None or match[1] not in self._commands:
            name = match[1] if match else re.sub(r"[^A-Z]", "", line)[:20] or "?"
            return [f"ERR {name} {self._code(Code.UNKNOWN_COMMAND)}"]
        name, words = match[1], [word.strip() for word in match[2].split(",")]
        given_up = self._fingers.motion if name == "FASTSTOP" else None
        try:
            self._commands[name](words if match[2].strip() else [])
        except _Refused as refusal:
            return [f"ERR {name} {self._code(refusal.code)}"]
        aborted = [f"ERR {given_up} {self._code(Code.ABORTED)}"] if given_up else []
        return [*aborted, f"ACK {name}"]

    def spontaneous(self, now: float) -> list[str]:
        """Return the lines that are due without a command."""
        lines = []
        if finished := self._fingers.finish():
            name, code = finished
            lines.append(
                f"FIN {name}" if code is None else f"ERR {name} {self._code(code)}"
            )
        for name, (interval, due) in self._sent.items():
            if now >= due:
                self._sent[name] = (interval, now + interval)
                lines.append(f"@{name}={self._value(name, None)}")
        return lines

    def _code(self, code: Code) -> str:
        words = {Code.FAILED: "E_CMD_FAILED", Code.AXIS_BLOCKED: "E_AXIS_BLOCKED"}
        return words.get(code, str(int(code))) if self._is_verbose else str(int(code))

    def _value(self, name: str, index: str | None) -> str | None:
        fingers = self._fingers
        flags = {
            Flag.REFERENCED: fingers.is_homed,
            Flag.MOVING: fingers.speed() != 0.0,
            Flag.AXIS_STOPPED: fingers.motion is None,
            Flag.FAST_STOP: fingers.is_fast_stopped,
        }
        if name == "SYSFLAGS":
            bits = [0] * 21
            for flag, is_set in flags.items():
                bits[flag] = int(is_set)
            if index is None:
                return "[" + ",".join(map(str, bits)) + "]"
            return str(bits[int(index)]) if int(index) < len(bits) else None
        values = {
            "POS": f"{1e3 * fingers.width():.3f}",
            "SPEED": f"{1e3 * fingers.speed():.3f}",
            "FORCE": f"{fingers.force:.3f}",
            "GRIPSTATE": str(int(fingers.state)),
            "PWT": f"{1e3 * fingers.tolerance:.3f}",
            "CLT": f"{1e3 * fingers.clamping_travel:.3f}",
            "VERBOSE": str(int(self._is_verbose)),
            "VERSION": '"simulated"',
            "DEVTYPE": '"simulated WSG 50-110"',
            "SN": "0",
            "TAG": '""',
            "TEMP": "25.0",
        }
        return values.get(name) if index is None else None

    def _set(self, name: str, word: str) -> list[str]:
        if name == "VERBOSE" and word in ("0", "1"):
            self._is_verbose = word == "1"
        elif name in ("PWT", "CLT"):
            try:
                value = 1e-3 * _number(word, 0.0, 1e3 * WIDTH_MAX)
            except _Refused as refusal:
                return [f"ERR {name} {self._code(refusal.code)}"]
            if name == "PWT":
                self._fingers.tolerance = value
            else:
                self._fingers.clamping_travel = value
        else:
            return [f"ERR {name} {self._code(Code.UNKNOWN_COMMAND)}"]
        return [f"{name}={word}"]

    def _require_free(self, name: str) -> None:
        if (code := self._fingers.refuse(name)) is not None:
            raise _Refused(code)

    def _home(self, words: list[str]) -> None:
        direction = _argument(words, 0, 1.0, 0.0, 1.0)
        self._require_free("HOME")
        self._fingers.home(direction == 1.0)

    def _move(self, words: list[str]) -> None:
        if not words:
            raise _Refused(Code.NOT_ENOUGH_PARAMETERS)
        width = _argument(words, 0, 0.0, 0.0, 1e3 * WIDTH_MAX)
        speed = _speed(words, 1)
        self._require_free("MOVE")
        self._fingers.move(1e-3 * width, speed)

    def _grip(self, words: list[str]) -> None:
        force = _argument(words, 0, _FORCE, *FORCE_RANGE)
        width = None
        if len(words) > 1:
            width = 1e-3 * _argument(words, 1, 0.0, 0.0, 1e3 * WIDTH_MAX)
        speed = _speed(words, 2)
        self._require_free("GRIP")
        self._fingers.grip(force, width, speed)

    def _release(self, words: list[str]) -> None:
        pullback = _argument(words, 0, 1e3 * _PULLBACK, 0.0, 1e3 * WIDTH_MAX)
        speed = _speed(words, 1)
        self._require_free("RELEASE")
        self._fingers.release(1e-3 * pullback, speed)

    def _fast_stop(self, words: list[str]) -> None:
        self._fingers.fast_stop()

    def _autosend(self, words: list[str]) -> None:
        if len(words) < 2:
            raise _Refused(Code.NOT_ENOUGH_PARAMETERS)
        name = words[0].strip('"')
        if name not in ("POS", "SPEED", "FORCE", "GRIPSTATE"):
            raise _Refused(Code.INVALID_PARAMETER)
        interval = 1e-3 * _number(words[1], 0.0, 1e6)
        self._sent.pop(name, None)
        if interval > 0.0:
            self._sent[name] = (interval, 0.0)


def _speed(words: list[str], index: int) -> float:
    """Return an optional speed argument [m/s]."""
    value = _argument(words, index, 1e3 * _SPEED, 0.0, 1e3 * SPEED_MAX)
    if value == 0.0:
        raise _Refused(Code.RANGE)
    return 1e-3 * value


def _argument(
    words: list[str], index: int, default: float, low: float, high: float
) -> float:
    return default if index >= len(words) else _number(words[index], low, high)


def _number(word: str, low: float, high: float) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise _Refused(Code.FORMAT) from error
    if not (math.isfinite(value) and low <= value <= high):
        raise _Refused(Code.RANGE)
    return value
