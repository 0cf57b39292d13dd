"""`dovetail camera` writes what it is sure of, and nothing over anything."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from dovetail.cli import run
from dovetail.envs.registered import find_cell
from dovetail.perceive.camera import Camera, Lens, load_camera
from dovetail.perceive.simulated import Simulated
from dovetail.plants.twin import load_twin
from dovetail.poses import matrix_from_quat, quat_about_z, quat_from_vector
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot import ANY_GRIPPER
from dovetail.robots.robot_text import write_robot_text
from dovetail.trackers.find import TrackerContext, find_tracker

from .scene import PLACE, beside

LENS = Lens.ideal(640, 480, 600.0)


@pytest.fixture
def file(tmp_path):
    rotation = quat_from_vector(np.array([0.25, 0.0, 0.0]))
    camera = Camera(
        lens=LENS,
        mount="flange",
        position=(0.0, 0.09, 0.03),
        rotation=tuple(rotation.tolist()),
    )
    path = tmp_path / "camera.toml"
    path.write_text(camera.to_toml())
    return path


def camera(*words):
    return run(["camera", *map(str, words)])


@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_a_board_is_written_once(tmp_path, capsys, suffix):
    out = tmp_path / f"board.{suffix}"
    assert camera("board", "--out", out) == 0
    assert "sides of 100.0 mm" in capsys.readouterr().out.replace("\n", " ")
    written = out.read_bytes()
    assert camera("board", "--out", out, "--side", "0.05") == 2
    assert "stays; choose another --out" in capsys.readouterr().err
    assert out.read_bytes() == written


def test_a_board_of_another_kind_is_refused(tmp_path, capsys):
    assert camera("board", "--out", tmp_path / "board.png") == 2
    assert "neither .pdf nor .svg" in capsys.readouterr().err


def test_hand_eye_moves_the_simulated_arm_and_says_how_sure_it_is(
    opengl, file, tmp_path, capsys
):
    out, kept = tmp_path / "out.toml", tmp_path / "kept"
    words = ["hand-eye", file, "--out", out, "--count", "8", "--keep", kept]
    assert camera(*words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "8 pictures" in said
    assert "(95 %)" in said
    assert "go: written to" in said
    found, true = load_camera(out), load_camera(file)
    gap = np.subtract(found.position, true.position)
    assert np.abs(gap).max() < 5e-4
    assert max(found.deviation[:3]) < 5e-4
    assert found.as_it_is() == true
    again = tmp_path / "again.toml"
    assert camera("hand-eye", file, "--folder", kept, "--out", again) == 0
    back = load_camera(again)
    np.testing.assert_allclose(back.position, found.position, atol=1e-12)
    assert camera(*words[:4]) == 2
    assert "stays" in capsys.readouterr().err


def test_a_camera_on_a_flange_that_is_turned_to_suit_the_task_is_found(
    opengl, file, tmp_path, capsys
):
    """It was given in the axes of the robot's file: off by 76 mm."""
    arm = iiwa14()
    R = arm.geometry.flange_rotation @ matrix_from_quat(quat_about_z(np.pi / 4.0))
    geometry = replace(arm.geometry, flange_rotation=R)
    bare = {"geometry": geometry, "gripper": ANY_GRIPPER, "postures": {}}
    text, out = write_robot_text(replace(arm, **bare)), tmp_path / "out.toml"
    words = ["hand-eye", file, "--robot", text]
    assert camera(*words, "--out", out, "--count", "8") == 0
    assert "the tool is mounted turned by" in capsys.readouterr().out
    np.testing.assert_allclose(load_camera(out).position, [0, 0.09, 0.03], atol=5e-4)
    assert camera("watch", out, "--robot", text, "--count", "1") == 0


def test_a_shuffled_table_of_poses_is_named(calibrated, tmp_path, capsys):
    first, folder = calibrated.parent / "beside.toml", calibrated.parent / "kept"
    lines = (folder / "poses.csv").read_text().splitlines()
    shuffled, out = tmp_path / "shuffled", tmp_path / "out.toml"
    shutil.copytree(folder, shuffled)
    names = [line.partition(",")[0] for line in lines[1:]]
    poses = [line.partition(",")[2] for line in lines[1:]]
    moved = [poses[i] for i in (3, 7, 1, 9, 0, 5, 8, 2, 6, 4)]
    rows = [f"{name},{pose}" for name, pose in zip(names, moved, strict=True)]
    (shuffled / "poses.csv").write_text("\n".join([lines[0], *rows]) + "\n")
    words = ("--folder", shuffled, "--twin", "medium", "--out", out)
    assert camera("hand-eye", first, *words) == 2
    assert "pictures and poses do not belong together" in capsys.readouterr().err
    assert not out.exists()


def test_hand_eye_of_a_device_wants_an_arm_or_a_folder(file, tmp_path, capsys):
    text = file.read_text().replace('"simulated"', '"device:0"')
    file.write_text(text)
    assert camera("hand-eye", file, "--out", tmp_path / "out.toml") == 2
    assert "give the --arm that is to go" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (None, "poses.csv cannot be read"),
        ("picture,q1\n0.png,1\n", "needs the columns picture, q1, q2"),
        ("picture,q1,q2,q3,q4,q5,q6,q7\n0.png,0,0,0,x,0,0,0\n", "line 2: could not"),
        ("picture,q1,q2,q3,q4,q5,q6,q7\n0.png,0,0,0,nan,0,0,0\n", "line 2: an angle"),
        (
            "picture,q1,q2,q3,q4,q5,q6,q7\n0.png,0,0,0,0,0,0,0\n",
            "0.png cannot be read: No such file",
        ),
        (
            "picture,q1,q2,q3,q4,q5,q6,q7\n0.png,5,40,-3,-90,9,45,0\n",
            "line 2: q4 is -90 rad; the joint goes from -2.09 to 2.09 rad: these are "
            "degrees instead of radians",
        ),
    ],
)
def test_a_wrong_folder_says_what_it_needs(file, tmp_path, capsys, table, words):
    folder = tmp_path / "pictures"
    folder.mkdir()
    if table:
        (folder / "poses.csv").write_text(table)
    words_in = ["hand-eye", file, "--folder", folder, "--out", tmp_path / "out.toml"]
    assert camera(*words_in) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out.toml").exists()


def test_watch_says_where_the_fixture_is(opengl, file, capsys):
    assert camera("watch", file, "--count", "4") == 0
    said = capsys.readouterr().out
    assert "markers, edges" in said
    assert "+-" in said


@pytest.fixture(scope="module")
def calibrated(opengl, tmp_path_factory):
    """A calibration with twin medium, whose camera is 27 mm from where is believed."""
    folder = tmp_path_factory.mktemp("calibrated")
    (folder / "beside.toml").write_text(beside(at=(0.95, -0.25, 0.42)).to_toml())
    out, kept = folder / "out.toml", folder / "kept"
    words = ["--twin", "medium", "--out", out, "--keep", kept, "--count", "10"]
    assert camera("hand-eye", folder / "beside.toml", *words) == 0
    return out


def test_a_calibration_knows_the_twin_that_it_was_made_with(calibrated, capsys):
    file = load_camera(calibrated)
    assert file.twin == "medium"
    assert file.as_it_is() == load_camera(calibrated.parent / "beside.toml")
    for words in ((), ("--twin", "medium")):
        assert camera("watch", calibrated, "--count", "1", *words) == 0
        x, y = map(
            float, re.search(r"x (\S+) y (\S+) ", capsys.readouterr().out).groups()
        )
        assert abs(x - 600.0) < 1.0  # 20 mm beside without the twin
        assert abs(y) < 1.0
    tracker = find_tracker(str(calibrated), TrackerContext(cell=find_cell()))
    tracker.reset(PLACE, 0)
    seen = tracker.estimate().pose.position
    tracker.close()
    assert np.linalg.norm(seen - PLACE.position) < 1e-3


@pytest.mark.parametrize("twin", ["easy", "hard"])
def test_the_camera_of_each_twin_is_wrong_and_can_be_calibrated(
    calibrated, tmp_path, capsys, twin
):
    first, out = calibrated.parent / "beside.toml", tmp_path / "out.toml"
    assert camera("hand-eye", first, "--twin", twin, "--out", out) == 0
    gap = np.subtract(load_camera(out).position, load_camera(first).position)
    assert np.linalg.norm(gap) > 5e-3
    capsys.readouterr()
    assert camera("watch", out, "--count", "1") == 0
    x, y = map(float, re.search(r"x (\S+) y (\S+) ", capsys.readouterr().out).groups())
    assert np.hypot(x - 600.0, y) < 0.5


def test_a_twin_that_has_the_camera_elsewhere_is_refused(calibrated, tmp_path, capsys):
    other = tmp_path / "other.toml"
    text = load_twin("medium").to_toml()
    other.write_text(re.sub(r"position_error = .*", "position_error = [0, 0, 0]", text))
    assert camera("watch", calibrated, "--count", "1", "--twin", other) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "was calibrated with twin medium" in said
    assert "hand-eye" in said
    exact = tmp_path / "exact.toml"
    exact.write_text(calibrated.read_text().replace("?twin=medium", ""))
    assert camera("watch", exact, "--count", "1", "--twin", "medium") == 2
    assert "calibrated with no twin" in " ".join(capsys.readouterr().err.split())


def test_pictures_of_a_twin_are_no_go_without_its_name(calibrated, tmp_path, capsys):
    folder, first = calibrated.parent / "kept", calibrated.parent / "beside.toml"
    out = tmp_path / "again.toml"
    assert camera("hand-eye", first, "--folder", folder, "--out", out) == 1
    assert "mm from where it is without a twin" in capsys.readouterr().out
    assert not out.exists()
    words = ("--folder", folder, "--out", out, "--twin", "medium")
    assert camera("hand-eye", first, *words) == 0
    assert load_camera(out).source == load_camera(calibrated).source


@pytest.mark.parametrize("source", ["device:0", "simulated"])
def test_watch_says_that_a_camera_is_not_calibrated(
    opengl, monkeypatch, file, capsys, source
):
    file.write_text(file.read_text().replace('"simulated"', f'"{source}"'))
    twin = find_twin_camera(source)
    shown = Simulated(load_camera(file), find_cell(), twin)
    monkeypatch.setattr("dovetail.perceive.open_source.open_source", lambda *_: shown)
    words = ("--twin", "medium") if source == "simulated" else ()
    assert camera("watch", file, "--count", "4", *words) == 0
    said = capsys.readouterr().out
    assert "this camera is not calibrated" in said
    assert re.search(r": in the camera x \S+ y \S+ z [23]\d\d", said)


def find_twin_camera(source):
    return load_twin("medium").camera if source == "simulated" else None


def test_a_twin_without_a_simulated_camera_is_refused(file, tmp_path, capsys):
    device = tmp_path / "device.toml"
    device.write_text(file.read_text().replace('"simulated"', '"device:0"'))
    assert camera("watch", device, "--twin", "medium") == 2
    assert "the pictures are of device:0" in capsys.readouterr().err
    words = ("--folder", tmp_path, "--twin", "medium", "--out", tmp_path / "out.toml")
    assert camera("hand-eye", device, *words) == 2
    assert "twin is given, and the pictures are of" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "allowed"),
    [(("watch", "--count", "-3"), "0 to"), (("hand-eye", "--count", "2"), "6 to")],
)
def test_a_count_of_pictures_that_is_none_is_refused(
    file, tmp_path, capsys, words, allowed
):
    more = () if words[0] == "watch" else ("--out", tmp_path / "out.toml")
    assert camera(words[0], file, *words[1:], *more) == 2
    assert f"allowed: {allowed}" in capsys.readouterr().err
