"""Training on an identified model: the file's dynamics, in the engine that is asked."""

import hashlib
import shlex
from dataclasses import replace

import numpy as np
import pytest

from dovetail.commands.command_line import parse
from dovetail.envs.dynamics_randomisation import RandomDynamics
from dovetail.errors import ConfigError
from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.assess import assess
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Policy
from dovetail.learn.train import train
from dovetail.plants.twin import load_twin
from extras import need

from .conftest import SMALL


def write_model(path):
    """Write a model file as identification does: the medium twin without its noise."""
    twin = replace(
        load_twin("medium"),
        description="identified",
        torque_noise=0.0,
        position_noise=0.0,
        velocity_noise=0.0,
    )
    path.write_text(twin.to_toml())
    return path


@pytest.fixture
def model(tmp_path):
    return write_model(tmp_path / "model.toml")


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A training on a model with random dynamics, and what it was tried in."""
    folder = tmp_path_factory.mktemp("trained")
    model = write_model(folder / "model.toml")
    config = TrainConfig(
        out=folder / "run", model=model, randomise_dynamics=True, **SMALL
    )
    tried = []

    def watched(policy, episodes, stage):
        tried.append(stage.envs[0])
        return assess(policy, episodes, stage)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dovetail.learn.one_run.assess", watched)
        (result,) = train(config)
    return Policy.load(result.policy), result, tried[0], model


def core(config):
    return make_vec_env(config).envs[0].unwrapped


@pytest.mark.parametrize(
    "plant", ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet)]
)
def test_the_model_is_simulated_in_the_plant_that_is_asked(small, model, plant):
    if plant == "bullet":
        need("pybullet")
    env = core(replace(small, model=model, plant=plant))
    assert type(env.arm.plant).__name__.lower() == f"{plant}plant"
    assert env.arm.plant.dynamics == load_twin(model).dynamics()
    env.close()


def test_the_models_command_delay_is_simulated(small, model):
    late = model.with_name("late.toml")
    late.write_text(replace(load_twin(model), command_delay=0.05).to_toml())
    ends = []
    for path in (model, late):
        env = core(replace(small, model=path, tare=False))  # late: it swings
        env.reset(seed=1)
        for _ in range(5):
            info = env.step(np.array([1.0, 0.0, 0.0, 0.0]))[4]
        ends.append(info["observation_raw"])
        env.close()
    assert np.abs(ends[0] - ends[1]).max() > 1e-3


def test_a_policy_carries_its_model_beside_the_environment_not_in_it(trained):
    policy, _, _, model = trained
    assert not {"model", "twin", "engine"} & set(policy.metadata["env"])
    said = policy.metadata["provenance"]["model"]
    assert said["sha256"] == hashlib.sha256(model.read_bytes()).hexdigest()
    assert said["file"] == "model.toml"
    assert said["table"] == policy.metadata["provenance"]["config"]["model"]
    assert said["table"]["mass_scale"] == list(load_twin(model).mass_scale)
    assert f"--model {model}" in policy.metadata["provenance"]["command"]


def test_the_evaluation_at_the_end_is_in_the_model(trained):
    _, result, env, model = trained
    assert result.evaluation["episodes"] == SMALL["eval_episodes"]
    twin = env.unwrapped.arm.plant
    assert twin.command_delay == load_twin(model).command_delay


def test_a_training_with_random_dynamics_leaves_a_policy_that_says_so(trained):
    policy, result, _, _ = trained
    config = policy.metadata["provenance"]["config"]
    assert config["randomise_dynamics"] is True
    assert config["random_mass"] == [0.8, 1.2]
    assert result.steps == SMALL["steps"]


def test_resuming_compares_the_models_content_and_names_the_key(small, model):
    config = replace(small, model=model)
    moved = model.with_name("moved.toml")
    moved.write_text("# the same\n" + model.read_text())
    replace(config, model=moved).require_same(config)
    other = model.with_name("other.toml")
    other.write_text(replace(load_twin(model), command_delay=0.01).to_toml())
    with pytest.raises(ConfigError, match=r"model.command_delay is 0.01, .* 0.005"):
        replace(config, model=other).require_same(config)
    with pytest.raises(ConfigError, match=r"model.description is None"):
        replace(config, model=None).require_same(config)
    with pytest.raises(ConfigError, match=r"model.description is 'identified'"):
        config.require_same(small)


def test_a_file_that_changes_later_does_not_change_the_run(small, model):
    config = replace(small, model=model)
    before, dynamics = config.to_json(), load_twin(model).dynamics()
    model.unlink()
    assert config.to_json() == before
    assert core(config).arm.plant.dynamics == dynamics


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.toml", None, "no model file .*none.toml; give the .toml file that"),
        ("model.json", "{}", "no model file .*model.json"),
        ("broken.toml", "engine = ", "broken.toml is not TOML"),
        (
            "short.toml",
            "seed = 1",
            "short.toml: unknown keys: none; missing keys: desc",
        ),
    ],
)
def test_a_model_that_cannot_be_read_is_refused(tmp_path, name, content, words):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(ConfigError, match=words):
        TrainConfig(model=path)


def test_a_model_with_a_value_out_of_range_is_refused_by_key(model):
    model.write_text(
        model.read_text().replace("command_delay = 0.005", "command_delay = 9.0")
    )
    with pytest.raises(ConfigError, match=r"command_delay is 9 s; allowed: 0 to 0.1"):
        TrainConfig(model=model)


def test_an_arm_has_its_own_dynamics(model):
    with pytest.raises(ConfigError, match="arm and model exclude each other"):
        TrainConfig(arm="twin:medium", model=model)
    with pytest.raises(ConfigError, match="arm and randomise_dynamics exclude"):
        TrainConfig(arm="mujoco", randomise_dynamics=True)


def test_the_noted_command_names_model_and_ranges(model):
    config = TrainConfig(
        model=model, randomise_dynamics=True, random_mass=(0.9, 1.3), random_gravity=1.0
    )
    again = parse(TrainConfig, shlex.split(config.command())[2:])
    assert again == config


def test_random_dynamics_are_drawn_about_the_model(small, model):
    config = replace(small, model=model, randomise_dynamics=True)
    env = make_vec_env(config).envs[0]
    while not isinstance(env, RandomDynamics):
        env = env.env
    assert env.base == load_twin(model).dynamics()
    env.close()


def test_ranges_without_the_switch_are_refused():
    with pytest.raises(ConfigError, match="which needs --randomise-dynamics"):
        TrainConfig(random_gravity=1.0)
    with pytest.raises(ConfigError, match="random mass is 2 to 1"):
        TrainConfig(randomise_dynamics=True, random_mass=(2.0, 1.0))
