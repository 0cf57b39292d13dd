"""Meanings of a Franka's errors: the likely cause, and what to do."""

import re

from dovetail.errors import ArmError

_CAUSES = {
    "controller_torque_discontinuity": "the commanded torque changed by more than 1000 "
    "Nm/s between two commands that arrived: commands were lost; see the success rate "
    "above, use a real-time kernel and realtime=yes, and a cable without a switch",
    "communication_constraints_violation": "too few commands arrived in time: use a "
    "real-time kernel and realtime=yes, set the processor to performance, and use a "
    "cable from this machine to the control box without a switch",
    "joint_velocity_violation": "a joint was faster than its limit at that position: "
    "something pushed the arm, or its load is not what was declared",
    "joint_position_limits_violation": "a joint passed its limit: something pushed the "
    "arm, or its load is not what was declared; move it back by hand",
    "joint_reflex": "the external torque of a joint was above the collision threshold: "
    "something touched the arm beside its tool, or its load is not what was declared",
    "cartesian_reflex": "the external force at the tool was above the collision "
    "threshold: contact was too hard; lower near_speed or near_press",
    "cartesian_velocity_violation": "the tool was faster than 3 m/s or 2.5 rad/s: "
    "something pushed the arm",
    "cartesian_position_limits_violation": "the tool left a space that Desk sets: "
    "move the fixture, or change that space",
    "self_collision_avoidance_violation": "the arm came too near to itself: choose "
    "another start or fixture",
    "tau_j_range_violation": "a joint's torque was above its limit: the load is too "
    "heavy, or not what was declared",
    "power_limit_violation": "the motors took more power than is allowed: move more "
    "slowly, or with less load",
    "instability_detected": "the arm oscillated: its load is not what was declared, or "
    "its model is not this arm's",
    "force_control_safety_violation": "a safety limit of torque control was passed: "
    "see the arm's log in Desk",
}

_CONNECTIONS = (
    (
        "refused",
        "fci_off",
        "the control box refuses: open Desk and activate FCI; is the address the "
        "control box's (shop floor or robot network), and the brakes open?",
    ),
    (
        "version",
        "version",
        "the arm's system image and this libfranka do not fit: pip install another "
        "pylibfranka (docs/franka.md has the table), or update the arm in Desk",
    ),
    (
        "control token",
        "other_client",
        "another client has control: take it in Desk (Control, Request), or close that "
        "client",
    ),
    (
        "already",
        "other_client",
        "another client is connected: close it; one program at a time commands an arm",
    ),
    (
        "timeout",
        "no_route",
        "no answer: check the cable, this machine's address (the same subnet as the "
        "control box), and `ping`",
    ),
    (
        "route",
        "no_route",
        "there is no way to that address: check the cable, and that this machine has "
        "an address in the control box's subnet",
    ),
)

MODES = {
    "UserStopped": (
        "user_stopped",
        "the arm is stopped by its user: press the enabling device, or release the "
        "activation device, until the arm's light is blue or green",
    ),
    "Guiding": (
        "guiding",
        "the arm is being guided by hand: let go of its buttons, until its light is "
        "blue or green",
    ),
    "Reflex": (
        "reflex",
        "a reflex has stopped the arm: look why, then give recover=yes in the address "
        "once, or acknowledge it in Desk",
    ),
    "Move": ("other_client", "another motion runs: end that program first"),
    "Other": (
        "not_ready",
        "the arm is not ready: open the brakes and activate FCI in Desk",
    ),
}
"""Modes of the arm in which no motion can begin: a word for programs, and a remedy."""


def names_in(text: str) -> list[str]:
    """Return the names of errors in a message of libfranka."""
    quoted = re.findall(r'"([a-z_0-9]+)"', text)
    return [name for name in quoted if name in _CAUSES] or quoted


def motion_ended(text: str, success_rate: float, state: object = None) -> ArmError:
    """Return the error of a motion that the arm has ended.

    Args:
        text: libfranka's message.
        success_rate: Share of the last 100 commands that arrived in time.
        state: State that the arm last had.
    """
    names = names_in(text)
    said = "; ".join(
        f"{name}: {_CAUSES.get(name, 'see the manual of FCI, Errors')}"
        for name in names
    )
    return ArmError(
        f"the arm has ended the motion: {said or text}. Of the last 100 commands "
        f"{100.0 * success_rate:.0f} arrived in time. The arm is held by its brakes or "
        "its own controller; recover=yes in the address ends the reflex",
        names[0] if names else "motion_ended",
        state,
    )


def connection_lost(text: str, host: str) -> ArmError:
    """Return the error of a connection that ended in a motion.

    Args:
        text: libfranka's message.
        host: Address of the control box.
    """
    return ArmError(
        f"the control box at {host} is not heard any more ({text}): it has stopped the "
        "arm, as no command arrives. Look at the cable, the network and the control "
        "box; then reset() begins anew, with recover=yes in the address",
        "connection_lost",
    )


def not_connected(text: str, host: str) -> ArmError:
    """Return the error of a connection that could not be made.

    Args:
        text: libfranka's message.
        host: Address of the control box.
    """
    for word, reason, remedy in _CONNECTIONS:
        if word in text.lower():
            return ArmError(f"no arm at {host}: {remedy} ({text})", reason)
    return ArmError(f"no arm at {host}: {text}", "no_arm")
