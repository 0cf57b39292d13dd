"""A camera's file comes back as it was, and says what is wrong with it."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, TrackerError
from dovetail.perceive.board import Board
from dovetail.perceive.camera import load_camera
from dovetail.perceive.open_source import open_source
from dovetail.perceive.sources import Device, Folder
from dovetail.plants.twin import load_twin
from dovetail.trackers.find import TrackerContext, find_tracker
from dovetail.trackers.late import Late
from dovetail.trackers.tracker import close_tracker

from .scene import PLACE, beside


def write(tmp_path, camera=None, *, text=None):
    path = tmp_path / "camera.toml"
    path.write_text(text or (camera or beside()).to_toml())
    return path


def test_a_camera_comes_back_from_its_own_text(tmp_path):
    correlation = tuple(tuple(row) for row in (0.5 * np.eye(6) + 0.5).tolist())
    camera = beside(
        deviation=(1e-4, 2e-4, 3e-4, 1e-3, 1e-3, 2e-3),
        correlation=correlation,
        made_by='a "test"\n',
    )
    assert load_camera(write(tmp_path, camera)) == camera
    C = camera.covariance()
    assert C[0, 1] == pytest.approx(0.5 * 1e-4 * 2e-4)
    assert np.linalg.eigvalsh(C).min() > 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("rate = 30.0", "rate = 0", "camera rate is 0 1/s; allowed: 0.1 to 1000"),
        ("rate = 30.0", "rat = 30.0", "unknown keys: rat; missing"),
        ("[lens]", "[lense]", "unknown keys: lense|table .lens. is missing"),
        ("centre = [319.5", "centre = [900.0", "centre.x. is 900 pixels, outside"),
        ('mount = "world"', 'mount = "table"', "mount is 'table'; known: world"),
        ("side = 0.1", "side = 1.0", "board side is 1 m; allowed: 0.04 to 0.19"),
        ("width = 640", "width = ", "is not TOML"),
        ("rotation = [", "rotation = [0.0, ", "rotation has shape"),
    ],
)
def test_a_wrong_file_says_what_is_wrong(tmp_path, old, new, words):
    text = beside().to_toml()
    assert old in text
    with pytest.raises(ConfigError, match=words) as raised:
        load_camera(write(tmp_path, text=text.replace(old, new)))
    assert "camera.toml" in str(raised.value)


def test_no_file_says_who_writes_one(tmp_path):
    with pytest.raises(ConfigError, match="hand-eye"):
        load_camera(tmp_path / "none.toml")


def context(**more):
    return TrackerContext(cell=find_cell(), **more)


def test_an_uncalibrated_camera_is_refused(tmp_path):
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "0.png").touch()
    camera = beside(source=f"folder:{tmp_path / 'pictures'}")
    file = str(write(tmp_path, camera))
    for text in (file, f"{file}?images=0"):
        with pytest.raises(ConfigError, match="not calibrated"):
            find_tracker(text, context())


@pytest.mark.parametrize("query", ["", "?images=0"])
def test_a_simulated_camera_is_exact_without_a_twin_alone(tmp_path, query):
    file, twin = f"{write(tmp_path)}{query}", load_twin("medium").camera
    close_tracker(find_tracker(file, context()))
    with pytest.raises(ConfigError, match=r"not calibrated.*with the same --twin"):
        find_tracker(file, context(twin=twin))


def test_a_simulated_camera_is_refused_for_a_robot(tmp_path):
    with pytest.raises(ConfigError, match="simulated, and this arm is not"):
        find_tracker(str(write(tmp_path)), context(is_simulated=False))


def test_a_board_that_is_on_another_part_is_refused(tmp_path, opengl):
    for part in ("post", "hole"):
        file = write(tmp_path, beside(board=Board(part=part)))
        assert load_camera(file).board.part == part
        if part == "hole":
            find_tracker(str(file), context()).close()
            continue
        with pytest.raises(ConfigError, match="is on a post, and this task's fixture"):
            find_tracker(str(file), context())


def test_training_takes_the_cameras_delay_rate_and_error_without_pictures(tmp_path):
    camera = beside(deviation=(1e-4, 2e-4, 1e-4, 1e-3, 2e-3, 1e-3), delay=0.07, rate=15)
    tracker = find_tracker(f"{write(tmp_path, camera)}?images=0", context())
    assert isinstance(tracker, Late)
    assert (tracker.delay, tracker.rate) == (0.07, 15.0)
    assert (tracker.bias, tracker.turn) == (4e-4, 4e-3)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("webcam", "source 'webcam' is unknown; known: simulated, device:NUMBER"),
        ("device:x", "known: simulated, device:NUMBER"),
        ("folder:/nowhere", "/nowhere is no folder of pictures"),
        ("device:97", "there is no camera 97"),
    ],
)
def test_a_source_that_there_is_not_is_named(source, words):
    with pytest.raises(ConfigError, match=words):
        open_source(replace(beside(), source=source), find_cell())


def test_a_folder_without_pictures_is_named(tmp_path):
    with pytest.raises(ConfigError, match="holds no picture"):
        Folder(tmp_path)


def test_a_folder_ends_and_a_broken_picture_is_named(tmp_path):
    (tmp_path / "0.png").write_bytes(b"no picture")
    folder = Folder(tmp_path)
    with pytest.raises(ConfigError, match="damaged"):
        folder.look(PLACE, None)
    with pytest.raises(TrackerError, match="all been shown"):
        folder.look(PLACE, None)


def test_a_camera_that_is_unplugged_says_so(monkeypatch):
    class Unplugged:
        def isOpened(self):  # noqa: N802
            return True

        def set(self, *_):
            return True

        def read(self):
            return False, None

    import cv2

    monkeypatch.setattr(cv2, "VideoCapture", lambda number: Unplugged())
    with pytest.raises(TrackerError, match="camera 3 gives no picture"):
        Device(3, 640, 480, 0.05).look(PLACE, None)
