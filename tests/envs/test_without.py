"""Column groups that a policy does not see."""

import gymnasium as gym
import numpy as np
import pytest

import dovetail  # noqa: F401, registers the environments
from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import make_policy_env

ENV = "dovetail/PegInHole-v0"


def test_what_is_left_out_is_not_seen_and_the_rest_is_as_before():
    whole, less = (
        gym.make(ENV, tilt=0.2, without=without)  # with it, the tilt is shown
        for without in ((), ("joints", "tilt"))
    )
    names = [[c.name for c in env.unwrapped.columns] for env in (whole, less)]
    kept = [i for i, name in enumerate(names[0]) if name in names[1]]
    assert len(names[0]) - len(kept) == 7 + 2
    seen = [env.reset(seed=0)[0] for env in (whole, less)]
    np.testing.assert_array_equal(seen[0][kept], seen[1])
    action = np.ones(whole.action_space.shape)
    steps = [env.step(action) for env in (whole, less)]
    assert steps[0][1] == steps[1][1]  # the reward still counts the tilt
    for env in (whole, less):
        env.close()


def test_a_group_that_the_task_does_not_show_is_named():
    with pytest.raises(ConfigError) as raised:
        gym.make(ENV, without=("joint",))
    assert raised.value.name == "without"


@pytest.mark.parametrize("robot", ["fr3", "gen3"])
def test_a_policy_that_sees_no_joints_is_taken_on_another_arm(robot):
    policy = Policy.load(find_policy("insert_any"))
    make_policy_env(policy, robot=robot).close()
    with pytest.raises(PolicyError):
        make_policy_env(Policy.load(find_policy("peg_near")), robot=robot)
