"""Checks of an arm behind FRI before it is trusted.

Each check moves the arm little and slowly; between them it is held where it is. The
checks of delay, springs and gravity error are in `diagnosis`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.period import DEFAULT_PERIOD
from dovetail.control.proven import DECLARED
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.check import Check, signed
from dovetail.doctor.diagnosis import (
    check_dynamics,
    check_period_proven,
    overload_hint,
)
from dovetail.doctor.excitation import excitation_gains, simulated_step
from dovetail.doctor.gravity_error import worst_miss
from dovetail.doctor.standstill import (
    check_as_configured,
    check_standstill,
    last_words,
    measure_standstill,
)
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.types import JOINTS, Array, Vec3, Vec7
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.workcell import Workcell

DRIFT_MAX = 0.005
"""Largest drift of the tool while it is held [m]."""
GRAVITY_SCALE = (0.6, 1.5)
"""Measured over modelled gravity torque: published models differ by a third."""
GRAVITY_MIN = 5.0
"""Largest gravity torque of a joint below which nothing is said [Nm]."""
LOSS_MAX = 0.001
"""Largest share of lost messages [1]."""
TURN = 0.03
"""Angle by which each joint is turned [rad]."""
TURN_MIN, WRONG_MAX = 0.3, 0.3
"""Shares of `TURN`: what counts as turned, and what as turned the wrong way [1]."""
PUSH_FORCE = 15.0
"""Push of a simulated cabinet, along +x [N]."""
PUSH_MIN = 5.0
"""Smallest estimated force that counts as a push [N]."""
HOLD_TIME, TURN_TIME, PUSH_TIME = 3.0, 0.6, 4.0
_LAST = "messages"
_RESTING = ("", "period")  # what is done next is to hold the arm
_STEP = 0.05
_MODES = ("T1", "T2", "AUT")
_QUALITIES = ("poor", "fair", "good", "excellent")

Ask = Callable[[str], bool]
"""Asks the person at the arm and waits; False ends the checks."""


class HeldState(NamedTuple):
    """State of the arm while it was held."""

    q: Vec7
    """Mean configuration [rad]."""
    drift: float
    """Largest distance of the tool from where it was at first [m]."""
    measured: Vec7
    """Mean measured torque on the joints [Nm]."""
    external: Vec7
    """Mean external torque on the joints [Nm]."""
    log: Array
    """Cycle log."""


def run_fri_checks(
    address: FriAddress,
    ask: Ask | None,
    declared: dict[str, Any] | None = None,
    robot: str = DEFAULT_ROBOT,
    facts: CellConfig | None = None,
) -> Iterator[Check]:
    """Yield every check of an arm behind a cabinet as soon as it is done.

    Args:
        address: Own address that the cabinet sends to.
        ask: Asks before the arm is moved; with None the arm is moved without asking,
            and only a simulated cabinet is pushed.
        declared: Largest declared errors of model and loop; None is `proven.DECLARED`.
        robot: Robot model of the arm, see `robots.find`.
        facts: Of its cell file.

    Raises:
        DovetailError: The arm cannot be had.
    """
    if not _may(
        ask,
        "The arm will be held where it is. Start the Java application, hold the "
        "enabling switch",
    ):
        return
    period, declared = address.period or DEFAULT_PERIOD, declared or DECLARED
    cell = find_cell(robot=robot, cell=facts)
    config = EnvConfig(period=period, force_damping=0.0, **declared)
    osc, limits = make_settings(cell, config, is_hardware=address.margins == "hardware")
    arm = _build(address, cell, *excitation_gains(osc, limits), period)
    try:
        arm.connect()
        yield check_connection(arm, address)
        name = ""
        try:
            for check in _checks_in_motion(arm, address, ask, declared):
                name = check.name
                yield check
        except ArmError as error:
            last = last_words(arm, is_resting=name in _RESTING)
            text = f"{error} {last} {'' if error.reason == 'gaps' else overload_hint()}"
            yield Check("end of the motion", "broken", text.strip())
        if name != _LAST:
            return
    finally:
        arm.close()
    if _may(
        ask,
        "The arm will be held once more, with the controller that tasks run with. "
        "Start the application's motion again",
    ):
        yield _hold_as_configured(address, cell, osc, limits, period)


def _build(
    address: FriAddress,
    cell: Workcell,
    osc: OscConfig,
    limits: LimitConfig,
    period: float,
) -> FriArm:
    task = TaskSpec.parse("XYZABC:hold")
    # The checks find out whether the measured torque follows the commanded one.
    timeout = address.target_timeout
    watchdog = WatchdogConfig(target_timeout=timeout, torque_error=math.inf)
    settings = ControllerSettings(osc=osc, limits=limits, task=task, period=period)
    return address.build(cell, settings, watchdog)


def _checks_in_motion(
    arm: FriArm, address: FriAddress, ask: Ask | None, declared: dict[str, Any]
) -> Iterator[Check]:
    yield check_period_proven(arm.facts.period)
    rest = hold(arm, arm.monitoring().q, HOLD_TIME)
    yield check_standstill(measure_standstill(rest.log, arm.facts.period))
    yield check_gravity(arm, rest, address)
    yield check_drift(arm, rest, declared)
    turns = f"turned by {TURN:g} rad and back"
    if not _may(ask, f"Every joint will be pushed to and fro, and {turns}"):
        return
    is_simulated = arm.facts.traits.is_simulated
    step = simulated_step(arm.facts.period) if is_simulated else 0.0
    yield from check_dynamics(arm, rest.q, declared, integration_step=step)
    yield check_turns(arm, rest.q)
    yield check_push(arm, rest.q, address, ask)
    yield check_messages(arm)


def _hold_as_configured(
    address: FriAddress,
    cell: Workcell,
    osc: OscConfig,
    limits: LimitConfig,
    period: float,
) -> Check:
    """Hold the arm where it stands with a task's settings, walls apart."""
    arm = _build(address, cell, osc, replace(limits, walls=False), period)
    try:
        arm.connect()
        return check_as_configured(arm, lambda: last_words(arm, is_resting=True))
    finally:
        arm.close()


def check_connection(arm: FriArm, address: FriAddress) -> Check:
    """Describe the connection: FRI version, peer, period, mode and quality."""
    state, statistics = arm.monitoring(), arm.statistics()
    return Check(
        "connection",
        "ok",
        f"FRI {address.version} from {statistics['peer']}, "
        f"{state.send_period} ms x {state.multiplier}, {_MODES[state.operation_mode]}, "
        f"quality {_QUALITIES[state.quality]}",
    )


def hold(arm: FriArm, q: Vec7, seconds: float) -> HeldState:
    """Hold the arm at q [rad] and look at it; the first half second is not counted."""
    target = _core.Target(joint_mode=True, q_d=q)
    positions, states, logs = [], [], []
    for i in range(round(seconds / _STEP)):
        reached = arm.step(target, _STEP)
        if i * _STEP >= min(0.5, seconds / 2.0):
            positions.append(reached.tool.position)
            logs.append(reached.log)
            states.append(arm.monitoring())
    drift = np.linalg.norm(np.array(positions) - positions[0], axis=1).max()
    q_mean, measured, external = (
        np.mean(values, axis=0)
        for values in zip(
            *((s.q, s.tau_measured, s.tau_external) for s in states), strict=True
        )
    )
    return HeldState(q_mean, float(drift), measured, external, np.vstack(logs))


def check_gravity(arm: FriArm, rest: HeldState, address: FriAddress) -> Check:
    """Compare the measured torque at rest with the model's gravity: sign and scale."""
    name = "gravity, measured torque"
    gravity = arm.facts.robot.chain().gravity(rest.q)
    if not np.isfinite(rest.measured).all():
        return Check(name, "broken", "the cabinet sends no measured torque")
    if np.abs(gravity).max() < GRAVITY_MIN:
        return Check(
            name,
            "missing",
            f"no joint carries {GRAVITY_MIN:g} Nm here: start with the arm stretched "
            "out a little",
            is_essential=False,
        )
    scale = float(rest.measured @ gravity / (gravity @ gravity))
    detail = (
        f"{scale:+.2f} times the model's ({signed(rest.measured - gravity)} Nm off)"
    )
    low, high = GRAVITY_SCALE
    if scale < 0.0:
        other = -address.measured_sign
        return Check(
            name,
            "broken",
            f"{detail}: the sign on the wire is the other one; add measured_sign="
            f"{other} to the address, and find out what commanded_sign is",
        )
    if not low <= scale <= high:
        return Check(name, "broken", f"{detail}; check the load data and the tool")
    return Check(name, "ok", detail)


def check_drift(arm: FriArm, rest: HeldState, declared: dict[str, Any]) -> Check:
    """Check drift and external torque, which is missed gravity, of the held arm."""
    if not np.isfinite(rest.external).all():
        return Check("hold", "broken", "the cabinet sends no external torque")
    worst, allowed, is_outside = worst_miss(
        arm.facts.robot, rest.q, rest.external, declared
    )
    detail = (
        f"drift {1e3 * rest.drift:.2f} mm, external torque at most "
        f"{rest.external[worst]:+.2f} Nm at {JOINTS[worst]}"
    )
    if rest.drift <= DRIFT_MAX and not is_outside:
        return Check("hold", "ok", detail)
    return Check(
        "hold",
        "broken",
        f"{detail}; allowed: {1e3 * DRIFT_MAX:g} mm and "
        f"{allowed:.1f} Nm: check the load data",
    )


def check_turns(arm: Arm, q: Vec7) -> Check:
    """Turn every joint a little each way and check that it follows."""
    reached = np.zeros((2, 7))
    for joint in range(7):
        for side, sign in enumerate((1.0, -1.0)):
            turned = turn(arm, q, joint, sign)
            reached[side, joint] = turned
            if turned < -WRONG_MAX:
                arm.stop()
                return Check(
                    "torques",
                    "broken",
                    f"{JOINTS[joint]} turned the wrong way by {-turned * TURN:.3f} rad "
                    "and was stopped; end the motion, do not use this arm",
                )
    worst = reached.min(axis=0)
    stuck = [
        name for name, share in zip(JOINTS, worst, strict=True) if share < TURN_MIN
    ]
    detail = f"turned {signed(100.0 * worst, 0)} % of {TURN:g} rad"
    if stuck:
        return Check(
            "torques",
            "broken",
            f"{detail}; {', '.join(stuck)} stayed behind: friction, a joint limit, or "
            "something in the way",
        )
    return Check("torques", "ok", detail)


def turn(arm: Arm, q: Vec7, joint: int, sign: float) -> float:
    """Turn one joint and back; return the way it went over the way asked [1]."""
    there = q.copy()
    there[joint] += sign * TURN
    gone = 0.0
    for q_d in (there, q):
        target = _core.Target(joint_mode=True, q_d=q_d)
        for _ in range(round(TURN_TIME / _STEP)):
            state = arm.step(target, _STEP)
            share = sign * float(state.q[joint] - q[joint]) / TURN
            if share < -WRONG_MAX:
                return share
            gone = max(gone, share)
    return gone


def check_push(arm: FriArm, q: Vec7, address: FriAddress, ask: Ask | None) -> Check:
    """Check that a push away from the base is estimated in that direction."""
    name = "push, external torque"
    before = hold(arm, q, 1.0).external
    if address.control is not None:
        _push_simulated(address.control)
    elif not _may(
        ask, f"Push the gripper away from the base for {PUSH_TIME:g} s", False
    ):
        return Check(name, "missing", "nobody pushed", is_essential=False)
    target = _core.Target(joint_mode=True, q_d=q)
    force, largest = np.zeros(3), 0.0
    for _ in range(round(PUSH_TIME / _STEP)):
        state = arm.step(target, _STEP)
        pushed = estimate_force(arm, state.q, arm.monitoring().tau_external - before)
        if (size := float(np.linalg.norm(pushed))) > largest:
            force, largest = pushed, size
    detail = f"felt {signed(force)} N"
    if largest < PUSH_MIN:
        return Check(name, "missing", f"{detail}: no push was felt", is_essential=False)
    if force[0] < -0.5 * largest:
        return Check(
            name,
            "broken",
            f"{detail}, towards the base: add external_sign="
            f"{-address.external_sign} to the address",
        )
    if force[0] < 0.5 * largest:
        return Check(name, "broken", f"{detail}, not away from the base: push again")
    return Check(name, "ok", f"{detail}, away from the base")


def estimate_force(arm: FriArm, q: Vec7, tau: Vec7) -> Vec3:
    """Return the force at the TCP [N], world axes, that explains joint torques [Nm]."""
    jacobian = arm.facts.robot.chain().jacobian(q)
    wrench = np.linalg.lstsq(jacobian.T, tau, rcond=0.05)[0]
    return np.asarray(wrench[:3], dtype=float)


def check_messages(arm: FriArm) -> Check:
    """Check the share of lost messages, and the time of the answers."""
    statistics = arm.statistics()
    counts, times = statistics["counts"], statistics["times"]
    lost, received = counts["missed"], max(1, counts["received"])
    reply = times["reply_time"]
    detail = (
        f"{received} received, {lost} lost, reply p50 {1e6 * reply['p50']:.0f} us, "
        f"p99.9 {1e6 * reply['p999']:.0f} us"
    )
    if lost > LOSS_MAX * received:
        return Check(
            "messages",
            "broken",
            f"{detail}; allowed: {100 * LOSS_MAX:g} % lost: use a cable of its own, "
            "realtime=yes, no power saving",
        )
    return Check("messages", "ok", detail)


def _push_simulated(control: str) -> None:
    from dovetail.arms.cabinet_control import CabinetControl

    port = CabinetControl(control)
    try:
        port.request("push", force=[PUSH_FORCE, 0.0, 0.0], duration=0.5 * PUSH_TIME)
    finally:
        port.close()


def _may(ask: Ask | None, question: str, without: bool = True) -> bool:
    return without if ask is None else ask(question)
