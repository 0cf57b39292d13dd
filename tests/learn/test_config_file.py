"""A training's settings in a TOML file: recipes, files of one's own, runs."""

import tomllib

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.commands.command_line import find_task, parse
from dovetail.commands.train import Train, given_before
from dovetail.envs.registered import make
from dovetail.errors import ConfigError
from dovetail.learn.config import NOT_COMPARED, TrainConfig
from dovetail.learn.config_file import (
    find_recipe,
    list_recipes,
    load_config,
    read_settings,
    to_toml,
)
from dovetail.options import option_words
from dovetail.settings import values_of
from dovetail.tasks.connector.task import Connector

CHANGED = {
    "steps": 1234,
    "f_scale": (1.0, 2.0, 3.0),
    "period": 0.002,
    "also": ("tilt",),
    "recall": (4, 8),
    "tare": False,
    "net": (32, 32),
    "task_options": {"peg": "triangle", "clearance": 0.001},
}


def read(words):
    """Return the settings of a command line."""
    before = given_before(words)
    return parse(Train, words, find_task(words, before.get("env")), before=before)


def test_a_runs_file_gives_its_settings_back(tmp_path):
    config = TrainConfig(**CHANGED)
    file = tmp_path / "config.toml"
    file.write_text(to_toml(config))
    again = load_config(file)
    left_out = {"task_options", "task", *NOT_COMPARED}
    assert {n: v for n, v in values_of(again).items() if n not in left_out} == {
        n: v for n, v in values_of(config).items() if n not in left_out
    }
    assert again.env_options() == config.env_options()
    assert load_config(tmp_path, steps=5).steps == 5  # the run's folder, changed


def test_a_key_is_the_name_of_the_setting_or_of_the_tasks_option(tmp_path):
    table = tomllib.loads(to_toml(TrainConfig(**CHANGED)))
    assert table["peg"] == "triangle"
    assert table["steps"] == 1234
    assert table["f_scale"] == [1.0, 2.0, 3.0]


def test_a_recipes_teacher_is_left_out_where_a_run_starts_from_a_policy():
    assert read(["--recipe", "insert_any"]).has_teacher
    found = read(["--recipe", "insert_any", "--from-policy", "insert_any"])
    assert not found.has_teacher
    assert found.doubt == 0.003


@pytest.mark.parametrize("name", list_recipes())
def test_a_recipe_is_a_training(name):
    table = tomllib.loads(find_recipe(name).read_text())
    found = read(["--recipe", name])
    options = found.env_options()
    for key, value in table.items():
        got = values_of(found).get(key, options.get(key))
        assert np.atleast_1d(got).tolist() == np.atleast_1d(value).tolist(), key


def test_what_is_said_later_goes_before(tmp_path):
    mine = tmp_path / "mine.toml"
    mine.write_text("steps = 77\nnum_envs = 2\npeg = 'round'\n")
    found = read(["--recipe", "search", "--config", str(mine)])
    assert (found.steps, found.num_envs, found.teacher) == (77, 2, "corner")
    assert found.env_options()["peg"] == "round"
    assert given_before(["--steps", "5"]) == {}


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("stps = 3", "stps"),
        ("steps = 'many'", "steps"),
        ("steps = 1.5", "steps"),
        ("doubt = 6.0", "doubt"),
        ("also = 'tilt'", "also"),
        ("near_speed = '20 mm/s'", "near_speed"),
        ("resume = true", "resume"),
        ("out = 'elsewhere'", "out"),
        ("threads = 7", "threads"),
        ("tare = 'no'", "tare"),
        ("approach = 'no'", "approach"),
        ("layer_norm = 1", "layer_norm"),
        ("period = '0.005'", "period"),
        ("net = ['64']", "net"),
        ("f_scale = [true]", "f_scale"),
        ("random_mass = ['1', '2']", "random_mass"),
        ("peg = 1", "peg"),
        ("algorithm = 'dqn'", "algorithm"),
    ],
)
def test_a_wrong_key_or_value_is_named(tmp_path, text, name):
    file = tmp_path / "run.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(file)
    assert caught.value.name == name
    assert str(file) in str(caught.value)
    with pytest.raises(ConfigError) as caught:
        given_before(["--config", str(file)])
    assert str(file) in str(caught.value)


def test_settings_that_exclude_each_other_are_refused(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text("fixture = [0.6, 0.0, 0.1, 0.0]")
    with pytest.raises(ConfigError, match="fixed"):
        load_config(file)


def test_a_file_chooses_no_module_and_no_arm_outside(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text("env = 'somebody:Task-v0'")
    with pytest.raises(ConfigError, match="DOVETAIL_TRUST"):
        read_settings(file)
    file.write_text("arm = 'fri://0.0.0.0:30200'")
    with pytest.raises(ConfigError, match="--arm"):
        read_settings(file)
    assert read_settings(file, "fri://0.0.0.0:30200")["arm"].startswith("fri://")


def test_a_model_is_found_beside_the_file(tmp_path):
    (tmp_path / "model.toml").write_text("")
    file = tmp_path / "run.toml"
    file.write_text("model = 'model.toml'")
    assert read_settings(file)["model"] == tmp_path / "model.toml"


@pytest.mark.parametrize("name", ["seek", "no/such.toml"])
def test_an_unknown_recipe_is_refused_with_those_there_are(name):
    with pytest.raises(ConfigError) as caught:
        find_recipe(name)
    assert set(caught.value.allowed) == set(list_recipes())


PLACE = ("--fixed-goal", "--fixture", "0.6", "0", "0.1", "0")
CLIP = "dovetail/RailClip-v0"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("steps = 500", ["--arm", "mujoco"]),
        ("steps = 500", ["--arm", "fri://127.0.0.1:30299", *PLACE]),
        ("algorithm = 'ppo'", ["--algorithm", "sac"]),
        ("demos = ['logs']", ["--from-policy", "peg_near"]),
        ("fixed_goal = true", ["--env", CLIP]),
        ("fixture = [0.6, 0.0, 0.1, 0.0]", ["--fixed-goal"]),
        ("arm = 'grpc://127.0.0.1:50999'", ["--arm", "mujoco"]),
        ("random_gravity = 0.4", ["--randomise-dynamics"]),
    ],
)
def test_a_file_and_options_are_as_if_all_were_options(tmp_path, text, words):
    """What follows from other settings is chosen once, from all of them."""
    file = tmp_path / "run.toml"
    file.write_text(text)
    found = values_of(read(["--config", str(file), *words]))
    (name, value), *_ = tomllib.loads(text).items()
    typed = words if f"--{name}" in words else [*option_words(name, value), *words]
    wanted = values_of(read(typed))
    del found["config"], wanted["config"]
    assert found == wanted


@pytest.mark.parametrize("option", ["--config", "--recipe"])
def test_a_run_that_is_resumed_has_its_own_settings(tmp_path, option, capsys):
    assert run(["train", "--resume", "--out", str(tmp_path), option, "search"]) == 2
    assert "--resume" in capsys.readouterr().err


def test_a_task_has_settings_of_its_own_and_what_is_given_goes_before_them(tmp_path):
    words = ["--env", "dovetail/Connector-v0"]
    own = Connector.training
    assert given_before(words) == dict(own)
    file = tmp_path / "own.toml"
    file.write_text('env = "dovetail/Connector-v0"\nsteps = 7\n')
    given = given_before(["--config", str(file)])
    assert given["steps"] == 7
    assert given["recall"] == own["recall"]
    env = make("dovetail/Connector-v0").unwrapped
    assert env.config.recall == own["recall"]
    assert make("dovetail/Connector-v0", recall=()).unwrapped.config.recall == ()
