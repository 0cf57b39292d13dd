"""What differs between the episodes of a training, and is not told."""

import pytest
from tests.extras import need

from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig

SEARCH = {
    "task": "XYZ:force ABC:pose",
    "doubt": 0.01,
    "doubt_turn": 0.05,
    "vary": "peg=square,triangle",
    "num_envs": 3,
}


def test_each_environment_has_the_next_value_and_the_policy_the_tasks_own():
    need("sbx")
    from dovetail.learn.algorithms import make_vec_env

    config = TrainConfig(**SEARCH)
    env = make_vec_env(config)
    cores = [require_contact_env(one) for one in env.envs]
    env.close()
    assert [core.task.peg for core in cores] == ["square", "triangle", "square"]
    assert {core.tracker.doubt for core in cores} == {0.01}
    assert {core.tracker.turn for core in cores} == {0.05}
    assert config.env_options()["peg"] == "square"
    assert config.env_options()["tracker"] == "truth"
    assert "--vary peg=square,triangle" in config.command()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"doubt": 0.0}, "doubt_turn is 0.05 rad and doubt 0 m"),
        ({"doubt_turn": 0.6}, "doubt_turn is 0.6; allowed: 0 to 0.5"),
        ({"num_envs": 1}, "2 values of peg to 1 environments"),
        ({"vary": "pig=square"}, "needed: NAME=A,B with one of peg, clearance"),
        ({"vary": "peg"}, "needed: NAME=A,B with one of peg, clearance"),
        ({"vary": "clearance=0.001,wide"}, "could not convert string to float"),
    ],
)
def test_what_cannot_be_varied_is_refused_with_what_to_give(change, words):
    with pytest.raises(ConfigError, match=words):
        TrainConfig(**{**SEARCH, **change})
