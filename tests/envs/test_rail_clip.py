import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env

from dovetail.envs.registered import make


def test_gymnasium_makes_the_rail_clip_and_it_passes_check_env():
    env = gym.make("dovetail/RailClip-v0")
    check_env(env.unwrapped)
    assert env.action_space.shape == (2,)
    env.close()


def clip(env, seed, align):
    """Turn the clip straight if asked, then push; return the last info."""
    _, info = env.reset(seed=seed)
    for _ in range(env.max_steps):
        is_straight = abs(info["theta_error"]) < 0.01 or not align
        turn = 0.0 if align else np.sign(info["theta_error"])
        action = np.array([0.5 if is_straight else 0.0, turn], dtype=np.float32)
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    return info


def test_an_aligned_clip_goes_on_the_rail_and_a_turned_one_does_not():
    env = make("dovetail/RailClip-v0", max_steps=100).unwrapped
    for seed in range(3):
        aligned = clip(env, seed, align=True)
        assert aligned["success"], aligned
        assert aligned["limit_violations"] == 0
        assert not clip(env, seed, align=False)["success"]
    env.close()
