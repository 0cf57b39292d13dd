"""Diagnosis of a lost connection to a cabinet: its last messages and usual causes."""

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from dovetail import _core

QUALITIES = ("POOR", "FAIR", "GOOD", "EXCELLENT")
"""Names of the connection's quality, 0 to 3."""
GONE = 0.3
"""Without a datagram for so long nothing is taken to come any more [s]."""


class Loss(NamedTuple):
    """Loss of the connection to a cabinet."""

    reason: str
    """One word: session_closed, silence, or unreadable."""
    text: str
    """Last message and its age, the change since, and its usual cause."""


def find_loss(servo: "_core.ServoLoop", state: "_core.ServoState") -> Loss | None:
    """Return the loss of the cabinet; None if it still sends, or never did.

    Args:
        servo: The loop that listened.
        state: What it last knew.
    """
    received = servo.counts()["received"]
    datagram, message = servo.since_datagram(), servo.since_message()
    if received == 0 or math.isinf(datagram):
        return None
    if math.isinf(message) and servo.last_not_finite():
        return _unreadable(servo, message)
    is_closed = state.last_session == 0 and not math.isinf(message)
    if datagram < GONE and not is_closed:
        return _unreadable(servo, message - datagram)
    if math.isinf(message):
        return None
    seen = (
        f"{received} datagrams came from {servo.peer}, the last {datagram:.1f} s ago, "
        f"in {state.last_session_name} with quality {QUALITIES[state.quality]}"
    )
    if is_closed:
        return Loss(
            "session_closed",
            f"the cabinet has closed its FRI session: {seen}. Usually the Java "
            "application has ended, by itself, by an error or by the smartPAD: look "
            "there for its message, and start it again",
        )
    return Loss(
        "silence",
        f"the cabinet has fallen silent without closing its session: {seen}; since "
        "then nothing. Usually the cable is out, the network is down, or the cabinet "
        "was switched off or its program killed: look at the plug's lights, `ping` "
        "the cabinet, then at the smartPAD",
    )


def _unreadable(servo: "_core.ServoLoop", age: float) -> Loss | None:
    """Return the loss where datagrams still come but cannot be read."""
    why = servo.last_undecodable()
    if not why or age < GONE:
        return None
    count = servo.counts()["undecodable"]
    if math.isinf(age):
        before = "none could ever be read"
    else:
        before = f"the last that could be read came {age:.1f} s before the newest"
    if field := servo.last_not_finite():
        return Loss(
            "unreadable",
            f"the cabinet sends values that are no numbers: {field} is not a finite "
            f"number. {count} datagrams could not be used, {before}. The FRI version "
            "is right. Usually a joint sensor or its referencing is lost, or a "
            "simulation has diverged: look at the smartPAD, restart the cabinet, do "
            "not move the arm before",
        )
    if math.isinf(age):
        return None  # a wrong version, most likely
    return Loss(
        "unreadable",
        f"datagrams go on coming and cannot be read any more: {count} of them, "
        f"{before}: {why}. The FRI version was right. Usually another program sends to "
        "this port, or something on the way changes datagrams",
    )
