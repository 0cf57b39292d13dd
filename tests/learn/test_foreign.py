"""Models of plain Stable-Baselines3 and SBX become policies of equal actions."""

import base64
import json
import os
import pickle
import zipfile
from functools import cache
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from dovetail.errors import ConfigError, PolicyError, install_command

pytest.importorskip("sbx", reason=install_command("learn"))

import jax
import sbx
import stable_baselines3 as sb3
import torch

from dovetail.cli import run
from dovetail.envs import registered
from dovetail.learn.foreign import (
    import_file,
    import_model,
    make_policy,
    require_same_actions,
)
from dovetail.learn.foreign_actor import read_actor
from dovetail.learn.policy import Policy
from dovetail.learn.policy_env import make_policy_env
from dovetail.learn.policy_env_config import PolicyEnvConfig
from dovetail.tasks.peg_in_hole.task import PegInHole

ID = "dovetail/PegInHole-v0"
TOLERANCE = 1e-5
"""Largest difference of an action, of a range of 2."""
MODELS = [
    *(f"stable_baselines3.{name}" for name in ("PPO", "A2C", "SAC", "TD3", "DDPG")),
    *(f"sbx.{name}" for name in ("PPO", "SAC", "TD3", "DDPG", "TQC", "CrossQ")),
]


@cache
def environment():
    return gym.make(ID, disable_env_checker=True)


def shaken(tree, rng):
    return jax.tree.map(lambda x: x + 0.1 * np.abs(rng.normal(size=np.shape(x))), tree)


def random_model(name, rng, **kwargs):
    """Return a model of random weights and biases."""
    library, _, algorithm = name.partition(".")
    kind = getattr({"stable_baselines3": sb3, "sbx": sbx}[library], algorithm)
    kwargs.setdefault("policy_kwargs", {}).setdefault("net_arch", [16, 12])
    model = kind("MlpPolicy", kwargs.pop("env", environment()), seed=1, **kwargs)
    if library == "sbx":
        state = model.policy.actor_state
        state = state.replace(params=shaken(state.params, rng))
        if hasattr(state, "batch_stats"):
            state = state.replace(batch_stats=shaken(state.batch_stats, rng))
        model.policy.actor_state = state
    else:
        with torch.no_grad():
            for parameter in model.policy.parameters():
                parameter += 0.1 * torch.randn(parameter.shape)
    return model


def saved(model, tmp_path) -> Path:
    model.save(tmp_path / "model.zip")
    return tmp_path / "model.zip"


def imported(path, *, is_trusted=True):
    return import_file(path, environment(), PolicyEnvConfig(), is_trusted=is_trusted)


def require_actions(policy, model, rng):
    observations = rng.uniform(-3.0, 3.0, (50, 14)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    actions = np.array([policy(observation) for observation in observations])
    np.testing.assert_allclose(actions, expected, atol=TOLERANCE, rtol=0.0)
    assert np.ptp(actions, axis=0).min() > 1e-3


@pytest.mark.parametrize("name", MODELS)
def test_a_saved_model_acts_as_it_did(name, tmp_path, rng):
    model = random_model(name, rng)
    policy = imported(saved(model, tmp_path))
    require_actions(policy, model, rng)
    facts = policy.metadata["provenance"]
    assert name.partition(".")[0] in facts["policy_class"]
    assert facts["model_file"] == "model.zip"
    is_on_policy = name.rpartition(".")[2] in ("PPO", "A2C")
    assert ("VecNormalize" in facts.get("note", "")) is not is_on_policy
    assert len(facts["model_sha256"]) == 64


@pytest.mark.parametrize(
    ("name", "activation"),
    [
        ("stable_baselines3.SAC", torch.nn.Tanh),
        ("stable_baselines3.PPO", torch.nn.ReLU),
        ("sbx.SAC", jax.numpy.tanh),
        ("sbx.PPO", jax.nn.relu),
    ],
)
def test_another_activation_is_found(name, activation, tmp_path, rng):
    model = random_model(name, rng, policy_kwargs={"activation_fn": activation})
    policy = imported(saved(model, tmp_path))
    require_actions(policy, model, rng)


@pytest.mark.parametrize(
    ("name", "kwargs", "words"),
    [
        (
            "stable_baselines3.SAC",
            {"policy_kwargs": {"activation_fn": torch.nn.ELU}},
            "activation is 'elu'; known: relu, tanh",
        ),
        (
            "sbx.SAC",
            {"policy_kwargs": {"activation_fn": jax.nn.silu}},
            "activation is 'silu'; known: relu, tanh",
        ),
        ("stable_baselines3.SAC", {"use_sde": True}, "use_sde=False"),
        ("sbx.PPO", {"use_sde": True}, "use_sde=False"),
    ],
)
def test_a_network_that_cannot_be_run_is_refused(name, kwargs, words, tmp_path, rng):
    model = random_model(name, rng, **kwargs)
    with pytest.raises(PolicyError, match=words):
        read_actor(model)


def test_another_features_extractor_is_refused(tmp_path, rng):
    from stable_baselines3.common.torch_layers import FlattenExtractor

    class Doubling(FlattenExtractor):
        def forward(self, observations):
            return 2.0 * super().forward(observations)

    kwargs = {"features_extractor_class": Doubling}
    model = random_model("stable_baselines3.PPO", rng, policy_kwargs=kwargs)
    with pytest.raises(PolicyError, match=r"features extractor .*only multilayer"):
        read_actor(model)


def test_actions_of_another_range_are_refused(tmp_path, rng):
    wide = gym.wrappers.RescaleAction(environment(), -2.0, 2.0)
    model = random_model("stable_baselines3.TD3", rng, env=wide)
    with pytest.raises(PolicyError, match="without RescaleAction"):
        read_actor(model)


def test_a_model_in_this_process_brings_its_environments_settings(rng, tmp_path):
    env = gym.make(ID, peg="round", clearance=0.001, f_scale=[4.0, 4.0, 2.0])
    model = random_model("stable_baselines3.SAC", rng, env=env)
    policy = Policy.load(import_model(model, env).save(tmp_path / "mine"))
    settings = policy.metadata["env"]
    assert (settings["peg"], settings["clearance"]) == ("round", 0.001)
    assert settings["f_scale"] == [4.0, 4.0, 2.0]
    assert settings["task"] == "XYZ:force A:pose BC:hold"
    again = make_policy_env(policy)
    assert again.unwrapped.task.peg == "round"
    policy.reset()
    observation, _ = again.reset(seed=0)
    assert again.action_space.contains(policy(observation))
    for one in (env, again):
        one.close()


def test_normalised_observations_are_refused(rng):
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    vec = VecNormalize(DummyVecEnv([environment]))
    model = random_model("stable_baselines3.PPO", rng, env=vec)
    with pytest.raises(PolicyError, match="norm_obs=False"):
        import_model(model, environment())


def test_an_environment_without_a_name_is_refused(rng):
    with pytest.raises(ConfigError, match=r"gymnasium\.make"):
        make_policy([], registered.make_env(PegInHole), activation="", output="")


@pytest.mark.parametrize("process", ["DummyVecEnv", "SubprocVecEnv"])
def test_the_environments_of_make_vec_env_bring_their_settings(process, rng):
    from stable_baselines3.common import env_util, vec_env

    wrapped = vec_env.VecMonitor(
        env_util.make_vec_env(
            f"dovetail:{ID}",  # a process that is spawned has to import it
            2,
            env_kwargs={"peg": "round", "clearance": 0.001},
            vec_env_cls=getattr(vec_env, process),
        )
    )
    try:
        model = random_model("stable_baselines3.PPO", rng, env=wrapped, n_steps=8)
        policy = import_model(model, wrapped)
    finally:
        wrapped.close()
    settings = policy.metadata["env"]
    assert (settings["peg"], settings["clearance"]) == ("round", 0.001)
    require_actions(policy, model, rng)


def test_a_wide_network_is_not_refused_for_its_rounding(rng):
    kwargs = {"net_arch": [512, 512, 512]}
    model = random_model("stable_baselines3.TD3", rng, policy_kwargs=kwargs)
    import_model(model, environment())


class Halved(gym.ObservationWrapper):
    """Changes what is seen and keeps the space."""

    def observation(self, observation):
        return 0.5 * observation


@pytest.mark.parametrize("is_given", [True, False])
def test_a_wrapper_that_changes_observations_is_refused(is_given, rng):
    env = Halved(environment())
    model = random_model("stable_baselines3.PPO", rng, env=env)
    with pytest.raises(PolicyError, match=r"under (Halved|ObservationWrapper)"):
        import_model(model, env if is_given else environment())


def test_a_model_that_acts_otherwise_is_refused(rng):
    """Its output differs for a reason that its metadata does not show: it clips."""
    model = random_model("stable_baselines3.PPO", rng)
    policy = import_model(model, environment())
    predict = model.predict
    model.predict = lambda seen, **k: predict(np.clip(seen, -3.0, 3.0), **k)
    with pytest.raises(PolicyError, match="differ by up to"):
        require_same_actions(policy, model, environment())


class Picking(gym.ActionWrapper):
    """Four actions to choose from."""

    def __init__(self, env):
        super().__init__(env)
        self.action_space = gym.spaces.Discrete(4)

    def action(self, action):
        return np.eye(4, dtype=np.float32)[int(action)]


@pytest.mark.parametrize("is_trusted", [True, False])
@pytest.mark.parametrize("library", ["stable_baselines3", "sbx"])
def test_discrete_actions_are_refused(library, is_trusted, rng, tmp_path):
    model = random_model(f"{library}.PPO", rng, env=Picking(environment()))
    with pytest.raises(PolicyError, match=r"Discrete\(4\)"):
        imported(saved(model, tmp_path), is_trusted=is_trusted)
    with pytest.raises(PolicyError, match=r"Discrete\(4\)"):
        read_actor(model)


@pytest.mark.parametrize("is_trusted", [True, False])
@pytest.mark.parametrize("library", ["stable_baselines3", "sbx"])
def test_a_file_trained_under_vecnormalize_is_refused(
    library, is_trusted, rng, tmp_path
):
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    vec = VecNormalize(DummyVecEnv([environment]))
    model = random_model(f"{library}.PPO", rng, env=vec, n_steps=16, batch_size=16)
    model.learn(16)
    with pytest.raises(PolicyError, match="VecNormalize"):
        imported(saved(model, tmp_path), is_trusted=is_trusted)


def test_an_off_policy_file_is_refused_where_its_last_observation_shows_it(
    rng, tmp_path
):
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    vec = VecNormalize(DummyVecEnv([environment]))
    model = random_model("stable_baselines3.SAC", rng, env=vec, learning_starts=30)
    model.learn(25)
    assert (np.abs(model._last_obs) > 1.2).any()
    with pytest.raises(PolicyError, match="VecNormalize"):
        imported(saved(model, tmp_path))


class Evil:
    """Makes a folder when it is unpickled."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __reduce__(self):
        return os.mkdir, (self.mark,)


def changed(path, **members):
    """Write a model again, some of its files replaced."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (files | members).items():
            archive.writestr(name, content)


@pytest.mark.parametrize("name", ["sbx.SAC", "stable_baselines3.SAC"])
def test_nothing_of_a_model_is_run_without_trust(name, tmp_path, rng):
    path, mark = saved(random_model(name, rng), tmp_path), tmp_path / "called"
    with zipfile.ZipFile(path) as archive:
        data = json.loads(archive.read("data"))
    evil = base64.b64encode(pickle.dumps(Evil(mark))).decode()
    data |= {
        key: {**entry, ":serialized:": evil}
        for key, entry in data.items()
        if isinstance(entry, dict)
    }
    changed(path, data=json.dumps(data).encode())
    with pytest.raises(PolicyError, match="add --trust"):
        imported(path, is_trusted=False)
    assert not mark.exists()


@pytest.mark.parametrize("content", [b"", b"PK", b"x" * 1000, None])
def test_a_file_that_is_no_model_is_one_message(content, tmp_path):
    path = tmp_path / "model.zip"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PolicyError, match=r"no model\.zip of Stable-Baselines3 or SBX"):
        imported(path)


def test_a_model_that_is_not_there_is_said_so(tmp_path, capsys):
    for path in (tmp_path / "missing.zip", tmp_path):
        assert run(["export", str(path)]) == 2
        error = capsys.readouterr().err
        assert f"there is no file {path}: give the model.zip that" in error
        assert "Errno" not in error


def test_export_writes_a_policy_beside_the_model(tmp_path, rng, capsys):
    path = saved(random_model("sbx.PPO", rng), tmp_path)
    words = ["export", str(path), "--peg", "round", "--clearance", "0.001"]
    assert run(words) == 2
    assert "add --trust" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["model.zip"]
    assert run([*words, "--trust"]) == 0
    assert f"dovetail evaluate {tmp_path / 'model.safetensors'}" in (
        capsys.readouterr().out
    )
    policy = Policy.load(tmp_path / "model")
    assert policy.metadata["env"]["peg"] == "round"
    make_policy_env(policy).close()
    assert run(["export", str(path)]) == 2
    assert "exists; choose another --out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--stack", "2"], "observations have shape [14], the environment's [50]"),
        (["--task", "XY:force ZABC:hold"], "actions have shape [4], the environment's"),
        (["--env", "CartPole-v1"], "dovetail/PegInHole-v0"),
        (["--peg", "hexagon"], "hexagon"),
    ],
)
def test_settings_that_do_not_fit_the_model_are_refused(
    words, message, tmp_path, rng, capsys
):
    path = saved(random_model("stable_baselines3.PPO", rng), tmp_path)
    assert run(["export", str(path), *words]) == 2
    assert message in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["model.zip"]
