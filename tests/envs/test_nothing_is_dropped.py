"""What is given explicitly is obeyed or refused, never dropped without a word."""

import pytest

from dovetail.envs.registered import make_env
from dovetail.errors import ConfigError
from dovetail.evaluation.config import EvaluationConfig, environment_options
from dovetail.plants.plant import DynamicsConfig
from dovetail.settings import values_of
from dovetail.tasks.peg_in_hole.task import PegInHole

from .fake_arm import FakeArm

POLICY = {"env_id": "dovetail/PegInHole-v0", "env": {}}


@pytest.mark.parametrize(
    "given",
    [
        {"period": 0.001},
        {"scheme": "paper"},
        {"near_speed": 0.05},
        {"near_press": 1.0},
        {"force_damping": 30.0},
        {"force_damping": (40.0, 40.0, 30.0)},
        {"payload_error": 0.9},
        {"plant": "bullet"},
        {"dynamics": DynamicsConfig()},
    ],
)
def test_an_arm_that_is_built_is_not_changed_by_settings(given):
    (name,) = given
    with pytest.raises(ConfigError, match=name):
        make_env(PegInHole, FakeArm(), **given)


def test_settings_that_are_the_arms_own_are_taken():
    arm = FakeArm(period=0.001)
    speed = values_of(arm.facts.limits)["near_speed"]
    damping = tuple(arm.facts.osc.force_damping[:3])
    settings = {"period": 0.001, "near_speed": speed, "force_damping": damping}
    make_env(PegInHole, arm, **settings).close()


@pytest.mark.parametrize("place", [{"arm": "mujoco"}, {"twin": "easy"}])
def test_the_plain_plants_engine_is_not_given_beside_another_arm(place):
    with pytest.raises(ConfigError, match="plant is 'bullet'"):
        make_env(PegInHole, plant="bullet", **place)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"approach": True}, "approach"),
        ({"tracker": "late", "fixture_shift": 0.01}, "tracker late"),
    ],
)
def test_an_evaluation_refuses_what_another_option_would_override(given, named):
    config = EvaluationConfig(policy="peg_square", plant="mujoco", **given)
    with pytest.raises(ConfigError, match=named):
        environment_options(config, POLICY)
