"""A policy's pair of files: whole, matching, and understood with NumPy alone."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dovetail.errors import PolicyError
from dovetail.learn.policy import Policy, policy_files


@pytest.fixture
def files(policy: Policy, tmp_path: Path) -> tuple[Path, Path]:
    policy.save(tmp_path / "peg.v2")
    return policy_files(tmp_path / "peg.v2")


def test_a_saved_policy_acts_the_same_by_any_of_its_names(policy, files, rng):
    weights, sidecar = files
    observation = rng.normal(size=14)
    for name in (weights, sidecar, str(weights).removesuffix(".safetensors")):
        again = Policy.load(name)
        np.testing.assert_array_equal(again(observation), policy(observation))
        assert again.metadata == policy.metadata


def test_actions_stay_in_range_even_for_huge_weights(policy, rng):
    loud = [(1e3 * weight, bias) for weight, bias in policy.layers]
    for output in ("tanh", "clip"):
        network = policy.metadata["network"] | {"output": output}
        action = Policy(loud, policy.metadata | {"network": network})(
            rng.normal(size=14)
        )
        assert np.abs(action).max() <= 1.0
        assert action.dtype == np.float32


def test_a_file_cut_short_anywhere_is_refused(files):
    weights, sidecar = files
    for path in files:
        content = path.read_bytes()
        for size in (0, 1, len(content) // 2, len(content) - 2):
            path.write_bytes(content[:size])
            with pytest.raises(PolicyError, match=r"cut short|no JSON"):
                Policy.load(weights)
        path.write_bytes(content)
    Policy.load(sidecar)


def test_weights_of_another_policy_are_refused(policy, files, tmp_path):
    policy.layers[0][0][0, 0] += 1.0
    policy.save(tmp_path / "other")
    (tmp_path / "other.safetensors").replace(files[0])
    with pytest.raises(PolicyError, match="not the partner"):
        Policy.load(files[0])


@pytest.mark.parametrize("missing", [0, 1])
def test_a_missing_half_is_named(files, missing):
    files[missing].unlink()
    with pytest.raises(PolicyError, match=f"cannot read .*{files[missing].name}"):
        Policy.load(files[1 - missing])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "zip"}, "does not describe a policy"),
        ({"version": 99}, "format version 99, this release reads 1"),
        ({"network": None}, "no section 'network'"),
    ],
)
def test_a_sidecar_of_something_else_is_refused(files, change, words):
    weights, sidecar = files
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | change))
    with pytest.raises(PolicyError, match=words):
        Policy.load(weights)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"layers": [[14, 8], [8, 3]]}, "JSON file says"),
        ({"activation": "selu"}, "known: relu, tanh"),
        ({"output": "none"}, "known: tanh, clip"),
    ],
)
def test_weights_that_do_not_fit_the_description_are_refused(policy, change, words):
    network = policy.metadata["network"] | change
    with pytest.raises(PolicyError, match=words):
        Policy(policy.layers, policy.metadata | {"network": network})


def test_weights_that_are_not_finite_are_refused(policy):
    policy.layers[1][1][2] = np.nan
    with pytest.raises(PolicyError, match="layer 1 holds a number that is not finite"):
        Policy(policy.layers, policy.metadata)


def test_an_observation_of_another_size_names_both_sizes(policy):
    with pytest.raises(PolicyError, match=r"\(86,\).*\(14,\).*stack = 0.*export"):
        policy(np.zeros(86))


def test_an_observation_that_is_not_finite_names_the_element(policy):
    observation = np.zeros(14)
    observation[9] = np.inf
    with pytest.raises(PolicyError, match=r"observation\[9\] is inf"):
        policy(observation)


def test_an_environment_of_another_task_is_refused(policy):
    env_id, env = policy.metadata["env_id"], policy.metadata["env"]
    policy.require_env(
        env_id, env | {"peg": "round", "task": "A:pose XYZ:force CB:hold"}
    )
    with pytest.raises(PolicyError, match="trained for the task"):
        policy.require_env(env_id, env | {"task": "Z:force XY:hold ABC:hold"})
    with pytest.raises(PolicyError, match="trained for the stack 0, not for 4"):
        policy.require_env(env_id, env | {"stack": 4})
    with pytest.raises(PolicyError, match="trained for the environment"):
        policy.require_env("dovetail/RailClip-v0", env)


def test_running_a_policy_needs_neither_jax_nor_torch(files):
    code = (
        "import sys, numpy; from dovetail.learn.policy import Policy;"
        f"Policy.load({str(files[0])!r})(numpy.zeros(14));"
        "heavy = {'jax', 'torch', 'sbx', 'stable_baselines3'} & set(sys.modules);"
        "sys.exit(', '.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("content", ["[" * 100_000, '{"format": NaN}', "1" * 5000])
def test_json_that_is_no_policy_is_one_message(files, content):
    weights, sidecar = files
    sidecar.write_text(content)
    with pytest.raises(PolicyError, match="no JSON"):
        Policy.load(weights)
