"""What a policy is told of the past: which numbers, how old, and what before."""

import gymnasium as gym
import numpy as np
import pytest

from dovetail.envs.history_features import HistoryFeatures
from dovetail.envs.observation import Layout
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.robots.find import find_robot
from facts import about

LAYOUT = Layout(
    ("joints", "position", "theta", "velocity", "tilt"), find_robot(), np.zeros(3)
)


@pytest.mark.parametrize("ages", [(1,), (4, 8), (200, 1)])
def test_each_age_is_what_was_seen_that_many_steps_ago(ages):
    recall = HistoryFeatures(ages, LAYOUT, 2)
    seen = np.random.default_rng(0).normal(size=(30, len(LAYOUT))).astype(np.float32)
    indices = [*range(7, 10), 14, 15]  # position and tilt
    out = recall.reset(seen[0])
    for now in range(1, 30):
        action = np.full(2, 0.01 * now, dtype=np.float32)
        out = recall.push(action, seen[now])
        past = [seen[max(now - age, 0)][indices] for age in ages]
        np.testing.assert_array_equal(out, np.concatenate([seen[now], action, *past]))
    assert len(out) == len(LAYOUT) + len(recall)
    first = recall.reset(seen[5])
    expected = [seen[5], np.zeros(2), *[seen[5][indices]] * len(ages)]
    np.testing.assert_array_equal(first, np.concatenate(expected))


def test_columns_say_what_is_appended():
    names = [column.name for column in HistoryFeatures((4,), LAYOUT, 1).columns]
    assert names == [
        "last_action_0",
        *(f"obs_{name}_4_ago" for name in ("x", "y", "z", "tilt_x", "tilt_y")),
    ]


def test_no_ages_append_nothing():
    recall = HistoryFeatures((), LAYOUT, 3)
    seen = np.ones(len(LAYOUT), dtype=np.float32)
    assert len(recall) == 0
    assert recall.push(np.zeros(3, dtype=np.float32), seen) is seen


@pytest.mark.parametrize("ages", [(0,), (201,), (1.5,)])
def test_ages_out_of_range_are_refused(ages):
    with pytest.raises(ConfigError, check=about("recall")):
        HistoryFeatures(ages, LAYOUT, 1)


def test_the_environment_has_the_columns_and_stays_inside_its_space():
    env = gym.make(
        "dovetail/PegInHole-v0",
        task="XYZ:force ABC:pose",
        also=("tilt",),
        recall=(1, 3),
        stack=1,
        disable_env_checker=True,
    )
    core = require_contact_env(env)
    one = 14 + 2 + 6 + 2 * 5
    assert len(core.columns) == one
    assert env.observation_space.shape == (one + one + 6,)
    observation, _ = env.reset(seed=0)
    action = np.array([0.1, 0.0, 0.2, 0.0, 0.5, -0.5], dtype=np.float32)
    for _ in range(5):
        assert env.observation_space.contains(observation)
        observation, *_ = env.step(action)
    np.testing.assert_array_equal(observation[16:22], action)
    tilt = dict(zip((c.name for c in core.columns), observation, strict=False))
    assert tilt["obs_tilt_y"] > 0.0 > tilt["obs_tilt_x"]
    env.close()
