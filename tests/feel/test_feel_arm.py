"""Arms that are felt, from here and over FRI: what was planted is found."""

from dataclasses import replace

import numpy as np
import pytest

from arms.loopback import CabinetArm
from dovetail.arms.local_arm import LocalArm
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError
from dovetail.feel.busy import busy_words
from dovetail.feel.feeling import feel_arm
from dovetail.feel.gains import quiet, simulated_step
from dovetail.feel.missed_load import explain_by_load
from dovetail.feel.spring import feel_spring
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import TwinPlant, load_twin
from dovetail.poses import Pose, quat_about_z, tool_down

CELL = find_cell()
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
START = CELL.loaded_robot().inverse_kinematics(
    Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0)),
    np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0]),
)
HOLD = TaskSpec.parse("XYZABC:hold")


def settings(period):
    return quiet(*make_settings(CELL, EnvConfig.of(period=period, force_damping=0.0)))


def local(plant, period):
    osc, limits = settings(period)
    arm = LocalArm(plant, CELL.loaded_robot(), osc, limits, HOLD, period)
    arm.reset(START, HOLE)
    return arm


def over_fri(plant, period, **cabinet):
    osc, limits = settings(period)
    arm = CabinetArm(plant, osc, limits, HOLD, period, cabinet=cabinet)
    arm.reset(START, HOLE)
    return arm


def twin(name, delay):
    return TwinPlant(load_twin(name).having(command_delay=delay), CELL)


def feel(arm, seconds=1.5):
    step = simulated_step(arm.facts.period)
    return feel_arm(
        arm,
        START,
        arm.facts.limits.prediction.armature,
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
    feeling = feel(arm)
    assert feeling.delay.delay == pytest.approx(1e-3 * delay_ms, abs=5e-4)
    assert feeling.delay.is_bracketed
    assert 0.005 < feeling.turned < 0.03
    arm.close()


def test_the_delay_and_the_spring_of_a_cabinet_are_found():
    plant = twin("medium", 0.005)
    arm = over_fri(plant, 0.005, stiffness=(200.0,) * 7, damping=(0.7,) * 7)
    fits = feel_spring(arm, START, arm.facts.limits.prediction.armature, 0.005)
    np.testing.assert_allclose([f.sent_spring for f in fits], 200.0, rtol=0.15)
    arm.close()


def test_a_cabinet_without_a_spring_has_none_whatever_its_friction():
    arm = over_fri(twin("hard", 0.01), 0.005)
    assert feel(arm).delay.delay == pytest.approx(0.01, abs=5e-4)
    fits = feel_spring(arm, START, arm.facts.limits.prediction.armature, 0.01)
    assert max(abs(f.sent_spring) for f in fits) < 5.0
    arm.close()


def test_a_gravity_error_is_measured_and_its_load_found():
    heavy = DynamicsConfig.of(mass_scale=(1.0,) * 6 + (1.5,), damping=(0.5,) * 7)
    arm = local(make_plant("mujoco", CELL, heavy), 0.002)
    robot = arm.facts.robot
    mass = robot.links.mass * np.array([1.0] * 6 + [1.5])
    planted = replace(robot, links=replace(robot.links, mass=mass))
    error = planted.chain().gravity(START) - robot.chain().gravity(START)
    feeling = feel(arm)
    found = np.array([fit.offset for fit in feeling.fits])
    np.testing.assert_allclose(found, error, atol=0.15)
    spread = np.array([fit.spread_of("offset") for fit in feeling.fits])
    load = explain_by_load(robot, START, found, spread)
    assert load.explained > 0.98
    assert load.mass == pytest.approx(0.5 * robot.links.mass[6], abs=0.1)
    arm.close()


def test_logs_with_too_many_gaps_are_refused():
    arm = local(make_plant("mujoco", CELL, DynamicsConfig()), 0.005)
    step = arm.step
    count = 0

    def lossy(target, duration=0.05):
        nonlocal count
        state = step(target, duration)
        count += 1
        return state._replace(log=np.delete(state.log, 1, axis=0))

    arm.step = lossy
    with pytest.raises(ArmError, match="A1 was pushed, 5 times, no more than"):
        feel(arm)
    arm.close()


def test_a_push_that_lost_cycles_is_done_again():
    """As on a busy machine, where some pushes are gapless and some are not."""
    arm = local(twin("medium", 0.005), 0.005)
    step, lossy = arm.step, iter([True] * 70 + [False] * 10**6)

    def step_with_gaps(target, duration=0.05):
        state = step(target, duration)
        return state._replace(log=state.log[1:] if next(lossy) else state.log)

    arm.step = step_with_gaps
    assert feel(arm).delay.delay == pytest.approx(0.005, abs=5e-4)
    arm.close()


def test_a_busy_machine_is_named_and_an_idle_one_is_not(monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.getloadavg", lambda: (1.9, 9.0, 9.0))
    assert busy_words() == ""
    monkeypatch.setattr("os.getloadavg", lambda: (14.8, 0.0, 0.0))
    assert "busy (load 14.8 on 2 cores)" in busy_words()
    assert "clock=lockstep" in busy_words()
