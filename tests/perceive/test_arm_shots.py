"""A calibration by any arm that goes through poses, as to the start of an episode."""

from dataclasses import replace

import numpy as np
import pytest

from arms.loopback import lockstep_address
from dovetail.cli import run
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_arm, make_settings
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.errors import TrackerError
from dovetail.perceive.arm_shots import TASK, take_shots
from dovetail.perceive.camera import load_camera
from dovetail.perceive.detect import Detection, Detector
from dovetail.perceive.simulated import Simulated
from dovetail.plants.find import make_plant
from dovetail.plants.twin import load_twin, make_twin

from .scene import beside


@pytest.fixture
def file(tmp_path, opengl):
    path = tmp_path / "beside.toml"
    path.write_text(beside().to_toml())
    return path


def hand_eye(*words):
    return run(["camera", "hand-eye", *map(str, words)])


@pytest.fixture
def cabinet():
    """The address of a simulated cabinet whose robot is a twin."""
    cell = find_cell()
    plant = make_twin(load_twin("medium"), cell)
    plant.reset(cell.robot.posture("down"), cell.place)
    with lockstep_address(plant) as address:
        yield address


def test_an_arm_behind_fri_calibrates_and_the_pictures_are_kept(
    file, cabinet, tmp_path, capsys
):
    out, kept = tmp_path / "out.toml", tmp_path / "kept"
    words = ["--twin", "medium", "--count", "8", "--keep", kept, "--arm", cabinet]
    assert hand_eye(file, "--out", out, "--yes", "--approach", *words) == 0
    assert "go: written to" in capsys.readouterr().out
    found = load_camera(out)
    gap = np.subtract(found.position, load_camera(file).position)
    np.testing.assert_allclose(gap, [0.02, -0.015, 0.01], atol=1e-3)
    assert found.twin == "medium"
    again = tmp_path / "again.toml"
    words = ["--folder", kept, "--twin", "medium", "--out", again]
    assert hand_eye(file, *words) == 0
    np.testing.assert_allclose(load_camera(again).position, found.position, atol=1e-9)


def test_a_real_arm_is_not_moved_unasked(file, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out.toml"
    words = [file, "--out", out, "--arm", "fri://127.0.0.1:31211"]
    asked = []

    def answer(question):
        asked.append(question)
        return "n"

    monkeypatch.setattr("builtins.input", answer)
    assert hand_eye(*words) == 2
    assert "The arm will go through 20 poses" in asked[0]
    assert "the tool holds the board" in asked[0]
    assert "was not moved" in capsys.readouterr().err
    assert not out.exists()


def test_an_arm_that_is_elsewhere_shows_no_simulated_pictures(file, tmp_path, capsys):
    words = [file, "--out", tmp_path / "out.toml", "--yes"]
    assert hand_eye(*words, "--arm", "fri://127.0.0.1:31212") == 2
    assert "simulated, and this arm is not" in " ".join(capsys.readouterr().err.split())


def test_where_no_picture_comes_the_arm_is_stopped(file, monkeypatch):
    class Dark:
        def __init__(self, *_):
            pass

        def reset(self, fixture, seed):
            return None

        look = reset

        def close(self):
            pass

    monkeypatch.setattr("dovetail.perceive.arm_shots.open_source", Dark)
    stopped = []
    monkeypatch.setattr(
        "dovetail.arms.local_arm.LocalArm.stop", lambda arm: stopped.append(arm)
    )
    cell = find_cell()
    arm = build_arm("mujoco", cell, TaskSpec.parse(TASK))
    with pytest.raises(TrackerError, match=r"no picture came in 5\.\d s"):
        next(take_shots(load_camera(file), arm, cell, None, 6, 0))
    assert stopped == [arm]
    arm.close()


def test_an_arm_behind_a_service_goes_through_its_poses(opengl, monkeypatch):
    served = pytest.importorskip("arms.served_arm", exc_type=ImportError)
    cell, spec = find_cell(), TaskSpec.parse(TASK)
    osc, limits = make_settings(cell, EnvConfig())
    plant = make_plant("mujoco", cell)
    plant.reset(cell.robot.posture("down"), cell.place)
    arm = served.ServedArm(plant, cell.loaded_robot(), osc, limits, spec, 0.005)
    drawn = Simulated(beside(), cell)
    monkeypatch.setattr("dovetail.perceive.arm_shots.open_source", lambda *_: drawn)
    camera = replace(beside(), source="device:0")
    shots = list(take_shots(camera, arm, cell, None, 2, 0))
    arm.close()
    detector = Detector(camera.board, camera.lens)
    assert all(isinstance(detector.find(shot.picture), Detection) for shot in shots)
    assert np.abs(shots[0].q - shots[1].q).max() > 0.1
