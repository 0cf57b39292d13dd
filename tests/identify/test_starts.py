"""Any task's arm is recorded: on axes of its own, in the free air of its own cell."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.envs.registered import find_cell, make_task
from dovetail.errors import ConfigError
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording, usual_place
from dovetail.identify.replay import LogReplay
from dovetail.identify.starts import ELBOW, plan_starts, start_box
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.task import axis_of

ROOT = Path(__file__).parents[2]
RING = "ring_over_post:RingOverPost-v0"
CLIP = "dovetail/RailClip-v0"
EXCITED = "XYZ:force A:pose BC:hold"


@pytest.fixture(autouse=True)
def beside_the_ring(tmp_path, monkeypatch):
    """The example as a stranger's module in the working directory, which is trusted."""
    example = ROOT / "examples" / "06_ring_over_post.py"
    shutil.copy(example, tmp_path / "ring_over_post.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DOVETAIL_TRUST", "ring_over_post")


@pytest.mark.parametrize("place", [(0.60, 0.0, 0.09, 0.0), (0.58, 0.03, 0.12, 0.3)])
def test_starts_of_the_usual_task_are_those_of_older_recordings(place):
    """Bit for bit: the formula with its numbers, as it was."""
    cell, given = find_cell(), FixturePose.given(place)
    robot, height = cell.loaded_robot(), max(0.18, place[2] + 0.08)
    task = make_task(DEFAULT_ENV, {})
    box = start_box(cell, given.pose())
    found = plan_starts(task, robot, 4, 3, given, box)
    for number, start in enumerate(found):
        rng = np.random.default_rng([4, number, 1])
        at = rng.uniform((0.50, -0.11, height), (0.70, 0.11, height + 0.04))
        turn = place[3] + rng.uniform(-0.15, 0.15)
        q_seed = robot.posture("down") + rng.uniform(-1.0, 1.0) * ELBOW
        q_seed[6] = -turn
        pose = Pose(at, tool_down(turn))
        np.testing.assert_array_equal(start, robot.inverse_kinematics(pose, q_seed))


def test_the_usual_recording_is_described_as_before(folder):
    told = json.loads((folder / "recording.json").read_text())
    assert told["fixture"] == [0.60, 0.0, 0.09, 0.0]
    assert told["task"] == EXCITED
    assert told["controller"]["walls"] == [[0.38, -0.22, 0.03], [0.82, 0.22, 0.30]]
    fixture = Recording.load(folder).fixture
    np.testing.assert_array_equal(fixture.quat_wxyz, quat_about_z(0.0))


@pytest.mark.parametrize("env", [RING, CLIP])
def test_every_task_is_recorded_and_replayed(tmp_path, quiet, env):
    late = replace(nominal_model(), command_delay=0.005, damping=(0.8,) * 7)
    Path("late.toml").write_text(late.to_toml())
    out = tmp_path / "log"
    config = RecordConfig(env=env, arm="twin:late.toml", out=out, sequences=2, steps=12)
    recording = record(config, quiet)
    assert str(recording.task) == EXCITED
    moved = np.ptp(recording.positions()[0], axis=0)
    assert (moved > 0.02).all()  # m, on every axis
    force = recording.sequences[0].log[:, COLUMN["fx"] : COLUMN["fz"] + 1]
    assert not np.abs(force).any()
    replay = LogReplay(recording)
    assert replay.rms(late) < 1e-12
    assert replay.rms(nominal_model()) > 2e-4  # m
    replay.close()


@pytest.mark.parametrize("env", [DEFAULT_ENV, RING, CLIP])
def test_starts_are_in_front_of_the_fixture_and_off_the_walls(env):
    task, cell = make_task(env, {}), find_cell(env)
    fixture = usual_place(task).pose()
    box = start_box(cell, fixture)
    low, high = cell.walls
    assert (box.low - low >= 0.05).all()
    assert (high - box.high >= 0.04 - 1e-9).all()
    for corner in box:
        assert axis_of(fixture) @ (corner - fixture.position) >= 0.08 - 1e-9


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            [RING, "--fixture", "0.6", "0", "0.2", "0"],
            "the post ends at z = 0.2 m: the",
        ),
        (
            [CLIP, "--fixture", "0.7", "0", "0.4", "0"],
            "at x = 0.76 m or higher, or give",
        ),
        ([RING, "--fixture", "0.6", "0", "0.05", "0"], "0.0500 m inside the table"),
        ([CLIP, "--fixture", "0.99", "0", "0.4", "0"], "x = 0.9900 m, which is 0.0"),
    ],
)
def test_a_fixture_in_the_way_is_refused_before_any_motion(
    tmp_path, capsys, words, message
):
    line = ["identify", "record", "--out", "log", "--arm", "mujoco", "--env", *words]
    assert run(line) == 2
    told = capsys.readouterr()
    assert message in told.err
    assert "delay" not in told.out  # which is measured by the first motion
    assert not (tmp_path / "log").exists()


def test_contact_that_is_allowed_needs_no_free_air():
    high = FixturePose.given((0.6, 0.0, 0.2, 0.0)).pose()
    assert start_box(find_cell(), high, may_touch=True).low[2] == 0.18
    with pytest.raises(ConfigError, match="or give --allow-contact"):
        start_box(find_cell(), high)


def test_where_a_fixture_may_be_that_stands_above_its_origin_is_told():
    """It said 20 mm too much, where the motions were refused again."""
    cell = find_cell()
    up = np.array([0.0, 0.0, 0.02])
    shapes = tuple(
        shape._replace(position=shape.position + up)
        for shape in cell.fixture.primitives
    )
    fixture = replace(cell.fixture, primitives=shapes)
    cell = replace(cell, make_fixture=lambda widened_by: fixture)
    high = FixturePose.given((0.6, 0.0, 0.2, 0.0)).pose()
    with pytest.raises(ConfigError, match=r"ends at z = 0.22 m.*at z = 0.12 m or low"):
        start_box(cell, high)
    start_box(cell, FixturePose.given((0.6, 0.0, 0.12, 0.0)).pose())
