"""A training on several threads learns what it learns on one."""

import csv
from dataclasses import replace
from io import StringIO

import pytest
from extras import need
from rich.console import Console
from safetensors.numpy import load_file

from dovetail.errors import ConfigError
from dovetail.learn.algorithms import make_vec_env
from dovetail.learn.config import TrainConfig
from dovetail.learn.train import train


def rows(folder):
    with (folder / "progress.csv").open() as file:
        return [
            {name: value for name, value in row.items() if name != "wall_time"}
            for row in csv.DictReader(file)
        ]


@pytest.mark.parametrize("changes", [{}, {"randomise_dynamics": True}])
def test_the_policy_is_the_same_with_any_number_of_threads(small, changes):
    need("sbx")
    weights, progress = [], []
    for threads in (1, 2):
        out = small.out.with_name(f"run-{threads}")
        config = replace(small, out=out, threads=threads, **changes)
        assert config.is_batch == (threads == 2)
        (result,) = train(config, Console(file=StringIO()))
        weights.append(load_file(result.policy))
        progress.append(rows(out))
    assert progress[0] == progress[1]
    assert len(progress[0]) > 4
    for name, values in weights[0].items():
        assert values.tobytes() == weights[1][name].tobytes()


def test_mujoco_in_this_process_is_a_batch_and_nothing_else(small):
    need("sbx")
    for changes, kind in (
        ({}, "BatchVecEnv"),
        ({"num_envs": 1}, "DummyVecEnv"),
        ({"threads": 1}, "DummyVecEnv"),
        ({"arm": "twin:easy"}, "DummyVecEnv"),
    ):
        env = make_vec_env(replace(small, **changes))
        assert type(env).__name__ == kind
        env.close()


def test_threads_that_would_do_nothing_are_refused():
    for place in ({"plant": "bullet"}, {"arm": "twin:easy"}):
        with pytest.raises(ConfigError, match="threads is 2, but only MuJoCo in this"):
            TrainConfig(threads=2, **place)
    with pytest.raises(ConfigError, match="threads is -1; allowed: 0 to"):
        TrainConfig(threads=-1)


def test_another_number_of_threads_resumes_the_same_run():
    config = TrainConfig()
    replace(config, threads=3).require_same(config.to_json())
