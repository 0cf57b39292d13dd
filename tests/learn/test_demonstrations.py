"""Episode logs become the transitions that the environment itself would have given."""

from dataclasses import replace
from io import StringIO

import gymnasium as gym
import numpy as np
import pytest
from rich.console import Console

from dovetail.envs import registered
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.log_facts import (
    ACTION,
    CELL,
    FIRST,
    SUCCESS,
    describe_cell,
    describe_first,
    observed_columns,
)
from dovetail.episode import Episode
from dovetail.errors import ConfigError, LogError, PlantError
from dovetail.learn.config import TrainConfig
from dovetail.learn.demonstrations import Transitions, fill, load_demonstrations
from dovetail.learn.recorded_steps import find_logs, read_steps
from extras import need

STEPS = 12
TILTED = {"task": "XYZ:force ABC:pose", "also": ("tilt",), "recall": (2, 4)}


def make(**settings):
    return registered.make("dovetail/PegInHole-v0", **settings)


def record(env, path, *, seed=0, success=False, led=None, stretch=1.0, **metadata):
    """Write a log of random actions; return what the environment said and was told."""
    rng = np.random.default_rng(seed)
    core = env.unwrapped
    seen, info = env.reset(seed=seed)
    observations, actions, rewards = [seen], [], []
    about = describe_cell(env) | describe_first(env, info["observation_raw"])
    episode = Episode(metadata=about, observed=observed_columns(env))
    for step in range(STEPS):
        action = rng.uniform(-1.0, 1.0, len(core.commands)).astype(np.float32)
        seen, reward, *_, info = env.step(action)
        log = core.state.log.copy()
        log[:, 0] *= stretch
        raw = info["observation_raw"]
        episode.append(log, step, action, reward, raw, is_intervention=led)
        observations.append(seen)
        actions.append(action)
        rewards.append(reward)
    episode.metadata |= {SUCCESS: success, **metadata}
    episode.save(path)
    return np.array(observations), np.array(actions), np.array(rewards, dtype="f4")


@pytest.fixture
def env():
    made = make()
    yield made
    made.close()


@pytest.mark.parametrize(
    "settings",
    [{}, {"stack": 2}, TILTED, {**TILTED, "stack": 1}, {"also": ("spin", "force")}],
    ids=["plain", "stack", "search", "both", "force"],
)
def test_what_was_seen_is_what_the_environment_showed(tmp_path, settings):
    env = make(**settings)
    seen, actions, rewards = record(env, tmp_path / "log.npz")
    found = load_demonstrations([str(tmp_path / "log.npz")], env)
    np.testing.assert_array_equal(found.observations, seen[:-1])
    np.testing.assert_array_equal(found.next_observations, seen[1:])
    np.testing.assert_array_equal(found.actions, actions)
    np.testing.assert_array_equal(found.rewards, rewards)
    env.close()


def test_a_stack_that_the_recording_had_not_is_made_of_it(tmp_path, env):
    record(env, tmp_path / "log.npz")
    stacked = make(stack=2, recall=(3,))
    seen, *_ = record(stacked, tmp_path / "other.npz")
    found = load_demonstrations([str(tmp_path / "log.npz")], stacked)
    np.testing.assert_array_equal(found.observations, seen[:-1])
    stacked.close()


@pytest.mark.parametrize("success", [True, False])
def test_only_a_success_ends_what_is_worth_something(tmp_path, env, success):
    for number in range(2):
        record(env, tmp_path / f"{number}.npz", seed=number, success=success)
    found = load_demonstrations([str(tmp_path)], env)
    ends = np.arange(2 * STEPS) % STEPS == STEPS - 1
    np.testing.assert_array_equal(found.is_last, ends)
    np.testing.assert_array_equal(found.is_success, ends & success)


def test_a_log_that_began_in_the_middle_gives_all_but_its_first_step(tmp_path, env):
    seen, actions, _ = record(env, tmp_path / "log.npz")
    episode = Episode.load(tmp_path / "log.npz")
    del episode.metadata[FIRST]
    episode.save(tmp_path / "log.npz")
    found = load_demonstrations([str(tmp_path / "log.npz")], env)
    np.testing.assert_array_equal(found.observations, seen[1:-1])
    np.testing.assert_array_equal(found.actions, actions[1:])


def test_who_acted_is_read_back(tmp_path, env):
    for led in (True, False, None):
        record(env, tmp_path / "log.npz", led=led)
        assert (read_steps(tmp_path / "log.npz").is_led == bool(led)).all()


@pytest.mark.parametrize(
    ("key", "name", "value", "words"),
    [
        (CELL, "env_id", "dovetail/RailClip-v0", "with env dovetail/RailClip-v0"),
        (CELL, "robot", "fr3", "with robot fr3, this run has iiwa14"),
        (CELL, "task", {"peg": "round"}, "with peg round, this run has square"),
        (ACTION, "axes", ["X"], "record or train with the same --task"),
        (ACTION, "scale", [1.0, 4.0, 4.0, 0.2], "give f_scale"),
        (ACTION, "scale", "much", "give f_scale"),
        (ACTION, "force_damping", [0.0] * 3, "give --force-damping"),
        (ACTION, "force_weight", 0.1, "train with --force-weight"),
        (ACTION, "script", "corner", "its actions correct a script's"),
    ],
)
def test_a_log_of_something_else_is_refused_with_what_to_do(
    tmp_path, env, key, name, value, words
):
    facts = describe_cell(env)[key] | {name: value}
    record(env, tmp_path / "log.npz", **{key: facts})
    with pytest.raises(LogError, match=words) as caught:
        load_demonstrations([str(tmp_path)], env)
    assert "log.npz" in str(caught.value)


def test_a_wider_gap_is_no_other_task(tmp_path, env):
    wide = make(clearance=0.001)
    record(wide, tmp_path / "log.npz")
    wide.close()
    assert len(load_demonstrations([str(tmp_path)], env)) == STEPS


def test_steps_of_another_length_are_refused(tmp_path, env):
    record(env, tmp_path / "log.npz", stretch=2.0)
    with pytest.raises(LogError, match=r"steps of 100.0 ms, a policy's have 50 ms"):
        load_demonstrations([str(tmp_path)], env)


def test_a_column_that_the_policy_sees_must_be_in_the_log(tmp_path, env):
    record(env, tmp_path / "log.npz")
    seeing = make(also=("force",))
    with pytest.raises(LogError, match="no column obs_fx"):
        load_demonstrations([str(tmp_path)], seeing)
    seeing.close()


@pytest.mark.parametrize("kind", ["missing", "folder", "empty", "damaged", "silent"])
def test_what_is_no_demonstration_is_said(tmp_path, env, kind):
    path = tmp_path / "log.npz"
    words = {
        "missing": "there is no Episode log",
        "folder": "no Episode log .* in it",
        "empty": "is empty",
        "damaged": "cut short",
        "silent": "does not say of which cell",
    }[kind]
    if kind == "folder":
        path.mkdir()
    elif kind == "empty":
        Episode(metadata={}).save(path)
    elif kind == "damaged":
        record(env, path)
        path.write_bytes(path.read_bytes()[:-100])
    elif kind == "silent":
        record(env, path, **{CELL: 3})
    with pytest.raises(LogError, match=words):
        load_demonstrations([str(path)], env)


def counted(count):
    """Transitions whose reward is their number; each fifth ends, each tenth well."""
    numbers = np.arange(count, dtype=np.float32)
    rows = numbers[:, None]
    return Transitions(
        observations=rows,
        next_observations=rows + 1.0,
        actions=rows,
        rewards=numbers,
        is_last=(numbers % 5 == 4) | (numbers == count - 1),
        is_success=numbers % 10 == 9,
    )


@pytest.mark.parametrize(("count", "num_envs"), [(20, 1), (20, 4), (23, 4), (3, 4)])
def test_a_buffer_holds_each_transition_and_no_episode_runs_into_another(
    count, num_envs
):
    need("sbx")
    from dovetail.learn.taught_replay import TaughtReplay

    box = gym.spaces.Box(-1e3, 1e3, (1,), dtype=np.float32)
    rows = -(-count // num_envs)
    buffer = TaughtReplay(
        (rows + 5) * num_envs,
        box,
        box,
        n_envs=num_envs,
        taught=rows,
        share=1.0,
        n_steps=3,
        gamma=0.5,
    )
    fill(buffer, counted(count), reward_scale=2.0)
    assert set(buffer.rewards[:rows].ravel()) == set(2.0 * np.arange(count))
    for step in range(5):
        one = np.full((num_envs, 1), 1e3, dtype=np.float32)
        zeros = np.zeros(num_envs)
        buffer.add(one, one, one, zeros, zeros, [{}] * num_envs)
        assert buffer.pos == rows + (step + 1) % 5
    np.random.seed(0)  # noqa: NPY002  (the base class draws from it)
    batch = buffer.sample(2000)
    begin = batch.observations.numpy().ravel()
    end = batch.next_observations.numpy().ravel() - 1.0
    assert begin.max() < count
    assert (begin // 5 == end // 5).all()  # of the same episode
    is_done = batch.dones.numpy().ravel() == 1.0
    np.testing.assert_array_equal(is_done, end % 10 == 9)
    steps = (end - begin).astype(int)
    expected = [
        sum(2.0 * 0.5**k * (b + k) for k in range(n + 1))
        for b, n in zip(begin, steps, strict=True)
    ]
    np.testing.assert_allclose(batch.rewards.numpy().ravel(), expected)


TINY = {
    "steps": 32,  # random actions alone: an update would be compiled for seconds
    "learning_starts": 32,
    "net": (8,),
    "num_envs": 2,
    "threads": 1,
    "eval_episodes": 0,
    "pretrain": 0,
}


@pytest.mark.parametrize("option", ["demos", "teacher"])
def test_a_run_begins_with_the_demonstrations_and_says_so(tmp_path, env, option):
    need("sbx")
    from dovetail.learn.checkpoint import list_checkpoints
    from dovetail.learn.train import train

    logs = tmp_path / "logs"
    logs.mkdir()
    _, actions, _ = record(env, logs / "001.npz")
    given = (str(logs),) if option == "demos" else str(logs)
    config = TrainConfig(**TINY, out=tmp_path / "run", **{option: given})
    assert f"--{option} {logs}" in config.command()
    (result,) = train(config, Console(quiet=True))
    assert result.steps == 32
    (newest,) = list_checkpoints(tmp_path / "run" / "checkpoints")
    with np.load(newest) as arrays:
        assert len(arrays["actions"]) == STEPS // 2 + 16
        shown = arrays["actions"][: STEPS // 2].transpose(1, 0, 2).reshape(STEPS, 4)
    np.testing.assert_array_equal(shown, actions)


@pytest.fixture
def logs(tmp_path, env):
    """A folder with one demonstration."""
    folder = tmp_path / "logs"
    folder.mkdir()
    record(env, folder / "001.npz")
    return folder


def counted_updates(run):
    from dovetail.learn.checkpoint import list_checkpoints

    with np.load(list_checkpoints(run / "checkpoints")[-1]) as arrays:
        return arrays["num_timesteps"], arrays["_n_updates"]


def test_a_run_learns_from_demonstrations_before_its_first_action_and_only_then(
    tmp_path, logs, monkeypatch
):
    """Nine gradient steps are five rounds of two; a resumed run has them behind it."""
    need("sbx")
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

    from dovetail.learn.train import train

    taught = {"pretrain": 9, "learning_starts": 1000, "updates_per_step": 1}
    config = TrainConfig(
        **{**TINY, **taught}, out=tmp_path / "run", demos=(str(logs),), batch_size=8
    )
    step, taken, own = ContactEnv.step, [], []
    predict = OffPolicyAlgorithm.predict

    def stop_once(self, action):
        taken.append(action)
        if len(taken) == 9:
            raise PlantError("the simulation diverged")
        return step(self, action)

    def act(self, *args, **kwargs):
        own.append(self.num_timesteps)
        return predict(self, *args, **kwargs)

    monkeypatch.setattr(ContactEnv, "step", stop_once)
    monkeypatch.setattr(OffPolicyAlgorithm, "predict", act)
    output = StringIO()
    with pytest.raises(PlantError):
        train(config, Console(file=output))
    assert "0/32 steps, pretraining" in output.getvalue()
    assert counted_updates(config.out) == (8, 10 + 8)
    output = StringIO()
    train(replace(config, resume=True), Console(file=output))
    assert "pretraining" not in output.getvalue()
    assert counted_updates(config.out) == (32, 10 + 32)
    # No action was random, neither before the interruption nor after it.
    assert own == [0, 2, 4, 6, 8, *range(8, 32, 2)]


def test_pretraining_moves_the_networks_and_not_the_entropy_coefficient(logs):
    need("sbx")
    import jax
    from stable_baselines3.common.logger import configure

    from dovetail.learn.algorithms import make_model, make_vec_env
    from dovetail.learn.checkpoint import trained_states
    from dovetail.learn.demonstrations import pretrain

    changes = {"pretrain": 8, "updates_per_step": 1, "batch_size": 8}
    config = TrainConfig(**{**TINY, **changes}, demos=(str(logs),))
    env = make_vec_env(config)
    model = make_model(config, env)
    model.set_logger(configure(None, []))
    before = trained_states(model)
    pretrain(model, config)
    after = trained_states(model)
    for name, state in after.items():
        pairs = zip(jax.tree.leaves(before[name]), jax.tree.leaves(state), strict=True)
        is_same = all(np.array_equal(old, new) for old, new in pairs)
        assert is_same == (name == "ent_coef_state"), name
    env.close()


@pytest.mark.parametrize(
    ("given", "steps", "share"),
    [
        ({}, 0, 0.5),
        ({"demos": ("logs",)}, 2000, 0.2),
        ({"demos": ("logs",), "pretrain": 0}, 0, 0.5),
        ({"demos": ("logs",), "from_policy": "peg_square"}, 0, 0.5),
        ({"demos": ("logs",), "pretrain": 7}, 7, 0.2),
        ({"demos": ("logs",), "pretrain": 7, "teacher_share": 0.5}, 7, 0.5),
    ],
)
def test_much_is_learned_from_demonstrations_before_the_first_action(
    given, steps, share
):
    config = TrainConfig(**given)
    assert (config.pretrain, config.teacher_share) == (steps, share)
    for name, option in (("pretrain", "--pretrain"), ("teacher_share", "--teacher-s")):
        assert (option in config.command()) == (name in given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "pretrain is 5, which needs demonstrations"),
        ({"demos": ("logs",), "from_policy": "peg_square"}, "an actor that is new"),
    ],
)
def test_pretraining_without_what_it_needs_is_refused(given, words):
    with pytest.raises(ConfigError, match=words):
        TrainConfig(pretrain=5, **given)


def test_demonstrations_are_for_algorithms_with_a_replay_buffer():
    with pytest.raises(ConfigError, match="with ppo no --demos"):
        TrainConfig(demos=("logs",), algorithm="ppo")


def test_folders_and_files_are_found_in_order(tmp_path):
    names = ["b.npz", "a.parquet", "c.txt"]
    for name in names:
        (tmp_path / name).touch()
    found = find_logs([str(tmp_path), str(tmp_path / "b.npz")])
    assert [path.name for path in found] == ["a.parquet", "b.npz", "b.npz"]
