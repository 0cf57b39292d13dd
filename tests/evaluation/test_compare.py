"""Policies compared on the same tries, with policies written by hand."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from dovetail.envs.registered import make
from dovetail.errors import ConfigError
from dovetail.evaluation.compare import ComparisonConfig, compare
from dovetail.learn.policy import Policy
from dovetail.learn.spaces import describe_spaces


def write(policy_file, path, *, scale=1.0, **env):
    """Write the scripted policy with its actions scaled, or for another task."""
    told = Policy.load(policy_file)
    layers = [(told.layers[0]), tuple(scale * part for part in told.layers[1])]
    metadata = dict(told.metadata)
    if env:
        settings = metadata["env"] | env
        made = make(metadata["env_id"], **settings)
        metadata |= describe_spaces(made) | {"env": settings}
        made.close()
    return str(Policy(layers, metadata).save(path))


@pytest.fixture(scope="module")
def still(policy_file, tmp_path_factory):
    """A policy that never moves."""
    path = tmp_path_factory.mktemp("still") / "still"
    return write(policy_file, path, scale=0.0)


@pytest.fixture
def config(policy_file, still, tmp_path):
    policies = (still, str(policy_file))
    return ComparisonConfig(
        policies=policies, twin="easy", tries=30, out=tmp_path / "out"
    )


def silent():
    return Console(file=StringIO())


def test_the_better_policy_is_named_with_few_tries(config):
    text = StringIO()
    found = compare(config, Console(file=text, width=140))
    (result,) = found.results
    assert result.verdict == "second"
    assert result.pairs.tries <= 10
    assert result.interval.high < 0
    assert [row.tries for row in found.rows] == [result.pairs.tries] * 2
    assert "scripted succeeds more often than still" in text.getvalue()


def test_files_hold_every_try_and_the_answer(config):
    found = compare(config, silent())
    assert {path.name for path in found.files} == {
        "difference.png",
        "compare.json",
        "compare.html",
    }
    told = json.loads((found.folder / "compare.json").read_text())
    assert [pair["verdict"] for pair in told["pairs"]] == ["second"]
    starts = [[t["seed"] for t in tries] for tries in told["tries"].values()]
    assert starts[0] == starts[1]


def test_poses_take_turns_and_tries_are_those_of_evaluate(config):
    found = compare(replace(config, policies=config.policies[::-1], tries=7), silent())
    told = json.loads((found.folder / "compare.json").read_text())
    poses = [t["pose"] for t in told["tries"]["still"]]
    assert poses == [0, 1, 2, 0, 1, 2, 0][: len(poses)]


def test_equal_policies_stay_undecided(config, policy_file, tmp_path):
    twin = write(policy_file, tmp_path / "copy")
    policies = (str(policy_file), twin)
    found = compare(replace(config, policies=policies, tries=12), silent())
    (result,) = found.results
    assert result.verdict == "no answer"
    assert result.pairs.first == result.pairs.second == 0


def test_of_three_the_clear_one_stops_first(config, policy_file, tmp_path):
    copy = write(policy_file, tmp_path / "copy")
    found = compare(replace(config, policies=(*config.policies, copy)), silent())
    tries = {row.label: row.tries for row in found.rows}
    assert tries["still"] < tries["scripted"] == tries["copy"]
    verdicts = {(r.first, r.second): r.verdict for r in found.results}
    assert verdicts["still", "scripted"] == verdicts["still", "copy"] == "second"
    assert verdicts["scripted", "copy"] == "no answer"


@pytest.mark.parametrize("workers", [2])
def test_workers_change_nothing(config, workers, tmp_path):
    one = compare(config, silent())
    two = compare(replace(config, workers=workers, out=tmp_path / "two"), silent())
    assert one.results == two.results


def test_policies_of_different_tasks_are_refused(config, policy_file, tmp_path):
    other = write(policy_file, tmp_path / "round", peg="round")
    policies = (config.policies[1], other)
    with pytest.raises(ConfigError) as raised:
        compare(replace(config, policies=policies), silent())
    assert raised.value.name == "peg"
    assert raised.value.value == "round"
    assert not config.out.exists()


def test_a_task_given_for_both_lets_them_be_compared(config, policy_file, tmp_path):
    other = write(policy_file, tmp_path / "round", peg="round")
    both = replace(
        config,
        policies=(config.policies[1], other),
        task_options={"peg": "square"},
        tries=6,
    )
    assert compare(both, silent()).results[0].pairs.tries > 0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_two_different_policies_are_refused(config, policy_file, count):
    policies = (str(policy_file),) * count
    with pytest.raises(ConfigError) as raised:
        compare(replace(config, policies=policies), silent())
    assert raised.value.name == "policies"


def test_what_was_tried_is_shown_when_it_is_cut_short(config, monkeypatch):
    from dovetail.evaluation import race

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(race, "judge", interrupted)
    text = StringIO()
    with pytest.raises(KeyboardInterrupt):
        compare(config, Console(file=text, width=140))
    assert "0/1" in text.getvalue()
    assert not (config.out / "compare.json").exists()


def test_starts_do_not_depend_on_what_a_policy_observes(config, policy_file):
    """Stacked observations draw nothing of their own."""
    env = Policy.load(policy_file).metadata["env"]
    starts = []
    for stack in (0, 4):
        made = make("dovetail/PegInHole-v0", **env | {"stack": stack})
        made.reset(seed=11)
        starts.append(made.unwrapped.state.q.copy())
        made.close()
    assert np.array_equal(*starts)
