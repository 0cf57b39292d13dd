"""Settings refuse what cannot be trained, and name the field."""

import shlex
from dataclasses import dataclass, fields, replace

import pytest

from dovetail.commands.command_line import parse
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import register_task
from dovetail.errors import ConfigError
from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.config import TrainConfig
from dovetail.learn.learner_config import LearnerConfig
from dovetail.learn.policy_env_config import PolicyEnvConfig
from dovetail.settings import names_in, ranges_of, values_of
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.rail_clip.task import RailClip
from dovetail.tasks.shipped import TASKS

_NUMBERS = (int, float, int | None, float | None)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("algorithm", "sarsa", "known: sac, ppo, ddpg, td3, tqc, crossq, gps"),
        ("steps", 0, "steps is 0; allowed: 1 to"),
        ("gamma", 1.0, "gamma is 1; allowed: 0 to 0.99999"),
        ("net", (), "net is"),
        ("ent_coef", "auto_zero", "ent_coef is 'auto_zero'"),
        ("ent_coef", "-1", "ent_coef is '-1'"),
        ("learning_rate", float("nan"), "learning_rate is nan"),
        ("pretrain", -1, "pretrain is -1; allowed: 0 to"),
    ],
)
def test_a_wrong_setting_is_named_with_what_is_allowed(field, value, words):
    with pytest.raises(ConfigError, match=words):
        TrainConfig(**{field: value})


@pytest.mark.parametrize("name", ["seed", "out", "period", "task_options"])
def test_a_task_with_a_field_called_as_a_setting_is_refused(name):
    odd = type("Odd", (PegInHole,), {"__annotations__": {name: str}, name: "1"})
    env_id = f"TestOdd{name}-v0".replace("_", "")
    register_task(env_id, dataclass(frozen=True, kw_only=True)(odd))
    words = rf"the fields {name} of Odd are also settings of TrainConfig: give them"
    with pytest.raises(ConfigError, match=words):
        TrainConfig(env=env_id)


def test_a_name_that_is_no_setting_is_refused_with_the_one_that_is_meant():
    with pytest.raises(ConfigError, match=r"step \(did you mean steps\?\)"):
        TrainConfig(step=5)
    with pytest.raises(ConfigError, match=r"engine, twin; known: steps"):
        TrainConfig(twin="easy", engine="bullet")  # a program's, not an option


def test_flat_names_lead_to_the_sections_and_come_back():
    config = TrainConfig(tau=0.02, max_steps=30, out="there", net=[8])
    assert config.tau == 0.02
    assert config.max_steps == 30
    assert config.net == (8,)
    assert TrainConfig(**values_of(config)) == config
    assert replace(replace(config, tau=0.01), tau=0.02) == config


def test_the_entropy_coefficient_is_a_number_or_adapted():
    for given, wanted in (("auto", "auto"), ("auto_0.1", "auto_0.1"), ("0.02", 0.02)):
        assert LearnerConfig(ent_coef=given).entropy_coefficient() == wanted


def test_resuming_with_another_setting_names_it_and_both_values():
    config = TrainConfig()
    for name, value in (("stack", 4), ("seed", 3), ("net", (64, 64))):
        other = replace(config, **{name: value})
        with pytest.raises(ConfigError, match=f"cannot resume .*: {name} is"):
            other.require_same(config)
    replace(config, resume=True, out="elsewhere").require_same(config)


def test_the_noted_command_trains_with_the_same_settings():
    config = TrainConfig(
        stack=4, net=(64, 32), layer_norm=False, task="Z:force XYC:hold", seed=2
    )
    command = shlex.split(config.command())
    assert command[:2] == ["dovetail", "train"]
    again = parse(TrainConfig, command[2:])
    assert again.to_json() == config.to_json()


def test_task_and_clearance_are_the_environments_own():
    peg, clip = TrainConfig(), TrainConfig(env="dovetail/RailClip-v0")
    gear = TrainConfig(env="dovetail/GearMesh-v0")
    for config, task, clearance in (
        (peg, "XYZ:force A:pose BC:hold", 0.0005),
        (gear, "XYZ:force A:pose BC:hold", 0.0002),
        (clip, "XY:force A:pose ZBC:hold", None),
    ):
        for settings in (config.to_json(), config.env_options()):
            assert settings["task"] == task
            assert settings.get("clearance") == clearance
    assert clip.command() == "dovetail train --env dovetail/RailClip-v0"
    assert replace(peg, env=clip.env) == clip
    other = replace(gear, task_options={"clearance": 0.0003})
    assert other.env_options()["clearance"] == 0.0003


@pytest.mark.parametrize("name", ["dovetail/Nut-v0", "CartPole-v1", "peg"])
def test_an_unknown_environment_lists_the_known_ones(name):
    known = ", ".join(TASKS)
    with pytest.raises(ConfigError, match=f"'{name}' is unknown.*; known: {known}"):
        TrainConfig(env=name)


def test_every_environment_setting_is_a_keyword_of_the_environment():
    usual = values_of(EnvConfig()) | {"task": PegInHole.axes}
    given = TrainConfig().env_options()
    assert set(given) - {"peg", "clearance", "tilt", "facing"} <= set(usual)
    for name in set(given) & set(usual) - {"tare"}:
        assert given[name] in (usual[name], (usual[name],)), name  # one for X Y Z


def test_the_learning_rate_falls_in_the_second_half_only():
    from dovetail.learn.algorithms import falling_rate

    assert falling_rate(3e-4, 0.1, 1.0) == 3e-4
    assert falling_rate(3e-4, 0.1, 0.5) == 3e-4
    assert falling_rate(3e-4, 0.1, 0.25) == pytest.approx(0.55 * 3e-4)
    assert falling_rate(3e-4, 0.1, 0.0) == pytest.approx(3e-5)


@pytest.mark.parametrize(("tare", "word"), [(True, "--tare"), (False, "--no-tare")])
def test_a_policy_says_of_its_tare_what_was_asked_for(tare, word):
    assert "tare" not in TrainConfig().env_options()
    asked = TrainConfig(tare=tare)
    assert asked.env_options()["tare"] is tare
    assert word in asked.command()


@pytest.mark.parametrize(
    "settings", [{"force_damping": (0.0,)}, {"task": "XYZ:pose A:pose BC:hold"}]
)
def test_a_policy_cannot_want_a_tare_that_its_task_cannot_give(settings):
    with pytest.raises(ConfigError, match="--no-tare"):
        TrainConfig(**settings, tare=True)
    assert TrainConfig(**settings).tare is None


def test_an_approach_without_an_arm_is_refused():
    with pytest.raises(ConfigError, match="approach"):
        TrainConfig(approach=True)


@pytest.mark.parametrize(
    "change", [{}, {"algorithm": "ppo"}, {"from_policy": "peg_square"}]
)
def test_the_command_says_only_what_was_asked_for(change):
    words = TrainConfig(**change, steps=500).command().split()
    assert len(words) == 4 + 2 * len(change)
    assert "--steps" in words


def test_every_number_of_a_training_has_a_range_with_its_unit():
    """Written beside the field; those of the environment are the environment's."""
    others = {*names_in(PolicyEnvConfig), "random_gravity"}
    own = {f.name: f.type for f in fields(TrainConfig) if f.name not in others}
    assert [name for name in own if own[name] in _NUMBERS] == []
    assert len(own.keys() & ranges_of(TrainConfig).keys()) == 31
    with pytest.raises(ConfigError, match=r"doubt is 0.06 m; allowed: 0 to 0.05 m"):
        TrainConfig(doubt=0.06)
    with pytest.raises(ConfigError, match=r"steps is 1.5; give a whole number: 1 to"):
        TrainConfig(steps=1.5)


def test_a_fixed_goal_is_where_the_tasks_policies_are_tried_first():
    for task in (PegInHole, RailClip):
        env = f"dovetail/{task.__name__}-v0"
        usual = task.trial_poses[0]
        place = TrainConfig(env=env, fixed_goal=True).fixed_place
        assert place is not None
        assert place[1:] == usual[1:]
    assert TrainConfig().fixed_place is None
    given = TrainConfig(fixed_goal=True, fixture=(0.6, 0.0, 0.1, 0.0))
    assert given.fixture == (0.6, 0.0, 0.1, 0.0)


def test_a_fixed_goal_that_is_left_out_can_be_trained_for():
    """It was a place of the peg's cell: the rail clip's walls refused it."""
    config = TrainConfig(env="dovetail/RailClip-v0", fixed_goal=True, num_envs=1)
    envs = make_vec_env(config)
    envs.reset()
    envs.close()
