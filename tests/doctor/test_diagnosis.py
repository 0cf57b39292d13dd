"""Diagnosis of arms, in this process and over FRI, finds what was planted."""

import time
from dataclasses import replace

import numpy as np
import pytest

from arms.loopback import CabinetArm
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.doctor.cabinet_spring import LEAN_RATE, Side, measure_spring, reached
from dovetail.doctor.diagnosis import diagnose_arm, overload_hint
from dovetail.doctor.excitation import excitation_gains, simulated_step
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS, FLAG_MASK, DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.robots.missed_load import explain_by_load

CELL = find_cell()
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = CELL.loaded_robot().inverse_kinematics(
    Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0)),
    np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0]),
)
HOLD = TaskSpec.parse("XYZABC:hold")


def settings(period):
    return excitation_gains(
        *make_settings(CELL, EnvConfig(period=period, force_damping=0.0))
    )


def local(plant, period):
    osc, limits = settings(period)
    arm = LocalArm(plant, CELL.loaded_robot(), osc, limits, HOLD, period)
    arm.reset(START, HOLE)
    return arm


def over_fri(plant, period, clock="lockstep", **cabinet):
    osc, limits = settings(period)
    arm = CabinetArm(plant, osc, limits, HOLD, period, clock=clock, cabinet=cabinet)
    arm.reset(START, HOLE)
    return arm


def twin(name, delay):
    return make_twin(replace(load_twin(name), command_delay=delay), CELL)


def diagnose(arm, seconds=1.5):
    step = simulated_step(arm.facts.period)
    return diagnose_arm(
        arm,
        START,
        integration_step=step,
        seconds=seconds,
    )


@pytest.mark.parametrize(
    ("name", "period", "delay_ms"),
    [
        *[("medium", 0.001, d) for d in (0, 2, 5, 8, 10, 15)],
        *[("hard", 0.002, d) for d in (0, 2, 8, 10)],
        *[("hard", 0.005, d) for d in (0, 5, 10, 15)],
        ("easy", 0.0025, 5),
    ],
)
def test_the_delay_of_a_twin_is_found(name, period, delay_ms):
    arm = local(twin(name, 1e-3 * delay_ms), period)
    found = diagnose(arm)
    assert found.delay.delay == pytest.approx(1e-3 * delay_ms, abs=5e-4)
    assert found.delay.is_bracketed
    assert 0.005 < found.turned < 0.03
    arm.close()


@pytest.mark.parametrize("damping", [0.0, 0.7])
@pytest.mark.parametrize("stiffness", [20.0, 200.0, 1000.0])
def test_the_spring_of_a_cabinet_is_found(stiffness, damping):
    impedance = {"stiffness": (stiffness,) * 7, "damping": (damping,) * 7}
    arm = over_fri(twin("medium", 0.005), 0.005, **impedance)
    springs = spring_of(arm, 0.005)
    np.testing.assert_allclose(np.median(springs), stiffness, rtol=0.15)
    np.testing.assert_allclose(springs, stiffness, rtol=0.25)
    arm.close()


def test_a_stiff_spring_is_leaned_on_by_little():
    arm = over_fri(twin("medium", 0.005), 0.005, stiffness=(1000.0,) * 7)
    spring_of(arm, 0.005)
    log = arm.recent(5.0)
    turned = np.abs(log[:, COLUMN["q1"] : COLUMN["q7"] + 1] - START).max()
    assert turned < 0.1  # 0.21 where it was leaned on by 0.02 rad at once
    arm.close()


def spring_of(arm, delay):
    fits = measure_spring(arm, START, delay)
    return [fit.sent_spring for fit in fits]


def test_a_spring_is_found_by_the_clock_whatever_was_computed_before():
    """What the arm did while the delay was fitted was taken for a lean."""
    arm = over_fri(
        twin("medium", 0.005),
        0.005,
        clock="wall",
        stiffness=(200.0,) * 7,
        fair_from=0.2,
        good_from=0.2,
    )
    time.sleep(1.0)
    springs = spring_of(arm, 0.005)
    np.testing.assert_allclose(np.median(springs), 200.0, rtol=0.15)
    arm.close()


def test_a_lean_is_counted_from_its_cycle_on_and_not_while_the_arm_is_held():
    period = 0.01
    log = np.zeros((300, len(CYCLE_COLUMNS)))
    log[:, 0] = period * np.arange(1.0, 301.0)
    log[250:, COLUMN["flags"]] = FLAG_MASK["target_late"]
    share = reached(log, [Side(0.0, 1.0), Side(1.0, -1.0)], period)
    rate = 1.0 - LEAN_RATE * period
    np.testing.assert_allclose(share[:100], 1.0 - rate ** np.arange(1, 101))
    assert share[99] > 0.99
    assert share[100] < share[99]
    assert share[249] < -0.99
    np.testing.assert_allclose(share[299], share[249] * rate**50)


def test_a_cabinet_without_a_spring_has_none_whatever_its_friction():
    arm = over_fri(twin("hard", 0.01), 0.005)
    assert diagnose(arm).delay.delay == pytest.approx(0.01, abs=5e-4)
    assert max(map(abs, spring_of(arm, 0.01))) < 10.0
    arm.close()


def test_a_gravity_error_is_measured_and_its_load_found():
    heavy = DynamicsConfig(mass_scale=(1.0,) * 6 + (1.5,), damping=(0.5,) * 7)
    arm = local(make_plant("mujoco", CELL, heavy), 0.002)
    robot = arm.facts.robot
    mass = robot.links.mass * np.array([1.0] * 6 + [1.5])
    planted = replace(robot, links=replace(robot.links, mass=mass))
    error = planted.chain().gravity(START) - robot.chain().gravity(START)
    found = diagnose(arm)
    missed = np.array([fit.offset for fit in found.fits])
    np.testing.assert_allclose(missed, error, atol=0.15)
    spread = np.array([fit.spread_of("offset") for fit in found.fits])
    load = explain_by_load(robot, START, missed, spread)
    assert load.explained > 0.98
    assert load.mass == pytest.approx(0.5 * robot.links.mass[6], abs=0.1)
    arm.close()


def test_logs_with_too_many_gaps_are_refused():
    arm = local(make_plant("mujoco", CELL, DynamicsConfig()), 0.005)
    step = arm.step

    def lossy(target, duration=0.05):
        state = step(target, duration)
        return state._replace(log=np.delete(state.log, np.s_[1:], axis=0))

    arm.step = lossy
    with pytest.raises(ArmError, match="A1 was pushed, 5 times, no more than"):
        diagnose(arm)
    arm.close()


def test_a_push_that_lost_cycles_is_done_again():
    """As on a busy machine, where some pushes have long gaps and some have none."""
    arm = local(twin("medium", 0.005), 0.005)
    step, lossy = arm.step, iter([True] * 70 + [False] * 10**6)

    def step_with_gaps(target, duration=0.05):
        state = step(target, duration)
        return state._replace(log=state.log[-1:] if next(lossy) else state.log)

    arm.step = step_with_gaps
    assert diagnose(arm).delay.delay == pytest.approx(0.005, abs=5e-4)
    arm.close()


def test_a_busy_machine_is_named_and_an_idle_one_is_not(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.getloadavg", lambda: (1.9, 9.0, 9.0))
    assert overload_hint() == ""
    monkeypatch.setattr("os.getloadavg", lambda: (14.8, 0.0, 0.0))
    assert "busy (load 14.8 on 2 cores)" in overload_hint()
    assert "clock=lockstep" in overload_hint()
