"""The search that takes over from a policy: when, from where, and who may choose it."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.control.period import POLICY_PERIOD
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.log_facts import ACTION, describe_cell
from dovetail.envs.registered import make, make_batch, make_env
from dovetail.envs.teleop import TeleopWrapper
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.evaluation.config import EvaluationConfig, environment_options
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import policy_settings
from dovetail.search.corner import SEARCH_AXES, CornerSearch
from dovetail.search.fall_back_env import FallBackEnv
from dovetail.tasks.peg_in_hole.task import PegInHole

SETTINGS = {
    "task": SEARCH_AXES,
    "theta_range": 0.3,
    "near_speed": 0.05,
    "max_steps": 400,
    "tracker": "covered?doubt=0.005",
}
AFTER = 1.0  # s
NOTHING = np.zeros(6, dtype=np.float32)
DOWN = np.array([0.0, 0.0, -0.4, 0.0, 0.0, 0.0], dtype=np.float32)


def made(**settings):
    return make_env(PegInHole, **{**SETTINGS, "fall_back": AFTER, **settings})


def test_until_then_an_action_is_done_as_it_is():
    env, plain = made(), make_env(PegInHole, **SETTINGS)
    assert isinstance(env, FallBackEnv)
    assert type(plain) is ContactEnv
    rng = np.random.default_rng(1)
    env.reset(seed=2)
    plain.reset(seed=2)
    for _ in range(round(AFTER / POLICY_PERIOD)):
        assert not env.is_searching
        action = rng.uniform(-0.3, 0.3, 6).astype(np.float32)
        seen, *_ = env.step(action)
        wanted, *_ = plain.step(action)
        np.testing.assert_array_equal(seen, wanted)
    assert env.is_searching


def test_a_policy_that_presses_on_the_rim_is_rescued():
    env, plain = made(), make_env(PegInHole, **SETTINGS)
    for each, is_rescued in ((env, True), (plain, False)):
        each.reset(seed=4)
        done, info = False, {}
        while not done:
            *_, ended, cut, info = each.step(DOWN)
            done = ended or cut
        assert info["success"] == is_rescued


def test_each_episode_begins_with_the_policy_and_a_new_search():
    env, times = made(), []
    for _ in range(2):
        env.reset(seed=5)
        assert not env.is_searching
        done = False
        while not done:
            *_, ended, cut, _ = env.step(NOTHING)
            done = ended or cut
        times.append(env.steps)
    assert times[0] == times[1]


def test_a_person_who_leads_is_asked_on():
    class Hand:
        def reset(self):
            pass

        def __call__(self, core):
            return NOTHING

    env = TeleopWrapper(made(), Hand())
    core = require_contact_env(env)
    env.reset(seed=1)
    for _ in range(25):
        env.step(NOTHING)
    assert not core.is_searching
    assert np.linalg.norm(core.state.tool.velocity[:3]) < 0.002  # m/s


def test_a_batch_does_the_same():
    batch = make_batch(PegInHole, 2, **SETTINGS, fall_back=AFTER)
    single = made()
    single.reset(seed=7)
    batch.reset(seed=[7, 8])
    for _ in range(30):
        seen, *_ = single.step(DOWN)
        many, *_ = batch.step(np.stack([DOWN, DOWN]))
        np.testing.assert_array_equal(many[0], seen)


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigError, match="fall_back is -1 s; allowed: 0 to 3600 s"):
        made(fall_back=-1.0)
    with pytest.raises(ConfigError, match="whose corrections fade"):
        made(script="corner")
    with pytest.raises(ConfigError, match="needs the axes"):
        made(task="XYZ:force A:pose BC:hold")


def test_a_training_is_of_the_policy_alone_and_its_file_says_when_it_ends():
    config = TrainConfig(task=SEARCH_AXES, fall_back=6.0)
    env = config
    assert "fall_back" not in env.env_options()
    assert env.policy_env()["fall_back"] == 6.0
    assert "fall_back" not in TrainConfig().policy_env()
    with pytest.raises(ConfigError, match="fall_back is given, which needs --task"):
        TrainConfig(fall_back=6.0)


def test_evaluate_takes_the_policys_time_or_its_own():
    metadata = dict(Policy.load(find_policy("peg_near")).metadata)
    metadata["env"] = {**metadata["env"], "fall_back": 5.0}
    assert policy_settings(metadata)["fall_back"] == 5.0
    for given, wanted in ((None, 5.0), (0.0, 0.0), (3.0, 3.0)):
        config = EvaluationConfig(policy="peg_near", plant="mujoco", fall_back=given)
        assert environment_options(config, metadata)["fall_back"] == wanted
    searched = EvaluationConfig(policy="peg_near", plant="mujoco", search="corner")
    assert environment_options(searched, metadata)["fall_back"] == 0.0
    both = replace(searched, fall_back=3.0)
    with pytest.raises(ConfigError, match="acts from the start"):
        environment_options(both, metadata)


def test_a_log_tells_what_was_done():
    env = made()
    env.reset(seed=4)
    for step in range(30):
        env.step(DOWN)
        is_own = step * POLICY_PERIOD < AFTER
        assert np.array_equal(env.done_for(DOWN), DOWN) == is_own
    assert describe_cell(env)[ACTION]["script"] == "none"


def test_a_policy_that_begins_late_has_its_whole_time():
    env = made()
    env.reset(seed=4)
    for _ in range(30):
        env.step(NOTHING)  # an arm that waits in the cockpit, say
    assert env.is_searching
    env.begin_acting()
    for _ in range(round(AFTER / POLICY_PERIOD)):
        assert not env.is_searching
        env.step(DOWN)
    assert env.is_searching


def test_a_search_needs_an_opening_that_the_task_tells_of():
    env = make("dovetail/GearMesh-v0", task=SEARCH_AXES).unwrapped
    with pytest.raises(ConfigError, match="GearMesh has no outline"):
        CornerSearch(env)
