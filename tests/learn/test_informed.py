"""Critics are told the truth; the actor, and so the policy, is as any other."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.observation import POSITION_SCALE, THETA_SCALE
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import find_recipe, read_settings
from dovetail.poses import UNMOVED, rotation_error, theta_about_vertical
from extras import need

CONFIG = TrainConfig(
    **{
        **read_settings(find_recipe("search")),
        "doubt": 0.02,
        "doubt_turn": 0.05,
        "vary": "peg=square,triangle",
        "script": "corner",
        "informed": True,
        "num_envs": 3,
        "threads": 1,
        "max_steps": 4,
        "learning_starts": 30,
        "net": (8,),
    }
)
TOLD = 4 + 2


@pytest.fixture
def env():
    need("sbx")
    from dovetail.learn.algorithms import make_vec_env
    from dovetail.learn.privileged_critic import PrivilegedCritic

    kinds = CONFIG.kinds(3)
    made = PrivilegedCritic(make_vec_env(CONFIG), kinds)
    yield made
    made.close()


def unscaled(row, scales):
    return np.sign(row) * np.expm1(np.abs(row)) * scales


def test_it_tells_where_the_fixture_is_and_of_which_kind(env):
    seen = env.reset()
    assert seen.shape == (3, *env.observation_space.shape)
    for i, one in enumerate(env.venv.envs):
        core = require_contact_env(one)
        off, turn = seen[i, -TOLD:-3], seen[i, -3]
        believed = core.tracker.estimate().pose
        np.testing.assert_allclose(
            unscaled(off, POSITION_SCALE),
            core.fixture.position - believed.position,
            atol=1e-7,
        )
        assert unscaled(turn, THETA_SCALE) == pytest.approx(
            theta_about_vertical(core.fixture.quat_wxyz, believed.quat_wxyz), abs=1e-6
        )
    np.testing.assert_array_equal(seen[:, -2:], [[1, 0], [0, 1], [1, 0]])


def test_the_last_observation_of_an_episode_has_that_episodes_truth(env):
    first = env.reset()
    nothing = np.zeros((3, 6), dtype=np.float32)
    for _ in range(3):
        env.step(nothing)
    seen, _, dones, infos = env.step(nothing)
    assert dones.all()
    last = np.array([info["terminal_observation"] for info in infos])
    np.testing.assert_array_equal(last[:, -TOLD:], first[:, -TOLD:])
    assert (seen[:, -TOLD] != first[:, -TOLD]).all()


def test_the_actor_does_not_look_at_the_truth_and_the_policy_has_no_room_for_it(env):
    from dovetail.learn.algorithms import make_model
    from dovetail.learn.export import export_policy

    model = make_model(replace(CONFIG, script=None), env.venv)
    seen = np.tile(env.reset()[:1], (2, 1))
    seen[1, -TOLD:] += 1.0
    first, second = model.predict(seen, deterministic=True)[0]
    np.testing.assert_array_equal(first, second)
    size = env.venv.observation_space.shape[0]
    policy = export_policy(model, CONFIG, env.venv.envs[0], wall_time=0.0)
    assert policy.observation_size == policy.metadata["observation"]["size"] == size
    one, two = (
        np.asarray(model.qf.apply(model.policy.qf_state.params, row[None], first[None]))
        for row in seen
    )
    assert np.abs(one - two).min() > 0.0


@pytest.mark.parametrize(
    "change", [{"algorithm": "td3"}, {"demos": ("logs",)}, {"teacher": "logs"}]
)
def test_only_sac_without_logs_is_informed(change):
    with pytest.raises(ConfigError, match="leave --informed out"):
        replace(CONFIG, script=None, **change)


def test_critics_are_told_where_a_displaced_part_is():
    need("sbx")
    from dovetail.learn.algorithms import make_vec_env
    from dovetail.learn.privileged_critic import PrivilegedCritic

    config = replace(CONFIG, grasp_error=0.002, grasp_turn=0.04)
    made = PrivilegedCritic(make_vec_env(config), config.kinds(3))
    seen = made.reset()
    assert seen.shape[1] == made.venv.observation_space.shape[0] + 10 + 2
    for i, one in enumerate(made.venv.envs):
        grasp = require_contact_env(one).grasp
        told = unscaled(seen[i, -8:-5], POSITION_SCALE)
        np.testing.assert_allclose(told, grasp.position, atol=1e-8)
        turned = unscaled(seen[i, -5:-2], THETA_SCALE)
        expected = rotation_error(grasp.quat_wxyz, UNMOVED.quat_wxyz)
        np.testing.assert_allclose(turned, expected, atol=1e-6)
    made.close()
