"""An evaluation on an arm that an address names, and on one that feels no force."""

import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from dovetail.arms.local_arm import LocalArm
from dovetail.episode import Episode
from dovetail.errors import ConfigError
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate, name_ground
from dovetail.evaluation.origin import command_line
from dovetail.plants.plant import COLUMN

FRI = "fri://127.0.0.1:30200?clock=lockstep&control=127.0.0.1:30301&reset=place"


@pytest.fixture
def config(policy_file, tmp_path):
    return EvaluationConfig(
        policy=str(policy_file), arm="twin:easy", tries=1, out=tmp_path / "out"
    )


def run(config):
    text = StringIO()
    return evaluate(config, Console(file=text, width=140)), text.getvalue()


class BlindArm(LocalArm):
    """An arm in this process that stands for one whose contact force is unknown."""

    opened = 0

    def __init__(self, *settings, **options):
        super().__init__(*settings, **options)
        type(self).opened += 1

    def step(self, target, duration=0.05):
        state = super().step(target, duration)
        state.log[:, COLUMN["fx"] : COLUMN["fz"] + 1] = np.nan
        return state._replace(contact_force=np.full(3, np.nan))


@pytest.fixture
def blind_arm(monkeypatch):
    """Puts a `BlindArm` in the place of every arm."""
    monkeypatch.setattr("dovetail.arms.local_address.LocalArm", BlindArm)
    monkeypatch.setattr(BlindArm, "opened", 0)
    monkeypatch.setattr(
        "dovetail.envs.contact_env.build_arm", build_instead_of_connecting
    )
    return BlindArm


def build_instead_of_connecting(arm, cell, axes, config):
    from dovetail.envs.arm_setup import build_arm

    return build_arm(None, cell, axes, config)


def test_a_twin_by_address_gives_the_numbers_of_the_twin(config, tmp_path):
    by_address, text = run(config)
    by_name, _ = run(replace(config, arm=None, twin="easy", out=tmp_path / "by-name"))
    assert by_address.rows == by_name.rows
    assert "on twin easy (mujoco)" in text
    assert "--arm twin:easy" in by_address.report.origin.command


def test_a_given_hole_is_the_only_pose(config):
    hole = (0.6, 0.01, 0.1, 0.1)
    evaluation, text = run(replace(config, fixture=hole))
    assert [row.label for row in evaluation.rows] == ["given", "all"]
    assert "given" in text
    assert "--fixture 0.6 0.01 0.1 0.1" in evaluation.report.origin.command
    episode = Episode.load(evaluation.folder / "logs" / "given_00.npz")
    assert episode.metadata["fixture_pose"]["x"] == 0.6


def test_force_that_is_not_measured_is_a_dash_not_a_zero(config, blind_arm):
    evaluation, text = run(replace(config, arm=FRI))
    (row,) = (line.split() for line in text.splitlines() if line.startswith(" all"))
    assert row[-4:] == ["-", "-", "-", "0"]
    assert evaluation.rows[-1].successes == 3
    assert not (evaluation.folder / "forces.png").exists()
    content = json.loads((evaluation.folder / "report.json").read_text())
    assert content["rows"][-1]["force_peak"] is None
    assert content["ground"].startswith("simulated cabinet (fri://")


def test_the_one_arm_is_opened_once(config, blind_arm):
    run(replace(config, arm=FRI))
    assert blind_arm.opened == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"arm": "gazebo"}, "known addresses: mujoco, bullet, drake"),
        ({"twin": "easy"}, "either a plant or a twin or an arm"),
        ({"arm": "fri://0.0.0.0"}, "say where it is with --fixture"),
        ({"arm": FRI, "workers": 2}, "there is one arm"),
        ({"fixture": (0.6, 0.0, float("nan"), 0.0)}, "finite number"),
        ({"fixture": (0.6, 0.25, 0.1, 0.0)}, "outside the workspace"),
        ({"fixture": (2.0, 0.0, 0.1, 0.0)}, "too far"),
    ],
)
def test_what_cannot_be_tried_is_refused_before_anything_is_written(
    config, changes, message
):
    with pytest.raises(ConfigError) as error:
        run(replace(config, **changes))
    assert message in str(error.value)
    assert not config.out.exists()


def test_an_arm_that_turns_out_unable_to_move_the_hole_is_not_tried(
    config, monkeypatch
):
    class FixedArm(LocalArm):
        def __init__(self, *settings, **options):
            super().__init__(*settings, **options)
            traits = replace(self.facts.traits, places_fixture=False)
            self.facts = replace(self.facts, traits=traits)

    monkeypatch.setattr("dovetail.arms.local_address.LocalArm", FixedArm)
    with pytest.raises(ConfigError, match="say where it is with --fixture"):
        run(config)
    assert not config.out.exists()
    run(replace(config, fixture=(0.6, 0.0, 0.1, 0.0)))


@pytest.mark.parametrize(
    ("address", "ground"),
    [
        ("mujoco", "simulation (mujoco)"),
        ("twin:hard", "twin hard (mujoco)"),
        ("fri://0.0.0.0:30200?period=2ms", "the arm at fri://0.0.0.0:30200"),
        ("grpc://localhost:1", "the arm at grpc://localhost:1"),
        (FRI, f"simulated cabinet ({FRI})"),
    ],
)
def test_a_result_says_where_it_was_found(config, address, ground):
    assert name_ground(replace(config, arm=address)) == ground


def test_the_command_is_complete(config):
    words = command_line(replace(config, fixture=(0.6, 0.0, 0.1, 0.0)))
    assert "--arm twin:easy" in words
    assert "--fixture 0.6 0.0 0.1 0.0" in words
