"""A teacher fills the start of the buffer, and stays in every batch."""

import numpy as np
import pytest
from rich.console import Console

from dovetail.envs.registered import make_env
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import find_recipe, read_settings
from dovetail.learn.policy import Policy
from dovetail.learn.teacher import Teacher
from dovetail.search.corner import SEARCH_AXES, CornerSearch
from dovetail.tasks.peg_in_hole.task import PegInHole
from extras import need

TINY = {
    **read_settings(find_recipe("search")),
    "doubt": 0.02,
    "steps": 32,  # the teacher alone: an update would be compiled for seconds
    "learning_starts": 32,
    "batch_size": 8,
    "net": (8,),
    "num_envs": 4,
    "threads": 1,
    "eval_episodes": 0,
}


def env(seed):
    made = make_env(PegInHole, task=SEARCH_AXES, theta_range=0.3)
    made.reset(seed=seed)
    return made


def test_a_teacher_without_noise_is_the_script():
    made = env(0)
    teacher = Teacher([made], 0.0, 0)
    alone = CornerSearch(made)
    for _ in range(3):
        action = alone(np.zeros(0, dtype=np.float32))
        np.testing.assert_array_equal(teacher.act()[0], action)
        made.step(action)


def test_noise_has_the_size_that_is_asked_for_and_leaves_the_range_alone():
    made = env(1)
    quiet = Teacher([made], 0.0, 0).act()[0]
    noisy = Teacher([made], 0.1, 0)
    actions = np.array([noisy.act()[0] for _ in range(500)])
    assert np.abs(actions).max() <= 1.0
    free = np.abs(quiet) < 0.5
    spread = (actions - quiet)[:, free].std()
    assert spread == pytest.approx(0.1, rel=0.1)  # 500 x 3 draws


def test_where_a_script_is_corrected_the_teacher_corrects_nothing():
    made = make_env(PegInHole, task=SEARCH_AXES, theta_range=0.3, script="corner")
    made.reset(seed=0)
    assert not Teacher([made], 0.0, 0).act().any()


def corrected(algorithm):
    changes = {
        "script": "corner",
        "algorithm": algorithm,
        "steps": 64,
        "policy_delay": 1,
    }
    return TrainConfig(**{**TINY, **changes})


@pytest.mark.parametrize("algorithm", ["sac", "tqc", "td3", "ddpg", "crossq"])
def test_who_corrects_a_script_begins_with_nothing(algorithm):
    need("sbx")
    from dovetail.learn.algorithms import make_model, make_vec_env

    config = corrected(algorithm)
    env = make_vec_env(config)
    model = make_model(config, env)
    actions, _ = model.predict(env.reset(), deterministic=True)
    env.close()
    assert np.abs(actions).max() < 1e-6


def test_the_critics_of_a_correction_learn_before_the_actor_does(monkeypatch):
    need("sbx")
    import jax

    from dovetail.learn import teacher
    from dovetail.learn.algorithms import make_model, make_vec_env

    monkeypatch.setattr(teacher, "_JUDGED", 8)
    config = corrected("sac")
    env = make_vec_env(config)
    model = make_model(config, env)
    model.learn(config.learning_starts)  # the teacher's steps
    before = jax.tree.leaves(model.policy.actor_state.params)
    critics = jax.tree.leaves(model.policy.qf_state.params)
    model._learn_to_judge(4, 8)
    env.close()
    after = jax.tree.leaves(model.policy.actor_state.params)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old, new)
    changed = zip(critics, jax.tree.leaves(model.policy.qf_state.params), strict=True)
    assert all(np.abs(np.asarray(new - old)).max() > 0.0 for old, new in changed)
    assert model._n_updates == 0
    assert model.policy_delay == config.policy_delay


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_batch_has_the_share_of_the_teacher(share):
    need("sbx")
    import gymnasium as gym

    from dovetail.learn.taught_replay import TaughtReplay

    box = gym.spaces.Box(-1.0, 1.0, (1,), dtype=np.float32)
    replay = TaughtReplay(200, box, box, taught=20, share=share, n_steps=1, gamma=0.9)
    for step in range(200):
        one = np.full((1, 1), step / 200.0, dtype=np.float32)
        replay.add(one, one, one, np.zeros(1), np.zeros(1), [{}])
    np.random.seed(0)  # noqa: NPY002  (the base class draws from it)
    seen = 200.0 * replay.sample(4000).observations.numpy()
    expected = share + (1.0 - share) * 0.1
    assert np.mean(seen < 19.5) == pytest.approx(expected, abs=0.03)


def test_a_full_buffer_keeps_what_was_taught_and_no_return_crosses_its_ends():
    """Steps are numbered; rewards are 1 while taught and 10,000 where replaced."""
    need("sbx")
    import gymnasium as gym

    from dovetail.learn.taught_replay import TaughtReplay

    box = gym.spaces.Box(-1e9, 1e9, (1,), dtype=np.float32)
    replay = TaughtReplay(20, box, box, taught=5, share=0.5, n_steps=3, gamma=1.0)
    for step in range(53):  # around three times
        one = np.full((1, 1), step, dtype=np.float32)
        reward = 1.0 if step < 5 else 100.0 if step < 20 else 10_000.0
        replay.add(one, one, one, np.full(1, reward), np.zeros(1), [{}])
    assert replay.full
    assert replay.pos == 5 + (53 - 20) % 15
    newest = list(range(50, 53)) + list(range(38, 50))
    assert replay.observations.ravel().tolist() == [0, 1, 2, 3, 4, *newest]
    batch = replay._get_samples(np.arange(20))
    begin, end = (
        x.numpy().ravel() for x in (batch.observations, batch.next_observations)
    )
    # Two more steps, but not over the end of what was taught, nor of the memory (49).
    last = np.select([begin < 5, begin < 50], [4, 49], 52)
    np.testing.assert_array_equal(end, np.minimum(begin + 2, last))
    rewards = np.where(begin < 5, 1.0, 10_000.0) * (end - begin + 1)
    np.testing.assert_array_equal(batch.rewards.numpy().ravel(), rewards)


def test_a_run_with_doubt_learns_from_its_teacher_and_its_policy_knows_no_doubt(
    tmp_path,
):
    need("sbx")
    from dovetail.learn.train import train

    config = TrainConfig(**TINY, out=tmp_path / "run")
    (result,) = train(config, Console(quiet=True))
    policy = Policy.load(result.policy)
    assert policy.metadata["env"]["tracker"] == "truth"
    assert policy.metadata["env"]["recall"] == [4, 8, 12, 16]
    assert policy.observation_size == 14 + 2 + 6 + 4 * 5
    command = policy.metadata["provenance"]["command"]
    assert "--doubt 0.02" in command
    assert "--recall 4 8 12 16" in command
    assert read_settings(tmp_path / "run")["teacher"] == "corner"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"doubt": 0.06}, "doubt is 0.06 m; allowed: 0 to 0.05 m"),
        ({"tracker": "noisy"}, "doubt and the tracker noisy exclude each other"),
        ({"algorithm": "ppo"}, "give --teacher none"),
        ({"teacher_share": 1.1}, "teacher_share"),
        ({"correction": 0.2}, "correction is given, which needs --script corner"),
        ({"teacher": "none", "teacher_noise": 0.3}, "which needs --teacher corner"),
        ({"teacher": "none", "teacher_share": 0.3}, "needs a teacher or --demos"),
        ({"script": "corner", "demos": ("logs",)}, "an action is a correction"),
        ({"script": "corner", "algorithm": "ppo", "teacher": "none"}, "a correction"),
    ],
)
def test_what_cannot_be_taught_is_refused_with_what_to_give(change, words):
    with pytest.raises(ConfigError, match=words):
        TrainConfig(**{**TINY, **change})


def test_no_script_is_said_as_no_teacher_is():
    assert TrainConfig(script="none").script is None
