"""What is recorded, and every log that must not be fitted."""

import json
import shutil

import numpy as np
import pytest

from dovetail.control.proven import DECLARED
from dovetail.control.target_columns import TARGET_UNITS
from dovetail.envs.registered import find_cell, make_env
from dovetail.episode import Episode
from dovetail.errors import ArmError, ConfigError, LogError, UnprovenWarning
from dovetail.identify import gapless
from dovetail.identify.log_checks import assign_steps
from dovetail.identify.recorder import RecordConfig, _contact, record
from dovetail.identify.recording import Recording
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.robots.iiwa14 import iiwa14
from dovetail.tasks.peg_in_hole.task import PegInHole

FIRST = "sequence-00.npz"


@pytest.fixture
def copy(folder, tmp_path):
    """A copy of the short recording that may be damaged."""
    return shutil.copytree(folder, tmp_path / "log")


def change_log(path, change):
    """Rewrite a sequence's file with changed numbers."""
    episode = Episode.load(path)
    change(episode)
    episode.save(path)


def change_description(folder, **facts):
    path = folder / "recording.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | facts))


def test_a_recording_holds_what_was_asked_for(folder):
    recording = Recording.load(folder)
    assert len(recording.sequences) == 3
    for sequence in recording.sequences:
        assert sequence.targets.shape == (10, len(TARGET_UNITS))
        assert sequence.log.shape == (100, len(CYCLE_COLUMNS))
        assert sequence.cycles == (10,) * 10
    assert recording.period == 0.005
    assert str(recording.task) == "XYZ:force A:pose BC:hold"
    assert recording.metadata["robot"] == find_cell().loaded_robot().name
    assert "0.8 to 3.2 Hz" in recording.metadata["excitation"]["description"]


def test_positions_are_the_models_at_the_measured_configuration(folder):
    recording = Recording.load(folder)
    robot = find_cell().loaded_robot()
    q = recording.sequences[1].log[42, COLUMN["q1"] : COLUMN["q7"] + 1]
    found = recording.positions()[1][42]
    np.testing.assert_allclose(found, robot.tool_pose(q).position, atol=1e-9)


def test_a_recording_that_was_cut_short_is_continued(copy, settings, quiet):
    before = Recording.load(copy).fingerprint()
    kept = (copy / FIRST).stat().st_mtime_ns
    (copy / "sequence-01.npz").unlink()
    with pytest.raises(LogError, match=r"sequence-01.npz of 3 sequences is missing"):
        Recording.load(copy)
    again = record(RecordConfig(out=copy, **settings), quiet)
    assert again.fingerprint() == before
    assert (copy / FIRST).stat().st_mtime_ns == kept


def gaps_in_tries(monkeypatch, tries):
    """Let cycles be missing in the first so many tries of a sequence."""
    plays = []

    def find(time, _period):
        plays.append(time)
        return np.diff(time) < (np.inf if len(plays) <= tries else -np.inf)

    monkeypatch.setattr(gapless, "find_gaps", find)
    return plays


def test_a_sequence_with_missing_cycles_is_played_again(
    copy, settings, quiet, monkeypatch
):
    before = Recording.load(copy).fingerprint()
    (copy / "sequence-01.npz").unlink()
    plays = gaps_in_tries(monkeypatch, 2)
    assert record(RecordConfig(out=copy, **settings), quiet).fingerprint() == before
    assert len(plays) == 3


def test_an_arm_that_never_gives_every_cycle_ends_the_recording(
    copy, settings, quiet, monkeypatch
):
    (copy / "sequence-01.npz").unlink()
    plays = gaps_in_tries(monkeypatch, 100)
    with pytest.raises(ArmError) as error:
        record(RecordConfig(out=copy, **settings), quiet)
    assert error.value.reason == "gaps"
    assert len(plays) == gapless.TRIES
    assert not (copy / "sequence-01.npz").exists()


def test_another_recording_is_not_overwritten(copy, settings, quiet):
    with pytest.raises(ConfigError, match="other settings: excitation, q_start differ"):
        record(RecordConfig(out=copy, **(settings | {"seed": 1})), quiet)


def test_a_folder_of_something_else_is_not_written_to(tmp_path, settings, quiet):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(ConfigError, match="exists and is no recording"):
        record(RecordConfig(out=tmp_path, **settings), quiet)


def test_a_hole_that_leaves_no_free_air_is_refused(tmp_path, settings, quiet):
    config = RecordConfig(out=tmp_path / "log", fixture=(0.6, 0, 0.2, 0), **settings)
    with pytest.raises(ConfigError, match=r"ends at z = 0.2 m.*allow-contact"):
        record(config, quiet)
    assert not config.out.exists()


def test_contact_ends_the_recording(tmp_path, settings, quiet):
    config = RecordConfig(out=tmp_path / "log", **settings)
    with pytest.raises(
        ArmError, match=r"the held part is in contact: .* N in sequence 0"
    ):
        record(config, quiet, starts=[touching_start()] * 3)
    assert not (config.out / FIRST).exists()


def test_contact_is_recorded_where_it_is_asked_for(tmp_path, settings, quiet):
    config = RecordConfig(out=tmp_path / "log", allow_contact=True, **settings)
    recording = record(config, quiet, starts=[touching_start()] * 3)
    force = recording.sequences[0].log[:, COLUMN["fx"] : COLUMN["fz"] + 1]
    assert np.abs(force).max() > 0.1


def test_without_a_force_the_pegs_place_tells_of_contact():
    """As behind FRI, where no contact force is measured."""
    env = make_env(PegInHole)
    hole = Pose(np.array([0.6, 0.0, 0.09]), quat_about_z(0.0))
    high = Pose(np.array([0.6, 0.0, 0.2]), tool_down(0.0))
    robot = env.arm.facts.robot
    free = robot.inverse_kinematics(high, robot.posture("down"))
    for start, expected in ((touching_start(), "at its block"), (free, "")):
        env.reset(options={"fixture": hole, "start": start})
        env.step(np.zeros(4, dtype=np.float32))
        assert _contact(env, np.nan).endswith(expected)
        assert bool(_contact(env, np.nan)) == bool(expected)


def touching_start():
    """Configuration with the peg's end on the block beside the hole [rad]."""
    pose = Pose(np.array([0.63, 0.0, 0.08985]), tool_down(0.0))
    return find_cell().loaded_robot().inverse_kinematics(pose, iiwa14().posture("down"))


def test_an_arm_that_cannot_move_the_hole_needs_to_be_told_where_it_is(tmp_path, quiet):
    config = RecordConfig(out=tmp_path / "log", arm="fri://127.0.0.1:30299")
    with pytest.raises(ConfigError, match="say where it is with --fixture"):
        record(config, quiet)


def test_a_folder_without_a_recording_is_named(tmp_path):
    with pytest.raises(LogError, match=r"is no recording: recording.json cannot be"):
        Recording.load(tmp_path)


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"format": 7}, "has format 7; this version reads 2"),
        ({"format": 1}, "has format 1; this version reads 2"),
        ({"robot": "panda"}, "of the robot 'panda'; it can be replayed on"),
        ({"period": 0.001}, r"the period is 0.005, the recording's is 0.001"),
        ({"task": "XYZ:force"}, "the task is 'XYZ:force A:pose BC:hold', the"),
    ],
)
def test_a_log_of_another_robot_period_or_task_is_refused(copy, facts, message):
    change_description(copy, **facts)
    with pytest.raises(LogError, match=message):
        Recording.load(copy)


def test_a_missing_key_is_named(copy):
    path = copy / "recording.json"
    table = json.loads(path.read_text())
    del table["fixture"]
    path.write_text(json.dumps(table))
    with pytest.raises(LogError, match="lacks fixture"):
        Recording.load(copy)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("fixture", "x"), ("fixture", [0.6, 0.0, None, 0.0]), ("arm", -1)),
        *(("controller", {}), ("controller", {"walls": 1}), ("commands", "x")),
        *(("excitation", {"sequences": "x", "steps": 50}), ("excitation", {})),
        *(("q_start", []), ("q_start", [["x"] * 7] * 2), ("period", "x")),
    ],
)
def test_a_description_of_the_wrong_kind_is_named_before_anything_is_fitted(
    copy, key, value
):
    file = copy / "recording.json"
    told = json.loads(file.read_text()) | {key: value}
    file.write_text(json.dumps(told))
    with pytest.raises(LogError, match=r"recording.json is damaged"):
        Recording.load(copy)


@pytest.mark.parametrize("told", [None, "x", [0.0] * 6, [float("nan")] * 7])
def test_a_sequence_that_does_not_tell_its_start_is_named(copy, told):
    file = copy / "sequence-01.npz"
    content = dict(np.load(file))
    about = json.loads(str(content["metadata"])) | {"q_start": told}
    np.savez(file, **{**content, "metadata": json.dumps(about)})
    with pytest.raises(LogError, match=r"sequence-01.npz is damaged: q_start"):
        Recording.load(copy)


def test_another_tool_is_found_by_where_its_tip_is(copy):
    def lower(episode):
        episode.data[:, COLUMN["z"]] -= 0.02

    change_log(copy / FIRST, lower)
    with pytest.raises(
        LogError, match=r"TCP is 20.0 mm from where .* another robot or"
    ):
        Recording.load(copy)


def test_a_gap_is_found_and_said_where(copy):
    def cut(episode):
        episode._blocks = [np.delete(episode.data, slice(30, 33), axis=0)]

    change_log(copy / FIRST, cut)
    with pytest.raises(LogError, match="20 ms pass between the cycles 29 and 30"):
        Recording.load(copy)


def test_a_nan_is_found_and_said_where(copy):
    def spoil(episode):
        episode.data[17, COLUMN["q4"]] = np.nan

    change_log(copy / FIRST, spoil)
    with pytest.raises(LogError, match="column q4 is nan in row 17"):
        Recording.load(copy)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("quat_wxyz_d_w", 7.0, r"in step 3 a Target's quat.*record it again"),
        ("stay", "all", r"its Targets are of shape \(0,\); expected are 10 rows"),
        ("f_star_x", 1.0, r"Target asks for .* of another task or scale"),
    ],
)
def test_targets_that_none_can_be_or_nobody_followed_are_refused(
    copy, name, value, message
):
    def spoil(episode):
        table = episode.metadata["targets"]
        table["rows"][3][table["columns"].index(name)] = value

    change_log(copy / FIRST, spoil)
    with pytest.raises(LogError, match=message):
        Recording.load(copy)


@pytest.mark.parametrize("told", [None, [], {"columns": 3}, {"rows": {}}])
def test_a_log_without_its_targets_is_refused(copy, told):
    def spoil(episode):
        episode.metadata["targets"] = told

    change_log(copy / FIRST, spoil)
    with pytest.raises(LogError, match=r"its Targets are of shape.*record it again"):
        Recording.load(copy)


def test_a_replay_has_the_limits_of_what_was_declared(copy):
    one = Recording.load(copy)
    assert one.settings()[1].declared_errors() == DECLARED
    given = {"delay": 0.012, "mass_error": 0.3, "payload_error": 2.0}
    change_description(copy, controller=one.metadata["controller"] | given)
    with pytest.warns(UnprovenWarning):
        limits = Recording.load(copy).settings()[1]
    assert limits.declared_errors() == given


def test_two_files_in_each_others_place_are_found(copy):
    (copy / FIRST).replace(copy / "spare.npz")
    (copy / "sequence-01.npz").replace(copy / FIRST)
    with pytest.raises(LogError, match="the sequence is 1, the recording's is 0"):
        Recording.load(copy)


def test_recordings_of_other_settings_are_not_compared(folder, copy):
    one = Recording.load(folder)
    controller = one.metadata["controller"] | {"force_damping": 1.0}
    change_description(copy, controller=controller)
    other = Recording.load(copy)
    one.require_like(one)
    with pytest.raises(LogError, match="the two recordings differ in controller"):
        one.require_like(other)


def test_a_command_that_comes_late_is_put_where_it_acted(tmp_path):
    """Three cycles a step; each command arrives one cycle late."""
    f_star = np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    log = np.zeros((9, len(CYCLE_COLUMNS)))
    log[:, COLUMN["fsx"]] = [0, 1, 1, 1, 2, 2, 2, 3, 3]
    steps = np.repeat([0, 1, 2], 3)
    first, cycles = assign_steps(tmp_path, log, steps, f_star)
    assert first == 1
    assert cycles == (3, 3, 2)


def test_a_command_that_never_arrived_is_named(tmp_path):
    f_star = np.array([[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    log = np.zeros((9, len(CYCLE_COLUMNS)))
    log[:, COLUMN["fsx"]] = [1, 1, 1, 1, 1, 1, 3, 3, 3]
    with pytest.raises(LogError, match="step 1 never reached the arm"):
        assign_steps(tmp_path, log, np.repeat([0, 1, 2], 3), f_star)
