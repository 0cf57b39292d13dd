"""A recording measures the arm's delay first, and compares it with the declared one."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from arms.loopback import lockstep_address
from dovetail.envs.registered import find_cell
from dovetail.identify.recorder import RecordConfig, record
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, tool_down

HOLE = Pose(np.array([0.60, 0.0, 0.09]), quat_about_z(0.0))
START = Pose(np.array([0.60, 0.0, 0.20]), tool_down(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])


def record_of(arm, out, **settings):
    """What a recording says, and what it keeps of the delay."""
    said = io.StringIO()
    console = Console(file=said, width=1000)
    record(
        RecordConfig(arm=arm, out=out, sequences=1, steps=4, **settings),
        console,
    )
    return said.getvalue(), json.loads((out / "recording.json").read_text())["delay"]


@pytest.fixture
def late(tmp_path):
    """Writes a twin with another delay."""

    def write(delay):
        file = tmp_path / "late.toml"
        file.write_text(replace(load_twin("medium"), command_delay=delay).to_toml())
        return f"twin:{file}"

    return write


@pytest.mark.parametrize("period", [0.001, 0.0025, 0.005])
def test_a_delay_as_declared_is_kept_and_said(late, tmp_path, period):
    said, kept = record_of(late(0.005), tmp_path / "log", period=period)
    assert kept["measured"] == pytest.approx(0.005, abs=5e-4)
    assert kept["spread"] < 5e-4
    assert kept["declared"] == 0.01
    assert said.startswith("ok delay ")
    assert "declared: 10 ms" in said


@pytest.mark.parametrize(("delay", "period"), [(0.015, 0.001), (0.02, 0.005)])
def test_a_longer_delay_is_named_with_its_range(late, tmp_path, delay, period):
    said, kept = record_of(late(delay), tmp_path / "log", period=period)
    assert kept["measured"] == pytest.approx(delay, abs=5e-4)
    assert "broken delay" in said
    assert "ms, for which the limits are unproven; declared and shown to" in said
    assert "0 to 10 ms; shorten it" in said


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("", "declared: 10 ms"),
        ("&margins=model", "more than was declared; declared: 0 to 0 ms; shorten"),
    ],
)
def test_the_delay_of_an_arm_behind_fri_is_measured(tmp_path, key, words):
    plant = make_twin(load_twin("medium"), find_cell())
    plant.reset(plant.robot.inverse_kinematics(START, Q_SEED), HOLE)
    with lockstep_address(plant) as address:
        said, kept = record_of(
            address + key, tmp_path / "log", fixture=(0.6, 0, 0.09, 0)
        )
    assert kept["measured"] == pytest.approx(0.005, abs=5e-4)
    assert words in said


def test_a_recording_that_goes_on_keeps_what_was_measured(late, tmp_path):
    out = tmp_path / "log"
    arm = late(0.005)
    _, before = record_of(arm, out)
    (out / "sequence-00.npz").unlink()
    said, kept = record_of(arm, out)
    assert kept == before
    assert "delay" not in said
