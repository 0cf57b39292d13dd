"""In slices the arm does what it does in one piece; held, it stays."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.cockpit.disturbance import UserDisturbance, spring_force
from dovetail.cockpit.pace import Pace
from dovetail.cockpit.paced_arm import PacedArm
from dovetail.envs.registered import DEFAULT_ENV, make_env, task_class
from dovetail.errors import ArmError

FAST = Pace(sleep=lambda _: None)


def make(**settings):
    return make_env(task_class(DEFAULT_ENV), **settings)


def paced(env, see=lambda *_: None):
    env.arm = PacedArm(env.arm, UserDisturbance(), FAST, see)
    return env.arm


@pytest.mark.parametrize("period", [0.001, 0.002, 0.0025, 0.005])
def test_slices_change_nothing(period, rng):
    actions = rng.uniform(-1.0, 1.0, (10, 4)).astype(np.float32)
    logs = []
    for is_paced in (False, True):
        env = make(twin="easy", period=period)
        if is_paced:
            paced(env)
        env.reset(seed=3)
        logs.append([env.step(action) and env.state for action in actions])
        env.close()
    for whole, sliced in zip(*logs, strict=True):
        np.testing.assert_array_equal(whole.log, sliced.log)
        np.testing.assert_array_equal(whole.q, sliced.q)
        assert whole.flags == sliced.flags
        assert whole.stamp == pytest.approx(sliced.stamp)


def test_each_slice_is_seen():
    seen = []
    env = make()
    paced(env, lambda state, _: seen.append(state.stamp))
    env.reset(seed=1)
    env.step(np.zeros(4, dtype=np.float32))
    np.testing.assert_allclose(seen, [0.01, 0.02, 0.03, 0.04, 0.05])
    env.close()


def test_a_held_arm_does_not_do_what_the_policy_says():
    env = make()
    arm = paced(env)
    env.reset(seed=1)
    begin = env.state.tool.position
    arm.stop()
    for _ in range(10):
        env.step(np.ones(4, dtype=np.float32))
    assert np.linalg.norm(env.state.tool.position - begin) < 1e-4
    arm.clear()
    for _ in range(10):
        env.step(np.ones(4, dtype=np.float32))
    assert np.linalg.norm(env.state.tool.position - begin) > 0.01
    env.close()


class Distant:
    """An arm that nobody can touch: it stops by itself, and is stepped in one piece."""

    def __init__(self, arm):
        self._arm = arm
        facts = arm.facts
        traits = replace(facts.traits, is_simulated=False, is_real_time=True)
        self.facts = replace(facts, traits=traits)
        self.durations = []
        self.stops = 0

    def reset(self, q, fixture):
        return self._arm.reset(q, fixture)

    def step(self, target, duration=0.05):
        self.durations.append(duration)
        return self._arm.step(target, duration)

    def stop(self):
        self.stops += 1

    def clear(self):
        self.stops = 0

    def seed(self, seed):
        self._arm.seed(seed)

    def close(self):
        self._arm.close()


def test_an_arm_that_is_no_simulation_is_stepped_whole_and_stops_itself():
    env = make()
    distant = Distant(env.arm)
    arm = PacedArm(distant, UserDisturbance(), FAST, lambda *_: None)
    env.arm = arm
    env.reset(seed=1)
    env.step(np.zeros(4, dtype=np.float32))
    assert distant.durations == [0.05]
    arm.stop()
    assert distant.stops == 1
    env.reset()
    assert distant.stops == 0
    with pytest.raises(ArmError, match="push"):
        arm.push(np.zeros(3), 0.1)
    env.close()


def test_an_arm_elsewhere_is_stopped_before_its_first_reset_has_ended_too():
    """The stop used to wait for a first state, while the arm drove to its start."""
    env = make()
    distant = Distant(env.arm)
    env.arm = arm = PacedArm(distant, UserDisturbance(), FAST, lambda *_: None)
    reset, stops = distant.reset, []

    def drive(q, fixture):
        arm.stop()  # a person's, from another thread
        stops.append(distant.stops)
        return reset(q, fixture)

    distant.reset = drive
    env.reset(seed=1)
    assert stops == [1]
    env.close()


def test_while_a_stop_of_a_person_holds_nothing_frees_the_arm():
    env = make()
    stopped = [False]
    distant = Distant(env.arm)
    arm = PacedArm(
        distant, UserDisturbance(), FAST, lambda *_: None, lambda: stopped[0]
    )
    env.arm = arm
    env.reset(seed=1)
    stopped[0] = True
    arm.stop()
    arm.clear()
    with pytest.raises(ArmError) as refusal:
        env.reset(seed=1)
    assert refusal.value.reason == "stopped"
    assert arm.is_held
    assert distant.stops == 1
    stopped[0] = False
    arm.clear()
    assert not arm.is_held
    assert distant.stops == 0
    env.close()


@pytest.mark.parametrize("stretch", [0.0, 1e-3, 0.05, 0.5, 1.0, 1e6, 1e308])
def test_the_spring_pulls_along_its_stretch_and_not_too_hard(stretch):
    direction = np.array([0.6, 0.0, -0.8])
    force = spring_force(stretch * direction)
    np.testing.assert_allclose(force, min(400.0 * stretch, 30.0) * direction)
