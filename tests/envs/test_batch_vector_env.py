"""The batch of environments gives the numbers of single ones, bit for bit."""

import dataclasses
import functools
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from dovetail.envs.batch_vector_env import BatchVectorEnv
from dovetail.envs.config import EnvConfig
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.dynamics_randomisation import (
    DynamicsRandomisation,
    RandomDynamics,
)
from dovetail.envs.registered import make_env, register_task
from dovetail.errors import ArmError, ConfigError, PlantError
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.task import Progress

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "batch.py"
ID = "dovetail/PegInHole-v0"
NUM = 3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Aside(PegInHole):
    """A stranger's task: done when the tool is beside the hole, which chance brings."""

    def judge(self, error, goal, state):
        return Progress(0.0, bool(state.stamp > 0.12 and error[0] > 0.0))


class Shaped(ContactEnv):
    """A stranger's environment, with a step of its own."""

    def step(self, action):
        self.arm.push(np.array([0.0, 0.0, 5.0 * float(action[0])]), 0.05)
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward - 1.0, terminated, truncated, info


class Moody(ContactEnv):
    """A stranger's environment that does more before the cycles."""

    def begin_step(self, action):
        self.arm.push(np.array([0.0, 0.0, 5.0 * float(action[0])]), 0.05)
        return super().begin_step(action)


class Halved(gym.ActionWrapper):
    """Changes the action on its way."""

    def action(self, action):
        return 0.5 * action


def randomised():
    env = make_env(PegInHole, max_steps=5)
    return RandomDynamics(env, DynamicsRandomisation())


def assert_equal(mine, other):
    """Compare two values, dictionaries or tuples, with their types."""
    assert type(mine) is type(other)
    if isinstance(other, dict):
        assert list(mine) == list(other)
        for key, value in other.items():
            assert_equal(mine[key], value)
    elif isinstance(other, tuple):
        for value, wanted in zip(mine, other, strict=True):
            assert_equal(value, wanted)
    else:
        np.testing.assert_array_equal(mine, other, strict=True)


def assert_same_run(batch, single, steps=14, seed=5):
    """Run both through several tries, and compare everything they return."""
    rng = np.random.default_rng(1)
    ended = 0
    try:
        assert_equal(batch.reset(seed=seed), single.reset(seed=seed))
        for _ in range(steps):
            actions = rng.uniform(-1.2, 1.2, batch.action_space.shape)
            actions = actions.astype(np.float32)
            mine, wanted = batch.step(actions), single.step(actions)
            assert_equal(mine, wanted)
            ended += np.count_nonzero(wanted[2] | wanted[3])
    finally:
        batch.close()
        single.close()
    assert ended > NUM  # or autoreset was not seen


CASES = {
    "peg": functools.partial(make_env, PegInHole, max_steps=5),
    "clip": functools.partial(make_env, RailClip, max_steps=5, stack=2),
    "delay and noise": functools.partial(make_env, PegInHole, twin="hard", max_steps=5),
    "1 ms": functools.partial(make_env, PegInHole, period=0.001, max_steps=5),
    "tracker": functools.partial(
        make_env, PegInHole, tracker="noisy?offset=0.001", max_steps=5
    ),
    "tare": functools.partial(
        make_env, PegInHole, twin="medium", tare=True, max_steps=5
    ),
    "what was": functools.partial(make_env, PegInHole, recall=(1, 3), max_steps=5),
    "a search": functools.partial(
        *(make_env, PegInHole), task="XYZ:force ABC:pose", script="corner", max_steps=5
    ),
    "stranger's task": functools.partial(make_env, Aside, max_steps=6),
    "random dynamics": randomised,
    "stranger's begin": functools.partial(
        Moody, PegInHole(), config=replace(EnvConfig(), max_steps=5)
    ),
}


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_a_batch_gives_the_numbers_of_single_environments(threads):
    make = CASES["peg"]
    assert_same_run(BatchVectorEnv([make] * NUM, threads), SyncVectorEnv([make] * NUM))


@pytest.mark.parametrize("case", [name for name in CASES if name != "peg"])
def test_so_it_does_in_other_settings(case):
    make = CASES[case]
    assert_same_run(BatchVectorEnv([make] * NUM, 2), SyncVectorEnv([make] * NUM))


def test_make_vec_gives_a_batch_for_every_registered_task():
    register_task("TestAside-v0", Aside)
    for env_id in (ID, "dovetail/RailClip-v0", "TestAside-v0"):
        make = functools.partial(
            gym.make_vec, env_id, num_envs=NUM, max_episode_steps=5
        )
        batch = make(vectorization_mode="vector_entry_point", threads=2)
        assert isinstance(batch, BatchVectorEnv)
        assert batch.batch.threads == 2
        assert_same_run(batch, make(vectorization_mode="sync"))


def test_seeds_options_and_masks_are_as_gymnasiums():
    make = CASES["peg"]
    batch, single = (kind([make] * NUM) for kind in (BatchVectorEnv, SyncVectorEnv))
    hole = make().task.draw_fixture(np.random.default_rng(0))
    actions = np.zeros((NUM, 4), dtype=np.float32)
    for seed, options in (([4, None, 9], None), (2, {"fixture": hole})):
        mine, wanted = (
            vec.reset(seed=seed, options=options) for vec in (batch, single)
        )
        np.testing.assert_array_equal(mine[0][0], wanted[0][0])
        np.testing.assert_array_equal(mine[0][2], wanted[0][2])
    mask = np.array([False, True, False])
    for vec in (batch, single):
        vec.reset(seed=7)
        vec.step(actions)
    mine, wanted = (
        vec.reset(seed=3, options={"reset_mask": mask}) for vec in (batch, single)
    )
    assert_equal(mine, wanted)
    assert_equal(batch.step(actions), single.step(actions))
    batch.close()
    single.close()


@pytest.mark.parametrize(
    "make",
    [
        lambda: Shaped(PegInHole(), config=replace(EnvConfig(), max_steps=5)),
        lambda: Halved(make_env(PegInHole, max_steps=5)),
    ],
    ids=["Shaped", "Halved"],
)
def test_a_step_of_ones_own_is_whole_and_one_after_the_other(make, recwarn):
    name = type(make()).__name__
    batch = BatchVectorEnv([make] * NUM, 2)
    said = [str(warning.message) for warning in recwarn]
    assert any(f"{name} has a step of its own" in line for line in said)
    assert_same_run(batch, SyncVectorEnv([make] * NUM))


def test_a_wrapper_of_rewards_or_observations_is_no_step_of_ones_own(recwarn):
    def make():
        env = gym.make(ID, max_episode_steps=5)
        env = gym.wrappers.TransformReward(env, lambda reward: 2.0 * reward)
        return gym.wrappers.RescaleObservation(env, -1.0, 1.0)

    batch = BatchVectorEnv([make] * NUM, 2)
    assert not [w for w in recwarn if "step of its own" in str(w.message)]
    assert_same_run(batch, SyncVectorEnv([make] * NUM))


def test_an_action_that_is_changed_on_its_way_is_refused():
    env = make_env(PegInHole)
    env.reset(seed=0)
    env.begin_step(np.zeros(4, dtype=np.float32))
    with pytest.raises(ConfigError, match=r"begun with the action .* cannot be in a"):
        env.step(np.full(4, 0.1, dtype=np.float32))


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_says_where_and_leaves_nothing_running(threads):
    make = CASES["peg"]
    batch = BatchVectorEnv([make] * NUM, threads)
    batch.reset(seed=0)
    actions = np.zeros((NUM, 4), dtype=np.float32)
    bad = actions.copy()
    bad[1, 2] = np.nan
    with pytest.raises(ConfigError, match="finite") as caught:
        batch.step(bad)
    assert caught.value.__notes__ == ["in environment 1 of 3, from 0"]
    with pytest.raises(ArmError, match="environment 0 was not reset since: reset"):
        batch.step(actions)
    mask = np.array([True, False, True])
    batch.reset(options={"reset_mask": mask})
    with pytest.raises(ArmError, match="environment 1 was not reset since"):
        batch.step(actions)
    batch.reset(options={"reset_mask": ~mask})
    batch.step(actions)
    batch.reset(seed=0)
    batch.envs[2].unwrapped.arm.plant.data.qvel[0] = 1e4
    with pytest.raises(PlantError, match="simulation 2 of the batch") as caught:
        batch.step(actions)
    assert caught.value.__notes__ == ["in environment 2 of 3, from 0"]
    assert_same_run(batch, SyncVectorEnv([make] * NUM))


class Talker(ContactEnv):
    """A stranger's environment whose infos have now these keys and now those."""

    def _info(self, raw):
        info = super()._info(raw)
        said = {"word": "odd", "table": {"steps": self.steps}, "number": self.steps}
        return {k: said[k] for k in said if self.np_random.random() < 0.5} | info


def test_infos_that_differ_are_put_together_as_gymnasium_does():
    def make():
        return Talker(PegInHole(), config=replace(EnvConfig(), max_steps=5))

    assert_same_run(BatchVectorEnv([make] * NUM, 2), SyncVectorEnv([make] * NUM))


def num_threads():
    """Count the threads of this process, C++'s too."""
    return sum(1 for _ in Path("/proc/self/task").iterdir())


def test_close_ends_the_threads():
    before = num_threads()
    batch = gym.make_vec(
        ID, num_envs=NUM, vectorization_mode="vector_entry_point", threads=3
    )
    assert num_threads() == before + 2
    batch.close()
    batch.close()
    assert num_threads() == before


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"threads": 0}, "threads is 0"),
        ({"arm": object()}, "arm is an object, which 2 environments would share"),
        ({"clearance": -1.0}, "clearance"),
        ({"wings": 2}, "unexpected keyword argument 'wings'"),
    ],
)
def test_wrong_settings_are_refused(settings, words):
    given = {"num_envs": 2, "vectorization_mode": "vector_entry_point"} | settings
    with pytest.raises(ConfigError, match=words):
        gym.make_vec(ID, **given)


def test_another_environment_is_refused():
    with pytest.raises(ConfigError, match="CartPoleEnv is no ContactEnv"):
        BatchVectorEnv([lambda: gym.make("CartPole-v1")])


def test_the_benchmark_runs():
    command = [sys.executable, BENCHMARK, "--envs", "2", "--turns", "2", "--steps", "8"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert re.search(r"ratio \d+\.\d\d \(quartiles", done.stdout)
    assert "ratio that this allows" in done.stdout
