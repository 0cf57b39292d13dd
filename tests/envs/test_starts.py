"""Where episodes start: reachable, with one and the same bend of the arm."""

import gymnasium as gym
import numpy as np
import pytest

import dovetail  # noqa: F401  (registers the environments)


@pytest.mark.parametrize("name", ["PegInHole", "RailClip"])
def test_every_start_is_reached_with_one_bend_far_from_the_wrists_limits(name):
    env = gym.make(f"dovetail/{name}-v0")
    robot = env.unwrapped.arm.facts.robot
    q = []
    for seed in range(100):
        env.reset(seed=seed)  # a start out of reach is an error
        q.append(env.unwrapped.state.q)
    env.close()
    margin = np.minimum(np.array(q) - robot.limits.q_min, robot.limits.q_max - q).min(
        axis=0
    )
    assert margin.min() > 0.1
    assert margin[6] > 2.0
    # With two bends for neighbouring starts a policy has two tasks to learn.
    assert np.ptp(q, axis=0).max() < 1.7
