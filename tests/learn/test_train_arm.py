"""Training directly on one arm that an address names."""

import shlex
from dataclasses import replace

import numpy as np
import pytest

from dovetail.arms.local_arm import LocalArm
from dovetail.cli import run
from dovetail.commands.command_line import parse
from dovetail.errors import ArmError, ConfigError
from dovetail.learn.checkpoint import list_checkpoints
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import read_settings
from dovetail.learn.progress import read_progress
from dovetail.learn.train import train
from dovetail.poses import quat_about_z

FRI = "fri://127.0.0.1:30200"


@pytest.fixture
def on_arm(small):
    """Settings of a training on a twin that plays the one arm."""
    return replace(small, arm="twin:easy", steps=100, fixed_goal=True)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"arm": "gazebo"}, "known addresses: mujoco, bullet, drake"),
        ({"arm": FRI}, "cannot move the fixture: add --fixed-goal"),
        ({"arm": f"{FRI}?speed=1"}, "unknown keys: speed"),
        ({"arm": FRI, "fixed_goal": True, "seeds": 2}, "there is one arm"),
        ({"arm": FRI, "fixed_goal": True, "force_weight": 0.1}, "needs 0"),
        ({"arm": FRI, "fixed_goal": True}, "say where it is with --fixture X Y Z YAW"),
        ({"fixture": (0.6, 0.01, 0.1, 0.0)}, "needs --fixed-goal"),
    ],
)
def test_what_the_arm_cannot_do_is_refused(settings, message):
    with pytest.raises(ConfigError) as error:
        TrainConfig(**settings)
    assert message in str(error.value)


def test_an_arm_is_one_environment_whatever_was_asked():
    assert TrainConfig(arm="twin:easy", num_envs=8).num_envs == 1


def test_the_noted_command_trains_on_the_same_arm():
    config = TrainConfig(
        arm=FRI,
        fixed_goal=True,
        fixture=(0.6, -0.02, 0.1, 0.1),
        from_policy="peg_square",
    )
    command = config.command()
    assert "--from-policy peg_square" in command
    again = parse(TrainConfig, shlex.split(command)[2:])
    assert again.to_json() == config.to_json()


def test_every_episode_has_the_hole_where_it_was_said_to_be(on_arm, monkeypatch):
    holes = []

    def remember(self, q, hole):
        holes.append(hole)
        return reset(self, q, hole)

    reset = LocalArm.reset
    monkeypatch.setattr(LocalArm, "reset", remember)
    (result,) = train(replace(on_arm, fixture=(0.6, -0.02, 0.11, 0.1)))
    assert len(holes) > 4 + result.evaluation["episodes"]
    for hole in holes:
        np.testing.assert_array_equal(hole.position, [0.6, -0.02, 0.11])
        np.testing.assert_allclose(hole.quat_wxyz, quat_about_z(0.1))
    settings = read_settings(on_arm.out)
    assert settings["arm"] == "twin:easy"
    assert settings["num_envs"] == 1


def test_the_arm_is_connected_once_and_not_for_a_folder_that_is_taken(
    on_arm, monkeypatch
):
    built = []
    make = LocalArm.__init__

    def count(self, *arguments, **settings):
        built.append(1)
        make(self, *arguments, **settings)

    monkeypatch.setattr(LocalArm, "__init__", count)
    train(replace(on_arm, tare=False))
    assert len(built) == 1
    with pytest.raises(ConfigError, match="already holds a run"):
        train(replace(on_arm, tare=False))
    assert len(built) == 1


def test_an_arm_that_stops_loses_no_step_and_the_run_resumes(on_arm, monkeypatch):
    step = LocalArm.step
    taken = []

    def stop_once(self, target, duration=0.05):
        taken.append(1)
        if len(taken) == 64:
            raise ArmError("the enabling switch was released")
        return step(self, target, duration)

    monkeypatch.setattr(LocalArm, "step", stop_once)
    config = replace(on_arm, checkpoint_interval=1000, tare=False)
    with pytest.raises(ArmError, match="enabling switch"):
        train(config)
    (saved,) = list_checkpoints(config.out / "checkpoints")
    assert saved.stem == "step-0000000063"
    (result,) = train(replace(config, resume=True))
    assert result.steps == 100
    assert [row.length for row in read_progress(config.out / "progress.csv")][:2] == [
        25,
        25,
    ]


def test_force_that_is_not_measured_is_null_not_zero(on_arm, monkeypatch):
    step = LocalArm.step

    def feel_nothing(self, target, duration=0.05):
        state = step(self, target, duration)
        return state._replace(contact_force=np.full(3, np.nan))

    monkeypatch.setattr(LocalArm, "step", feel_nothing)
    (result,) = train(on_arm)
    assert result.evaluation["contact_force_peak_N"]["max"] is None
    for row in read_progress(on_arm.out / "progress.csv"):
        assert np.isnan(row.contact_force_max)
        assert np.isfinite(row.reward)


def test_the_command_says_on_what_it_trained(tmp_path, capsys):
    words = ["train", "--arm", "twin:easy", "--fixed-goal", "--steps", "30"]
    words += ["--max-steps", "10", "--eval-episodes", "1", "--learning-starts", "20"]
    words += ["--fixture", "0.6", "-0.01", "0.1", "0.0", "--from-policy", "peg_square"]
    assert run([*words, "--out", str(tmp_path / "run")]) == 0
    assert "inserted on twin:easy" in capsys.readouterr().out
