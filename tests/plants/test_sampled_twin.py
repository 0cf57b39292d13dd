"""Twins drawn at random: the same from the same seed, inside the stated ranges."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.errors import ConfigError
from dovetail.plants.sampled_twin import RANGES, sample_twin
from dovetail.plants.twin import load_twin

MANY = [sample_twin(seed) for seed in range(200)]


def test_a_seed_is_one_twin():
    assert sample_twin(7) == sample_twin(7)
    assert replace(sample_twin(8), seed=7, description="") != replace(
        sample_twin(7), description=""
    )


def test_the_engine_changes_no_number():
    assert replace(sample_twin(7, "bullet"), engine="mujoco") == sample_twin(7)


@pytest.mark.parametrize("name", sorted(set(RANGES) - {"coulomb", "armature"}))
def test_numbers_fill_their_range(name):
    values = np.array([vars(twin)[name] for twin in MANY])
    if name == "gravity_residual":
        assert np.abs(values[:, :2]).max() <= RANGES[name][1] / 2
        values = values[:, 2]
    low, high = RANGES[name]
    assert low <= values.min() < low + 0.1 * (high - low)
    assert high - 0.1 * (high - low) < values.max() <= high


@pytest.mark.parametrize("name", ["coulomb", "armature"])
def test_all_joints_of_a_twin_are_worn_alike(name):
    values = np.array([vars(twin)[name] for twin in MANY])
    ratio = values[:, 1:] / values[:, :1]
    assert ratio[:, 0].min() >= 0.8 / 1.25
    assert ratio[:, 0].max() <= 1.25 / 0.8


def test_every_published_inertia_set_is_drawn():
    assert {twin.inertia for twin in MANY} == {"drake", "pybullet", "lbr"}


def test_the_command_prints_a_file_that_can_be_read(tmp_path, capsys):
    assert run(["twin", "sample", "--seed", "5", "--engine", "bullet"]) == 0
    file = tmp_path / "mine.toml"
    file.write_text(capsys.readouterr().out)
    assert load_twin(file) == sample_twin(5, "bullet")


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_a_seed_out_of_range_is_refused(seed):
    with pytest.raises(ConfigError) as raised:
        sample_twin(seed)
    assert raised.value.name == "seed"
