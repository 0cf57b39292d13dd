"""Messages for faults between a client and its cabinet."""

import errno
from typing import TYPE_CHECKING, Any

from dovetail.arms.fri_loss import QUALITIES, find_loss
from dovetail.errors import ArmError, ConfigError

if TYPE_CHECKING:
    from dovetail import _core

_AUT = 2
"""Operation mode without an enabling switch."""
_MONITORING_WAIT = 1
"""Session state below quality GOOD, in which no motion is commanded."""
_FAR_START = 3
"""Refusal of a motion that would begin where the arm cannot be."""
_KUKA_PORTS = "KUKA's cabinets send to 30200 to 30209"


def socket_error(error: OSError, host: str, port: int) -> ArmError | ConfigError:
    """Say why the UDP port cannot be had."""
    if error.errno == errno.EADDRINUSE:
        return ArmError(
            f"UDP port {port} is in use: another dovetail or FRI client listens there. "
            f"End it (`ss -ulpn` names it), or choose another port ({_KUKA_PORTS}) "
            "and let the cabinet send to that",
            "port_in_use",
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return ArmError(
            f"no permission to listen on UDP port {port}: ports below 1024 are the "
            f"system's; choose another ({_KUKA_PORTS})",
            "no_permission",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return ArmError(
            f"{host} is no address of this machine (`ip addr` lists them); 0.0.0.0 "
            "listens on all of them",
            "no_address",
        )
    return ConfigError(f"cannot listen on {host}:{port}: {error.strerror}")


def connection_error(
    servo: "_core.ServoLoop", host: str, port: int, version: str, settings: str
) -> ArmError:
    """Say why no motion is commanded, likely causes first.

    Args:
        servo: The loop that waited.
        host: Address it listens on.
        port: Port it listens on.
        version: FRI version it speaks.
        settings: What it expects of the cabinet's pace.
    """
    counts: dict[str, Any] = servo.counts()
    state = servo.state()
    if counts["received"] == 0:
        return ArmError(
            f"no cabinet: not one datagram has come to {host}:{port}. Check in this "
            "order: 1. the cabinet sends (the Java application runs and has made its "
            "FRI session; `dovetail cabinet` runs); 2. it sends to an address of this "
            f"machine and to port {port} (client address and port on remote in the "
            "application, --client); 3. no firewall drops UDP; 4. the cable is in the "
            "KONI or KLI interface that the application has configured, and `ping` "
            "reaches the cabinet",
            "no_cabinet",
        )
    if counts["foreign"] == counts["received"]:
        return ArmError(
            f"{counts['received']} datagrams came, the last from "
            f"{servo.last_stranger}, and none from the cabinet's address, which peer= "
            "pins: correct peer=, or find out who sends",
            "foreign",
        )
    loss = find_loss(servo, state)
    if loss is not None:
        return ArmError(loss.text, loss.reason, state)
    answered_none = counts["answered"] == 0 and state.session == 0
    if answered_none and counts["undecodable"]:
        return ArmError(
            f"{counts['undecodable']} datagrams came and none is FRI {version}: "
            f"{servo.last_undecodable()}. Set version= to what the cabinet "
            "speaks (its Sunrise OS): 1.15 (also 1.14, 1.16), 2.5 or 2.7",
            "version",
        )
    if state.refusal == 1:
        return ArmError(
            f"the cabinet wants a command every {state.send_period} ms x "
            f"{state.multiplier}, this arm was made for {settings}: give the same "
            "period on both sides",
            "period",
        )
    return _waiting_error(servo, state)


def _waiting_error(servo: "_core.ServoLoop", state: "_core.ServoState") -> ArmError:
    if state.refusal == _FAR_START:
        return ArmError(
            "the cabinet has begun a motion, and the measured position jumps from one "
            "message to the next, faster than a joint can go: look at the smartPAD, do "
            "not move the arm before",
            "start_position",
            state,
        )
    why = servo.diagnose() or _wait_reasons(state)
    return ArmError(
        f"the session has stayed in {state.session_name} (cabinet {servo.peer}, "
        f"quality {QUALITIES[state.quality]}): {why}",
        "session",
    )


def _wait_reasons(state: "_core.ServoState") -> str:
    """Return what to check, by the state that was reached."""
    if state.session == 0:
        return "the application has closed its FRI session; start it again"
    if state.session == _MONITORING_WAIT:
        return (
            "the cabinet does not see enough answers in time: check the load of this "
            "machine (realtime=True), the network, and the send period"
        )
    if state.session == 2:
        return (
            "no motion with an FRI overlay runs: start it in the Java application; in "
            "T1 hold the enabling switch; acknowledge safety stops"
        )
    return (
        "the motion does not begin: the drives must be active (enabling switch in T1), "
        "and the overlay's client command mode must be TORQUE"
    )


def motion_error(servo: "_core.ServoLoop", state: "_core.ServoState") -> ArmError:
    """Say how a motion ended without being asked to."""
    why = _end_text(servo, state)
    return ArmError(
        f"the motion has ended: {why} {_last_note(servo)}", "motion_ended", state
    )


def _end_text(servo: "_core.ServoLoop", state: "_core.ServoState") -> str:
    end = state.end
    if end.what:
        return (
            f"{end.what} was {end.before} and became {end.after} in the middle of it, "
            "and this arm does not command that. Usually the Java application has "
            "begun another overlay or session, or two cabinets send to this port: "
            "make it as before, then reset()."
        )
    loss = find_loss(servo, state)
    if loss is not None:
        return f"{loss.text}."
    if state.session == _MONITORING_WAIT:
        counts = servo.counts()
        return (
            f"the session is in {state.session_name}, quality "
            f"{QUALITIES[state.quality]}: too few answers came to the cabinet in time, "
            f"or its session was opened anew. {counts['missed']} of its messages were "
            f"missed here, {counts['received']} came. Look for lost datagrams (cable, "
            "switch, wireless) and for other load on this machine; realtime=yes in the "
            "address and a longer send period help. A reset goes on once the quality "
            "is GOOD."
        )
    where = f"the session went from COMMANDING_ACTIVE to {end.session_name}"
    if end.session_name == "COMMANDING_ACTIVE":
        where = "the cabinet has begun another motion"
    if end.safety:
        return (
            f"{where}, and the cabinet says safetyState {end.safety}, safety stop "
            f"level {end.safety - 1}: an emergency or safety stop, or a released "
            "enabling switch. Look at the safety messages on the smartPAD; reset() "
            "goes on when the cabinet is ready."
        )
    causes = [
        "the Java application ended its motion, or an error did: its message is on "
        "the smartPAD",
        "too few answers in time (see statistics())",
    ]
    if end.operation_mode != _AUT:
        causes.insert(0, "a released enabling switch")
    return (
        f"{where}; the cabinet says no safety stop (safetyState 0).{_doubts(end)} "
        f"Likely causes, in order: {', or '.join(causes)}. reset() goes on when the "
        "cabinet is ready."
    )


def _doubts(end: "_core.MotionEnd") -> str:
    """Say whether wrong positions came before a motion ended."""
    if not end.implausible:
        return ""
    joint = f", the last of A{end.joint + 1}" if end.joint >= 0 else ""
    return (
        f" {end.implausible} of its messages told a position that cannot be{joint}, "
        f"{1e3 * end.since_implausible:.0f} ms before the end: the cabinet may have "
        "ended it for that, or for what was sent back."
    )


def silence_error(
    servo: "_core.ServoLoop", state: "_core.ServoState", timeout: float
) -> ArmError:
    """Say why no cycle has come within the timeout [s]."""
    loss = find_loss(servo, state)
    if loss is not None:
        return ArmError(loss.text, loss.reason, state)
    return ArmError(
        f"no message of the cabinet that a command may answer for {timeout:g} s: the "
        f"session is in {state.session_name}, quality {QUALITIES[state.quality]}; is "
        "the cabinet still running, is the network up?",
        "silence",
        state,
    )


def stop_error(servo: "_core.ServoLoop", state: "_core.ServoState") -> ArmError:
    """Say which watchdog has stopped the arm."""
    return ArmError(
        f"the arm was stopped and is held: {state.stop_text}. Find the cause, then "
        f"clear() or reset(). {_last_note(servo)}",
        state.stop_reason,
        state,
    )


def _last_note(servo: "_core.ServoLoop") -> str:
    notes = servo.notes()
    return f"Last note: {notes[-1]}" if notes else ""
