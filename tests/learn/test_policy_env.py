"""A policy's file chooses how the task was set, never where it runs."""

import math
from dataclasses import replace

import pytest

from dovetail.arms.fri_arm import FriAddress
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError, PolicyError
from dovetail.learn.policy import Policy, find_policy, list_policies
from dovetail.learn.policy_env import (
    CHOSEN,
    known_env_id,
    lax_contact,
    make_policy_env,
    policy_settings,
    require_contact_accepted,
    require_own_robot,
)
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import write_robot_text
from dovetail.tasks.options import own_options

ROBOT = "fri://127.0.0.1:30200"
CABINET = f"{ROBOT}?control=127.0.0.1:30301"


def changed(policy: Policy, section: str, **change) -> Policy:
    """Return the policy with something else in a section of its file."""
    content = policy.metadata[section] | change
    return Policy(policy.layers, policy.metadata | {section: content})


@pytest.mark.parametrize("name", list_policies())
def test_the_shipped_policies_run_where_they_were_trained_for(name):
    policy = Policy.load(find_policy(name))
    settings = policy_settings(policy.metadata)
    # Settings that an older file does not have, and one that is chosen by the arm.
    later = {"without", "also", "recall", "script", "correction", "fall_back", "cell"}
    later |= {"grasp_error", "grasp_turn", "tilt", "facing", "tare"}
    own = own_options(task_class(known_env_id(policy.metadata)))
    known = {*CHOSEN, *own}
    assert set(settings) | (later & known) == known
    # What searches is faster near contact; nothing else is laxer than usual.
    fast = {"search_square": 0.05, "insert_any": 0.05, "peg_near": 0.022}.get(name)
    said = [] if fast is None else [("near_speed", fast, 0.02, "m/s")]
    assert lax_contact(settings) == said
    env = make_policy_env(policy, twin="easy")
    for option in own.keys() & settings.keys():
        assert vars(env.unwrapped.task)[option] == settings[option]
    env.close()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("arm", ROBOT),
        ("twin", "easy"),
        ("engine", "bullet"),
        ("dynamics", {"friction": 0.0}),
        ("delay", 0.0),
        ("slack", 1.0),
        ("randomisation", {}),
        ("reward", {}),
        ("render_mode", "human"),
        ("\x1b[2Jwheels", 4),
    ],
)
def test_where_a_policy_runs_is_not_for_its_file_to_say(policy, name, value):
    with pytest.raises(PolicyError, match="not a policy's to choose") as error:
        policy_settings(changed(policy, "env", **{name: value}).metadata)
    assert "\x1b" not in str(error.value)


@pytest.mark.parametrize("name", ["plant", "robot", "tracker"])
def test_what_the_training_had_is_told_and_not_taken(policy, name):
    told = changed(policy, "env", **{name: "os:system"})
    assert name not in policy_settings(told.metadata)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("peg", ["square"]),
        ("stack", 1.5),
        ("stack", True),
        ("max_steps", 10**400),
        ("clearance", "0.001"),
        ("near_speed", math.nan),
        ("near_press", {"x": 1}),
        ("f_scale", [1.0, 2.0]),
        ("force_damping", [[1.0]]),
        ("tare", "perhaps"),
        ("task", None),
    ],
)
def test_a_setting_that_is_none_is_named(policy, name, value):
    with pytest.raises(PolicyError, match=rf"damaged: {name}(\[.*\])? (is|must be) "):
        policy_settings(changed(policy, "env", **{name: value}).metadata)


@pytest.mark.parametrize("env", [None, [], "plant"])
def test_no_settings_at_all_are_refused(policy, env):
    with pytest.raises(PolicyError, match="no section 'env'"):
        policy_settings(policy.metadata | {"env": env})


@pytest.mark.parametrize(
    ("env_id", "words"),
    [
        (
            "no_such:Env-v0",
            "imports the module 'no_such'; add --env no_such",
        ),
        ("CartPole-v1", "is unknown; known: .*dovetail/PegInHole-v0"),
        (None, "is unknown; known: .*dovetail/PegInHole-v0"),
        (["x"], "is unknown; known: .*dovetail/PegInHole-v0"),
    ],
)
def test_an_environment_that_is_not_dovetails_is_not_even_imported(
    policy, env_id, words
):
    with pytest.raises(ConfigError, match=words):
        make_policy_env(Policy(policy.layers, policy.metadata | {"env_id": env_id}))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"near_speed": 5.0}, r"near_speed 5 m/s \(default 0.02\)"),
        ({"near_press": 1.6}, r"near_press 1.6 m/s2 \(default 1.5\)"),
        ({"near_distance": 0.0}, r"near_distance 0 m \(default 0.01\)"),
        ({"scheme": "paper"}, r"scheme paper \(default qp\)"),
    ],
)
def test_laxer_contact_is_said_and_needs_a_yes_on_what_may_be_a_robot(
    policy, change, words
):
    lax = changed(policy, "env", **change)
    settings = policy_settings(lax.metadata)
    for arm in (ROBOT, "grpc://localhost:50051"):
        with pytest.raises(ConfigError, match=f"{words}.*--accept-contact"):
            require_contact_accepted(settings, arm, is_given=False)
        assert "laxer" in require_contact_accepted(settings, arm, is_given=True)
    for arm in (None, "mujoco", "twin:easy", CABINET):
        assert "laxer" in require_contact_accepted(settings, arm, is_given=False)
    with pytest.raises(ConfigError, match=words):
        make_policy_env(lax, arm=ROBOT)


def test_whether_it_may_be_a_robot_is_a_fact_and_no_text(policy, monkeypatch):
    """What cannot be disturbed may still be a simulation, and the other way round."""
    settings = policy_settings(changed(policy, "env", near_speed=5.0).metadata)
    monkeypatch.setattr(FriAddress, "can_be_disturbed", True)
    with pytest.raises(ConfigError):
        require_contact_accepted(settings, ROBOT, is_given=False)
    monkeypatch.setattr(FriAddress, "can_be_disturbed", False)
    require_contact_accepted(settings, CABINET, is_given=False)


def test_stricter_contact_needs_no_yes():
    strict = {"near_speed": 0.01, "near_press": 1.0, "near_distance": 0.02}
    assert require_contact_accepted(strict, ROBOT, is_given=False) == ""
    assert require_contact_accepted({}, ROBOT, is_given=False) == ""


@pytest.mark.parametrize(
    ("section", "part", "index", "words"),
    [
        ("observation", "zero", 1, "column obs_q2 .*zero is 0 rad"),
        ("observation", "unit", 6, "column obs_q7 .*unit is 3.05433 rad here"),
        ("observation", "unit", 10, "column obs_theta .*0.02 rad here and"),
        ("observation", "unit", 13, "column obs_vz .*unit is 0.02 m/s"),
        ("observation", "zero", 9, "column obs_z .*zero is 0.03 m"),
        ("action", "scale", 3, "axis A means 0.2 at 1 here and 1.2"),
    ],
)
def test_another_scaling_is_refused_by_its_column_or_axis(
    policy, section, part, index, words
):
    described = dict(policy.metadata[section])
    table = dict(described.get("scaling", described))
    table[part] = list(table[part])
    table[part][index] += 1.0
    described |= {"scaling": table} if section == "observation" else table
    other = Policy(policy.layers, policy.metadata | {section: described})
    with pytest.raises(PolicyError, match=words):
        make_policy_env(other)


def test_where_the_robot_is_another_one_both_are_named(policy):
    with pytest.raises(PolicyError, match=r"with the robot iiwa14, and here is fr3"):
        make_policy_env(policy, robot="fr3")


@pytest.mark.parametrize(
    ("section", "change", "words"),
    [
        ("observation", {"size": 32}, "14 numbers in the observation here and 32"),
        ("observation", {"columns": [["obs_x", "m"]]}, "column 0 .*obs_q1.*obs_x"),
        ("observation", {"scaling": {}}, "does not say what the numbers"),
        ("observation", {"columns": 3}, "does not say what the numbers"),
        ("action", {"axes": ["X"]}, "axes X Y Z A here and 'X' in"),
        ("action", {"scale": "4"}, "4 values of the action at 1 here and 1 in"),
        ("action", {"scale": "x"}, "does not say what the numbers"),
    ],
)
def test_other_columns_and_axes_are_refused(policy, section, change, words):
    with pytest.raises(PolicyError, match=words):
        make_policy_env(changed(policy, section, **change))


def test_a_file_that_does_not_say_its_scaling_is_refused(policy):
    metadata = dict(policy.metadata)
    del metadata["observation"]
    with pytest.raises(PolicyError, match="export the policy again"):
        make_policy_env(Policy(policy.layers, metadata))


def test_a_policy_does_not_choose_the_limits_of_a_robot():
    text = write_robot_text(replace(iiwa14(), name="arm"))
    with pytest.raises(ConfigError, match="describes its own robot, 'arm'"):
        require_own_robot(text, ROBOT, is_given=False)
    require_own_robot(text, ROBOT, is_given=True)
    require_own_robot("fr3", ROBOT, is_given=False)
    for simulated in (None, "twin:medium", CABINET):
        require_own_robot(text, simulated, is_given=False)
