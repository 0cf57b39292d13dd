"""Pictures are of what was measured: neither empty nor frozen."""

import gc
import itertools
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

from dovetail import mujoco_gl
from dovetail.arms.arm import ArmState, ToolState
from dovetail.cli import run
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError, ConfigError, MissingDependencyError
from dovetail.evaluation import evaluate
from dovetail.poses import Pose, quat_about_z, tool_down
from dovetail.view import gl_context
from dovetail.view.film import Film
from dovetail.view.gl_context import find_backend
from dovetail.view.marks import FORCE_COLOUR, FORCE_SCALE, PATH_COLOUR

CELL = find_cell()
ROBOT = CELL.loaded_robot()
HOLE = Pose(np.array([0.6, 0.0, 0.1]), quat_about_z(0.0))
ID = "dovetail/PegInHole-v0"


def above(height):
    pose = Pose(HOLE.position + np.array([0.0, 0.0, height]), tool_down(0.0))
    return ROBOT.inverse_kinematics(pose, ROBOT.posture("down"))


def pixels_like(picture, colour):
    """Which pixels have the hue of a colour, whatever light falls on them."""
    way = picture / np.maximum(np.linalg.norm(picture, axis=2, keepdims=True), 1.0)
    return way @ (np.array(colour) / np.linalg.norm(colour)) > 0.99


def test_a_picture_shows_what_changes_and_nothing_else(renderer):
    first = renderer.draw(above(0.1), HOLE)
    assert first.shape == (480, 640, 3)
    assert first.std() > 20.0
    np.testing.assert_array_equal(renderer.draw(above(0.1), HOLE), first)
    beside = HOLE._replace(position=HOLE.position + np.array([0.0, 0.05, 0.0]))
    for height, hole in ((0.05, HOLE), (0.1, beside)):
        other = renderer.draw(above(height), hole)
        changed = (np.abs(other.astype(int) - first) > 30).any(axis=2)
        assert 100 < changed.sum() < 0.3 * changed.size


def test_a_force_is_an_arrow_of_its_size_and_a_path_a_line(renderer):
    q = above(0.1)
    tip = HOLE.position + np.array([-0.04, -0.05, 0.1])
    heights = []
    for force in (20.0, 40.0):
        arrow = renderer.draw(q, HOLE, force=np.array([0.0, 0.0, force]))
        end = tip + np.array([0.0, 0.0, FORCE_SCALE * force])
        line = renderer.draw(q, HOLE, path=[tip, end])
        rows = [
            np.flatnonzero(pixels_like(picture, colour).any(axis=1))
            for picture, colour in ((arrow, FORCE_COLOUR), (line, PATH_COLOUR))
        ]
        heights += [np.ptp(found) for found in rows]
    assert heights[0] == pytest.approx(heights[1], abs=4)
    assert heights[2] == pytest.approx(heights[3], abs=4)
    assert heights[2] > 1.7 * heights[0]
    unknown = renderer.draw(q, HOLE, force=np.full(3, np.nan))
    np.testing.assert_array_equal(unknown, renderer.draw(q, HOLE))


def test_of_a_long_path_the_end_is_drawn_and_the_arrow_too(renderer):
    q, force = above(0.1), np.array([0.0, 0.0, 40.0])
    begin = HOLE.position + np.array([-0.04, 0.15, 0.1])
    path = [*[begin] * 3000, begin + np.array([0.0, 0.0, 0.1])]
    assert pixels_like(renderer.draw(q, HOLE, path=path), PATH_COLOUR).sum() > 100
    assert (
        pixels_like(renderer.draw(q, HOLE, path=path, force=force), FORCE_COLOUR).sum()
        > 100
    )


def test_an_environment_draws_what_it_measured(renderer):
    env = gym.make(ID, render_mode="rgb_array")
    assert env.metadata["render_fps"] == 20
    env.reset(seed=0)
    first = env.render()
    for _ in range(5):
        env.step(np.array([0.0, 0.0, -1.0, 0.0], dtype=np.float32))
    later = env.render()
    np.testing.assert_array_equal(env.render(), later)
    assert (first != later).any()
    env.close()
    env.close()
    with pytest.raises(ArmError, match="environment is closed"):
        env.render()


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes")
def test_an_unknown_render_mode_is_refused():
    with pytest.raises(ConfigError, match="render_mode is 'ansi'; known: rgb_array"):
        gym.make(ID, render_mode="ansi").unwrapped.reset()


def test_a_film_of_each_poses_first_try_lies_beside_the_report(renderer, tmp_path):
    out = tmp_path / "film"
    words = ["demo", "--tries", "2", "--workers", "2", "--video", "--out", str(out)]
    assert run(words) == 0
    assert (out / "report.html").read_text().count("data:image/gif") == 3
    for name in "ABC":
        with Image.open(out / f"{name}.gif") as film:
            assert film.size == (640, 480)
            assert 20 < film.n_frames < 200
            assert film.info["duration"] == 50


def test_a_long_film_never_has_all_its_pictures_at_once(tmp_path):
    class Still:
        most = drawn = 0

        def draw(self, q, fixture, force, path, believed, parts):
            self.drawn += 1
            if self.drawn % 25 == 0:  # to look at every object takes a second
                things = gc.get_objects()
                alive = sum(isinstance(thing, Image.Image) for thing in things)
                self.most = max(self.most, alive)
            return np.full((48, 64, 3), 200, dtype=np.uint8)

    film, still, count = Film(), Still(), 100
    tool = ToolState(*[np.zeros(3)] * 3)
    state = ArmState(*[np.zeros(3)] * 3, tool, *[np.zeros(3)] * 3, log=np.zeros(0))
    for _ in range(count):
        film.add(state, HOLE, HOLE)
    with Image.open(film.write(tmp_path / "still.gif", still)) as written:
        assert written.info["duration"] == 50 * (count + 20)
    assert 0 < still.most < 20


def test_without_opengl_the_packages_are_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(mujoco_gl.ctypes.util, "find_library", lambda name: None)
    with pytest.raises(MissingDependencyError, match="libegl1 libgl1-mesa-dri"):
        find_backend()
    out = tmp_path / "none"
    assert run(["demo", "--tries", "1", "--video", "--out", str(out)]) != 0
    assert "apt install libegl1" in capsys.readouterr().err
    assert not out.exists()


def test_a_driver_that_fails_ends_a_command_before_its_first_try(
    monkeypatch, tmp_path, capsys
):
    class Broken:
        def __init__(self, width, height):
            raise ArithmeticError("EGL_NOT_INITIALIZED")  # PyOpenGL has its own errors

    monkeypatch.setattr(mujoco_gl.ctypes.util, "find_library", lambda name: name)
    broken = SimpleNamespace(GLContext=Broken, EGL_DISPLAY=None)
    modules = SimpleNamespace(import_module=lambda name: broken)
    monkeypatch.setattr(gl_context, "importlib", modules)
    with pytest.raises(MissingDependencyError, match="EGL_NOT_INITIALIZED; install"):
        gl_context.open_context(8, 8)
    monkeypatch.setattr(
        evaluate, "Renderer", lambda cell: gl_context.open_context(8, 8)
    )
    monkeypatch.setattr(evaluate, "run_trials", None)
    out = tmp_path / "none"
    assert run(["demo", "--tries", "1", "--video", "--out", str(out)]) == 2
    assert "EGL_NOT_INITIALIZED" in capsys.readouterr().err
    assert not out.exists()


def test_the_backend_that_is_asked_for_is_taken(monkeypatch):
    monkeypatch.setattr(mujoco_gl.ctypes.util, "find_library", lambda name: name)
    monkeypatch.setattr(gl_context, "draws", lambda name: True)
    assert find_backend() == "egl" or "MUJOCO_GL" in gl_context.os.environ
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert find_backend() == "osmesa"


@pytest.mark.parametrize(
    ("working", "taken"),
    [(("egl", "osmesa"), "egl"), (("osmesa",), "osmesa"), ((), "egl")],
)
def test_what_draws_is_found_by_trying(working, taken, monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(mujoco_gl.ctypes.util, "find_library", lambda name: name)
    monkeypatch.setattr(gl_context, "draws", lambda name: name in working)
    assert find_backend() == taken


def test_a_way_to_draw_that_there_is_not_does_not_draw():
    assert not gl_context.draws("nothing")


@pytest.mark.filterwarnings("ignore:.*natively support")
def test_gymnasium_shows_pictures_in_a_window_and_gathers_them(renderer):
    shown = gym.make(ID, render_mode="human")
    assert isinstance(shown, gym.wrappers.HumanRendering)
    assert shown.unwrapped.render_mode == "rgb_array"
    shown.close()
    env = gym.make(ID, render_mode="rgb_array_list")
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(4, dtype=np.float32))
    pictures = env.render()
    assert [picture.shape for picture in pictures] == [(480, 640, 3)] * 4
    env.close()


def test_each_action_is_a_frame_of_a_recorded_video(renderer, tmp_path, monkeypatch):
    """By a stand-in for moviepy, whose newest release needs an older Pillow."""
    written = []

    class ImageSequenceClip:
        def __init__(self, frames, fps):
            self.frames, self.fps = [np.array(frame) for frame in frames], fps

        def write_videofile(self, path, logger=None):
            written.append((path, self.frames, self.fps))

    name = "moviepy"
    monkeypatch.setitem(sys.modules, name, ModuleType(name))
    for part in ("video", "io", "ImageSequenceClip"):
        name = f"{name}.{part}"
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(
        sys.modules[name], "ImageSequenceClip", ImageSequenceClip, raising=False
    )
    env = gym.make(ID, render_mode="rgb_array", max_episode_steps=5)
    with gym.wrappers.RecordVideo(env, str(tmp_path / "new")) as filmed:
        filmed.reset(seed=0)
        is_over = [
            any(filmed.step(np.array([0.0, 0.0, -1.0, 0.0], dtype=np.float32))[2:4])
            for _ in range(5)
        ]
    assert is_over == [False] * 4 + [True]
    ((path, frames, fps),) = written
    assert path.endswith(".mp4")
    assert fps == 20
    assert [frame.shape for frame in frames] == [(480, 640, 3)] * (1 + 5)
    for before, after in itertools.pairwise(frames):
        assert (before != after).any()


def test_pictures_that_another_thread_drew_end_a_program_in_silence(renderer):
    program = """
import threading
import numpy as np
from dovetail.envs.registered import find_cell
from dovetail.poses import Pose, quat_about_z
from dovetail.view.renderer import Renderer

kept = []
def draw():
    kept.append(Renderer(find_cell()))
    kept[0].draw(np.zeros(7), Pose(np.zeros(3), quat_about_z(0.0)))
thread = threading.Thread(target=draw)
thread.start()
thread.join()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
