"""Many arms at once: the numbers of each alone, and nothing left running."""

import copy
import gc
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.batch_arm import BatchArm
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, PlantError
from dovetail.poses import Pose, tool_down
from extras import need
from states import state_numbers

AXES = TaskSpec.parse("XYZ:force A:pose BC:hold")
HOLE = Pose(np.array([0.6, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))


def build(**settings):
    arm = build_arm(None, find_cell(), AXES, replace(EnvConfig(), **settings))
    arm.reset(np.array([0.0, 0.6, 0.0, -1.55, 0.0, 0.99, 0.0]), HOLE)
    return arm


def targets(rng, count):
    """Draw one push of the tool for each arm, mostly down."""
    return [
        _core.Target(
            f_star=rng.uniform([-4.0, -4.0, -4.0, 0, 0, 0], [4.0, 4.0, 1.0, 0, 0, 0]),
            quat_wxyz_d=tool_down(0.1),
        )
        for _ in range(count)
    ]


def assert_same(states, others):
    for state, other in zip(states, others, strict=True):
        wanted = state_numbers(other)
        for name, value in state_numbers(state).items():
            np.testing.assert_array_equal(value, wanted[name])


def assert_as_alone(batch, alone, steps, rng):
    """Step the batch, and each arm that is like one of it; the states are the same."""
    for _ in range(steps):
        wanted = targets(rng, len(alone))
        assert_same(
            batch.step(wanted),
            [arm.step(target) for arm, target in zip(alone, wanted, strict=True)],
        )


def num_threads():
    """Count the threads of this process, C++'s too."""
    return sum(1 for _ in Path("/proc/self/task").iterdir())


class Elsewhere:
    """Stands for an arm that is not simulated in this process."""


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("settings", [{}, {"twin": "hard"}, {"period": 0.001}])
def test_each_arm_of_a_batch_moves_as_it_does_alone(threads, settings, rng):
    arms, alone = ([build(**settings) for _ in range(5)] for _ in range(2))
    batch = BatchArm(arms, threads)
    assert batch.threads == threads
    assert_as_alone(batch, alone, 25, rng)
    batch.close()


def test_what_a_step_said_is_not_changed_by_the_next(rng):
    arm = build()
    first, second = targets(rng, 2)
    said = arm.step(first)
    kept = copy.deepcopy(said)
    later = arm.step(second)
    assert_same([said], [kept])
    assert not np.array_equal(later.q, said.q)


def test_arms_of_different_settings_go_together(rng):
    """Delay, noise and control period are each plant's own."""
    kinds = [{"twin": "medium"}, {}, {"period": 0.0025}, {"twin": "easy"}]
    arms, alone = ([build(**settings) for settings in kinds] for _ in range(2))
    batch = BatchArm(arms, 2)
    assert_as_alone(batch, alone, 10, rng)
    batch.close()


def test_a_push_and_a_fixture_that_moves_are_as_alone(rng):
    arms, alone = ([build() for _ in range(3)] for _ in range(2))
    batch = BatchArm(arms, 2)
    for some in (arms, alone):
        some[0].push(np.array([20.0, 0.0, 0.0]), 0.12)
        some[2].move_fixture(HOLE, np.array([0.01, 0.0, 0.0]))
    assert_as_alone(batch, alone, 5, rng)
    batch.close()


@pytest.mark.parametrize("threads", [1, 2])
def test_a_simulation_that_diverges_is_named_and_nothing_runs_on(threads, rng):
    arms = [build() for _ in range(4)]
    batch = BatchArm(arms, threads)
    arms[2].plant.data.qvel[3] = 1e4
    with pytest.raises(PlantError, match=r"simulation 2 of the batch: .*diverged"):
        batch.step(targets(rng, 4))
    alone = [build() for _ in range(4)]
    for arm in arms:
        arm.reset(np.array([0.0, 0.6, 0.0, -1.55, 0.0, 0.99, 0.0]), HOLE)
    assert_as_alone(batch, alone, 1, rng)
    batch.close()


def test_a_reset_forgets_a_step_that_was_begun(rng):
    arm, alone = build(), build()
    batch = BatchArm([arm], 1)
    first, second = targets(rng, 2)
    batch.begin(0, first)
    state = arm.reset(np.array([0.0, 0.6, 0.0, -1.55, 0.0, 0.99, 0.0]), HOLE)
    assert state.stamp == 0.0
    assert_same([arm.step(second)], [alone.step(second)])
    batch.close()


def test_a_step_is_ended_by_what_it_was_begun_with(rng):
    arm = build()
    batch = BatchArm([arm], 1)
    first, second = targets(rng, 2)
    batch.begin(0, first)
    with pytest.raises(PlantError, match="another target"):
        arm.step(second)
    batch.begin(0, first)
    with pytest.raises(PlantError, match="10 control cycles were begun, and then 5"):
        arm.step(first, 0.025)
    batch.close()


def test_the_threads_end_with_the_batch(rng):
    arms = [build() for _ in range(3)]
    before = num_threads()
    batch = BatchArm(arms, 3)
    assert num_threads() == before + 2  # the third is the one that waits
    batch.begin(0, targets(rng, 1)[0])
    batch.close()
    assert num_threads() == before
    batch.close()
    arms[0].step(targets(rng, 1)[0])  # alone again


def test_there_are_no_more_threads_than_arms_and_by_default_than_cores():
    arms = [build(), build()]
    for asked in (64, None):
        batch = BatchArm(arms, asked)
        most = asked or len(os.sched_getaffinity(0))
        assert batch.threads == min(2, most)
        batch.close()


def test_what_cannot_be_in_a_batch_is_refused():
    with pytest.raises(ConfigError, match=r"arm 1 of the batch is of Elsewhere"):
        BatchArm([build(), Elsewhere()])
    with pytest.raises(ConfigError, match="threads is 0; allowed: 1 and more"):
        BatchArm([build()], 0)


def test_bullet_is_refused_with_what_to_give():
    need("pybullet")
    arm = build(plant="bullet")
    with pytest.raises(ConfigError, match="BulletPlant; only MuJoCo"):
        BatchArm([arm])
    arm.close()


def test_two_arms_of_a_batch_are_two_simulations():
    arm = build()
    with pytest.raises(ConfigError, match="one simulation"):
        BatchArm([arm, arm])
    arm.close()


def test_a_plant_that_goes_waits_for_the_threads_that_work_in_its_memory():
    arm = build()
    plant, controller = arm.plant, arm.controller
    pool = _core.ThreadPool(1, 2)
    plant.begin_cycles(
        pool, 0, controller, _core.Target(quat_wxyz_d=tool_down(0.1)), 2000, 0.005
    )
    del plant, arm
    gc.collect()
    with pytest.raises(RuntimeError):  # there is nothing left to wait for
        pool.finish(0)


def test_cycles_are_not_begun_twice():
    arms = [build()]
    batch = BatchArm(arms)
    (target,) = targets(np.random.default_rng(0), 1)
    batch.begin(0, target)
    with pytest.raises(PlantError, match="were begun and not ended"):
        batch.begin(0, target)
    assert arms[0].step(target).stamp > 0.0
    batch.close()
