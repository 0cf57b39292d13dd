"""Facts shared by driver and simulated gripper: ranges, states, meanings of codes."""

from enum import IntEnum

PORT = 1000
"""TCP port of the gripper's command interface."""
WIDTH_MAX = 0.110
"""Opening between the fingers at full stroke [m]."""
SPEED_MAX = 0.420
"""Fastest finger speed that a public controller uses [m/s]."""
FORCE_RANGE = (5.0, 80.0)
"""Nominal grip forces [N]."""
LINE_MAX = 512
"""Longest line of the text protocol that is accepted [bytes]."""


class GripState(IntEnum):
    """State of the fingers, as GRIPSTATE? answers."""

    IDLE = 0
    GRASPING = 1
    NO_PART = 2
    PART_LOST = 3
    HOLDING = 4
    RELEASING = 5
    POSITIONING = 6
    ERROR = 7


class Flag(IntEnum):
    """Bits of SYSFLAGS that are used here."""

    REFERENCED = 0
    MOVING = 1
    AXIS_STOPPED = 6
    TARGET_REACHED = 7
    FAST_STOP = 12


class Code(IntEnum):
    """Error codes that are looked at by name."""

    NOT_INITIALISED = 3
    ALREADY_RUNNING = 4
    NOT_ENOUGH_PARAMETERS = 13
    UNKNOWN_COMMAND = 14
    FORMAT = 15
    ACCESS_DENIED = 16
    FAILED = 18
    ABORTED = 19
    INVALID_PARAMETER = 24
    RANGE = 28
    AXIS_BLOCKED = 29


MEANINGS = (
    *("success", "not available", "no sensor", "not initialised", "already running"),
    *("feature not supported", "inconsistent data", "timeout", "read error"),
    *("write error", "insufficient resources", "checksum", "no parameter expected"),
    *("not enough parameters", "unknown command", "format", "access denied"),
    *("already open", "failed", "aborted", "invalid handle", "not found", "not open"),
    *("IO error", "invalid parameter", "index out of bounds", "pending", "overrun"),
    *("range", "axis blocked", "file exists"),
)
"""Meaning of each code from 0."""

NAMES = {"E_CMD_FAILED": Code.FAILED, "E_AXIS_BLOCKED": Code.AXIS_BLOCKED}
"""Codes that are known to come as words where VERBOSE is on."""

REMEDIES = {
    Code.NOT_INITIALISED: "home it first",
    Code.ALREADY_RUNNING: "wait for the motion, or stop it; release before a new grip",
    Code.ACCESS_DENIED: "a fast stop may be active: look why, then acknowledge it",
    Code.FAILED: "no part was found, or there is nothing to release",
    Code.ABORTED: "it was stopped",
    Code.RANGE: "the value is outside the gripper's own limits",
    Code.AXIS_BLOCKED: "something is between the fingers",
}
"""Remedy for a code."""
_REMEDY_OF: dict[int, str] = {int(code): text for code, text in REMEDIES.items()}


def describe(code: int | None, word: str) -> str:
    """Return a code, or the word that came in its place, with meaning and remedy."""
    if code is None or not 0 <= code < len(MEANINGS):
        return word
    remedy = _REMEDY_OF.get(code)
    return f"{MEANINGS[code]} (code {code})" + (f": {remedy}" if remedy else "")
