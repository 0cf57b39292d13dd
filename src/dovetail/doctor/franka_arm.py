"""Checks of a Franka before it is trusted.

What can be seen of it at rest is checked first. Then it is held where it is, and each
joint is moved a little and slowly.
"""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dovetail import _core
from dovetail.arms.franka.arm import FrankaAddress, FrankaArm
from dovetail.arms.franka.at_rest import Rest
from dovetail.arms.franka.load import LoadError, measure_load
from dovetail.arms.franka.loop import PERIOD, PRIORITY
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.proven import DECLARED
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.distribution import installed_version
from dovetail.doctor.check import Check, signed
from dovetail.doctor.diagnosis import check_dynamics
from dovetail.doctor.excitation import excitation_gains
from dovetail.doctor.fri_arm import (
    DRIFT_MAX,
    GRAVITY_MIN,
    LOSS_MAX,
    TURN,
    Ask,
    check_turns,
)
from dovetail.doctor.gravity_error import NOTHING, check_missed, worst_miss
from dovetail.doctor.standstill import (
    AS_CONFIGURED,
    check_as_configured,
    check_standstill,
    measure_standstill,
    watch,
)
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose, quat_about_z
from dovetail.robots.missed_load import declared_load
from dovetail.robots.robot import Robot
from dovetail.types import JOINTS
from dovetail.workcell.cell_config import CellConfig
from dovetail.workcell.workcell import Workcell

GRAVITY_SHARE = (0.8, 1.2)
"""Measured over modelled gravity torque: the maker publishes the model [1]."""
HOLD_TIME = 3.0
"""Time for which the arm is held, and its loop is watched [s]."""
_HERE = "docs/franka.md, Before the first motion"


def run_franka_checks(
    address: FrankaAddress,
    ask: Ask | None,
    declared: dict[str, Any] | None = None,
    robot: str = "fr3",
    facts: CellConfig | None = None,
) -> Iterator[Check]:
    """Yield every check of a Franka as soon as it is done.

    Args:
        address: The arm's.
        ask: Asks before the arm is moved; with None it is moved without asking.
        declared: Largest declared errors of model and loop; None is `proven.DECLARED`.
        robot: Robot model of the arm, see `robots.find`.
        facts: Of its cell file.

    Raises:
        DovetailError: The arm cannot be had.
    """
    yield check_machine(is_needed=address.realtime)
    question = "The arm will be held where it is, by torques. Keep a hand at the stop"
    if ask is not None and not ask(question):
        return
    declared = declared or DECLARED
    cell = find_cell(robot=robot, cell=facts)
    config = EnvConfig(period=PERIOD, force_damping=0.0, **declared)
    osc, limits = make_settings(cell, config, is_hardware=address.margins == "hardware")
    try:
        arm = _build(address, cell, *excitation_gains(osc, limits))
    except LoadError as error:
        yield Check("load", "broken", str(error))
        return
    try:
        yield from _check_at_rest(arm, declared)
        yield from _check_in_motion(arm, ask, declared)
    except ArmError as error:
        yield Check("end of the motion", "broken", str(error))
        return
    finally:
        arm.close()
    question = "The arm will be held once more, with the controller that tasks run with"
    if ask is None or ask(question):
        yield _hold_as_configured(address, cell, osc, limits)


def _hold_as_configured(
    address: FrankaAddress, cell: Workcell, osc: OscConfig, limits: LimitConfig
) -> Check:
    """Hold the arm where it stands with a task's settings, walls apart."""
    try:
        arm = _build(address, cell, osc, replace(limits, walls=False))
    except ArmError as error:
        return Check(AS_CONFIGURED, "broken", str(error))
    try:
        _stay(arm)
        return check_as_configured(arm)
    except ArmError as error:
        return Check(AS_CONFIGURED, "broken", str(error))
    finally:
        arm.close()


def _build(
    address: FrankaAddress, cell: Workcell, osc: OscConfig, limits: LimitConfig
) -> FrankaArm:
    task = TaskSpec.parse("XYZABC:hold")
    settings = ControllerSettings(osc=osc, limits=limits, task=task, period=PERIOD)
    return address.build(cell, settings, ask_model=True)


def _stay(arm: FrankaArm) -> None:
    """Reset the arm to where it is: nothing is near, so that it is not lifted."""
    q = arm.rest.q
    below = arm.facts.robot.tool_pose(q).position - np.array([0.0, 0.0, 1.0])
    arm.reset(q, Pose(below, quat_about_z(0.0)))


def _check_at_rest(arm: FrankaArm, declared: dict[str, Any]) -> Iterator[Check]:
    robot, rest = arm.facts.robot, arm.rest
    yield check_connection(arm)
    yield check_load(robot, rest)
    yield check_model(robot, rest, declared)
    yield check_sensors(robot, rest)
    if rest.is_measured:
        spread, name = np.full(7, 0.1), "external torque"
        yield check_missed(robot, rest.q, rest.external, spread, declared, name)


def _check_in_motion(
    arm: FrankaArm, ask: Ask | None, declared: dict[str, Any]
) -> Iterator[Check]:
    q = arm.rest.q
    _stay(arm)
    before = dict(arm.statistics()["counts"])
    log = watch(arm, _core.Target(joint_mode=True, q_d=q), HOLD_TIME)
    yield check_loop(arm, before)
    yield check_standstill(measure_standstill(log, PERIOD))
    yield check_hold(log)
    question = f"Every joint will be pushed to and fro, and turned by {TURN:g} rad"
    if ask is not None and not ask(question):
        return
    yield from check_dynamics(arm, q, declared, integration_step=0.0)
    yield check_turns(arm, q)


def check_machine(
    *, is_needed: bool, realtime: Path = Path("/sys/kernel/realtime")
) -> Check:
    """Check this machine's kernel, and its user's right to real-time priority.

    Args:
        is_needed: The address insists on it.
        realtime: File by which a PREEMPT_RT kernel names itself.
    """
    name = "real time"
    may, is_kernel = _may_have_priority(), realtime.is_file()
    detail = (
        f"the kernel {'has' if is_kernel else 'lacks'} PREEMPT_RT, priority "
        f"{PRIORITY} is {'allowed' if may else 'not allowed'}"
    )
    if is_kernel and may:
        return Check(name, "ok", detail)
    return Check(name, "missing", f"{detail}: see {_HERE}", is_needed)


def _may_have_priority() -> bool:
    """Return whether this thread may have the loop's priority, by a trial."""
    usual = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, *usual)
    return True


def check_connection(arm: FrankaArm) -> Check:
    """Say what was connected to."""
    library = installed_version("pylibfranka")
    return Check(
        "connection",
        "ok",
        f"{arm.facts.address} by libfranka {library}, which both ends speak; its mode "
        "was idle",
    )


def check_load(robot: Robot, rest: Rest) -> Check:
    """Put the load that the arm compensates, and shows, beside the cell's."""
    mass, com = declared_load(robot)
    detail = (
        f"the arm compensates {rest.mass:.2f} kg at {signed(1e3 * rest.com, 0)} mm, "
        f"{rest.hand:.2f} kg of it Desk's end effector; the cell says {mass:.2f} kg at "
        f"{signed(1e3 * com, 0)} mm"
    )
    missed = rest.external if rest.is_measured else rest.held
    assert missed is not None
    found, is_load = measure_load(robot, rest, missed)
    if is_load:
        return Check("load", "ok", f"{detail}; its torques show {found:.2f} kg")
    if np.abs(missed).max() <= NOTHING:
        return Check("load", "ok", f"{detail}; its torques show no other")
    text = (
        f"{detail}; what hangs there is not known, as no load explains the torques at "
        f"rest, {signed(missed)} Nm beyond it: let nothing touch the arm, and weigh it"
    )
    return Check("load", "missing", text, is_essential=False)


def check_model(robot: Robot, rest: Rest, declared: dict[str, Any]) -> Check:
    """Compare the gravity of the arm's own model with ours."""
    assert rest.gravity is not None
    name = "gravity, arm's model"
    error = rest.gravity - np.asarray(robot.chain().gravity(rest.q))
    joint, allowed, is_outside = worst_miss(robot, rest.q, error, declared)
    detail = f"{signed(error, 2)} Nm more than the cell's robot"
    if not is_outside:
        return Check(name, "ok", detail)
    text = f"{detail}: at {JOINTS[joint]} up to {allowed:.1f} Nm are allowed"
    remedy = "is it this robot (--robot), with this tool (--cell)?"
    return Check(name, "broken", f"{text}: {remedy}")


def check_sensors(robot: Robot, rest: Rest) -> Check:
    """Compare the measured torque at rest with the model's gravity."""
    name = "gravity, measured torque"
    if not rest.is_measured:
        return Check(
            name,
            "missing",
            "the torque sensors give no noise: it is a simulator without them, as "
            "franka-sim; a robot whose sensors are so is not to be moved",
            is_essential=False,
        )
    gravity = np.asarray(robot.chain().gravity(rest.q))
    if np.abs(gravity).max() < GRAVITY_MIN:
        text = f"no joint carries {GRAVITY_MIN:g} Nm here: stretch the arm out a little"
        return Check(name, "missing", text, is_essential=False)
    scale = float(rest.measured @ gravity / (gravity @ gravity))
    off = signed(rest.measured - gravity)
    detail = f"{scale:+.2f} times the model's ({off} Nm off)"
    low, high = GRAVITY_SHARE
    if low <= scale <= high:
        return Check(name, "ok", detail)
    text = f"{detail}; {low:g} to {high:g} is allowed: check tool and part (--cell)"
    return Check(name, "broken", f"{text}, and that nothing touches the arm")


def check_loop(arm: FrankaArm, before: dict[str, Any]) -> Check:
    """Check lost cycles and times of the loop since some counts."""
    found = arm.statistics()
    counts, times = found["counts"], found["times"]
    cycles = counts["cycles"] - before["cycles"]
    lost = counts["lost"] - before["lost"]
    detail = (
        f"{cycles} cycles, {lost} without a command in time, "
        f"{100.0 * counts['success_rate']:.0f} % of the last 100 arrived; loop p50 "
        f"{1e6 * times['p50']:.0f} us, p99 {1e6 * times['p99']:.0f} us, longest "
        f"{1e6 * times['max']:.0f} us"
    )
    if lost <= LOSS_MAX * cycles:
        return Check("loop", "ok", detail)
    text = f"{detail}; allowed: {100 * LOSS_MAX:g} % without: see {_HERE}"
    return Check("loop", "broken", text)


def check_hold(log: np.ndarray) -> Check:
    """Check that the held arm stays, and say what torque holds it."""
    tips = log[:, COLUMN["x"] : COLUMN["z"] + 1]
    drift = float(np.linalg.norm(tips - tips[0], axis=1).max())
    held = log[:, COLUMN["tau1"] : COLUMN["tau7"] + 1].mean(axis=0)
    detail = f"drift {1e3 * drift:.2f} mm, held by {signed(held)} Nm"
    if drift <= DRIFT_MAX:
        return Check("hold", "ok", detail)
    text = f"{detail}; allowed: {1e3 * DRIFT_MAX:g} mm: check the load"
    return Check("hold", "broken", text)
