"""What is declared of an arm reaches its limits; beyond the table it is warned of."""

import warnings

import gymnasium as gym
import pytest

from dovetail.arms.fri_arm import FriAddress
from dovetail.control.proven import DECLARED
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_arm, make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, UnprovenWarning

ID = "dovetail/PegInHole-v0"
TASK = TaskSpec.parse("XYZ:force A:pose BC:hold")
ROBOT = "fri://0.0.0.0?period=1ms"
BEYOND = {"delay": 0.012, "mass_error": 0.3, "payload_error": 2.0}


@pytest.mark.parametrize("place", [{"twin": "medium"}, {"arm": "twin:medium"}, {}])
def test_what_is_declared_reaches_the_arm_that_runs(place):
    with pytest.warns(UnprovenWarning) as said:
        env = gym.make(ID, **place, **BEYOND)
    limits = env.unwrapped.arm.facts.limits
    env.close()
    assert limits.declared_errors() == BEYOND
    assert limits.delta_q == pytest.approx(0.095)  # twice the table's share
    delay, mass, payload = (str(one.message) for one in said)
    assert "the loop's delay is 12 ms" in delay
    assert "shown to hold: 0 to 10 ms; shorten it" in delay
    assert "mass is 30 %, for which the limits are unproven" in mass
    assert "payload's error is 2 kg" in payload


def test_nothing_is_said_of_the_table_and_of_less():
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnprovenWarning)
        for given in ({}, {"delay": 0.003}, DECLARED):
            env = gym.make(ID, **given)
            declared = env.unwrapped.arm.facts.limits.declared_errors()
            env.close()
            assert declared == DECLARED | given


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"delay": 0.06}, r"delay is 0.06 s; allowed: 0 to 0.05 s"),
        ({"mass_error": -0.1}, "mass_error is -0.1; allowed: 0 to 0.5"),
        ({"payload_error": 9.0}, "payload_error is 9 kg; allowed: 0 to 5 kg"),
    ],
)
def test_what_no_arm_has_is_refused(given, message):
    with pytest.raises(ConfigError, match=message):
        gym.make(ID, **given)


def test_errors_of_an_arm_that_is_its_model_are_refused():
    cell = find_cell()
    exact = make_settings(cell, EnvConfig(), is_hardware=False)[1]
    assert exact.declared_errors() == dict.fromkeys(DECLARED, 0.0)
    with pytest.raises(ConfigError, match=r"margins=model.*\(delay 0.003, mass_.*two"):
        make_settings(cell, EnvConfig(delay=0.003), is_hardware=False)


@pytest.mark.parametrize(
    ("keys", "is_warned"),
    [("", False), ("&margins=model", True), ("&margins=model&control=a:1", False)],
)
def test_margins_of_an_exact_arm_are_warned_of_on_what_may_be_a_robot(
    monkeypatch, keys, is_warned
):
    monkeypatch.setattr(FriAddress, "build", lambda *_: None)
    cell = find_cell()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        build_arm(ROBOT + keys, cell, TASK)
    said = [str(w.message) for w in said if w.category is UnprovenWarning]
    assert len(said) == is_warned
    if is_warned:
        assert f"arm '{ROBOT}&margins=model' has margins=model" in said[0]
        assert "unproven with them" in said[0]
        assert "leave margins out, or use them with a simulated arm" in said[0]
