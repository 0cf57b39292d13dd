"""Training at other control periods than the usual: it runs, and says so."""

from io import StringIO

import pytest
from rich.console import Console

from dovetail.commands.command_line import parse
from dovetail.control.period import PERIODS
from dovetail.errors import ConfigError
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.learn.config import TrainConfig
from dovetail.learn.policy import Policy
from dovetail.learn.train import train
from extras import need

from .conftest import SMALL

TINY = {"algorithm": "ppo", "rollout_steps": 15, "steps": 30, "num_envs": 1}
TINY |= {
    "batch_size": 15,
    "max_steps": 10,
    "eval_episodes": 1,
}  # what compiles quickest


@pytest.mark.parametrize("period", [0.001, 0.0025])
def test_a_training_runs_and_its_policy_says_at_which_period(period, tmp_path):
    need("sbx")
    config = TrainConfig(out=tmp_path / "run", period=period, **(SMALL | TINY))
    (result,) = train(config, Console(file=StringIO()))
    policy = Policy.load(result.policy)
    assert result.steps == 30
    assert policy.metadata["env"]["period"] == period
    assert policy.metadata["provenance"]["config"]["period"] == period
    words = policy.metadata["provenance"]["command"].split()
    assert words[words.index("--period") + 1] == f"{1e3 * period:g}ms"
    evaluation = EvaluationConfig(
        policy=str(result.policy),
        plant="mujoco",
        tries=1,
        max_steps=3,
        out=tmp_path / "evaluation",
        fixture=(0.6, 0.0, 0.1, 0.0),
    )
    found = evaluate(evaluation, Console(file=StringIO()))
    assert found.report.period == period  # of the policy, where nothing else is asked
    assert not found.report.notes
    assert len(found.outcomes[0].course.path) == round(3 * 0.05 / period)


@pytest.mark.parametrize("period", PERIODS)
def test_the_command_line_of_a_training_makes_its_settings_again(period):
    config = TrainConfig(period=period)
    words = config.command().split()[2:]
    assert parse(TrainConfig, words) == config


def test_the_period_of_an_arms_address_is_the_trainings():
    arm = "fri://127.0.0.1:1?period=1ms&control=127.0.0.1:2"
    config = TrainConfig(arm=arm)
    assert config.period == 0.001
    assert config.env_options()["period"] == 0.001
    with pytest.raises(ConfigError, match="period is 2ms and the arm's address says"):
        TrainConfig(arm=arm, period=0.002)
    with pytest.raises(ConfigError, match="FRI knows whole milliseconds"):
        TrainConfig(arm="fri://127.0.0.1:1?control=127.0.0.1:2", period=0.0025)
