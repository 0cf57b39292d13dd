"""A camera as a tracker: in an environment, and when it does not see."""

from types import SimpleNamespace

import numpy as np
import pytest

from dovetail.cockpit.occlusion import Occlusion
from dovetail.envs.registered import find_cell, make_env
from dovetail.errors import ConfigError, TrackerError
from dovetail.perceive.simulated import Simulated
from dovetail.perceive.sources import Frame
from dovetail.plants.twin import load_twin
from dovetail.plants.twin_camera import TwinCamera
from dovetail.poses import Pose, quat_from_vector, quat_multiply, rotation_error
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.trackers.late import Late
from dovetail.trackers.marker import MarkerTracker

from .scene import PLACE, beside


@pytest.fixture
def file(tmp_path, opengl):
    path = tmp_path / "camera.toml"
    path.write_text(beside().to_toml())
    return str(path)


def test_an_environment_is_told_what_the_camera_sees(file):
    env = make_env(PegInHole, tracker=file)
    env.reset(seed=3)
    ages = []
    for _ in range(4):
        env.step(np.zeros(4, dtype=np.float32))
        seen, age, covariance = env.tracker.estimate()
        ages.append(age)
        assert np.linalg.norm(seen.position - env.fixture.position) < 2e-3
        turn = rotation_error(seen.quat_wxyz, env.fixture.quat_wxyz)
        assert np.abs(turn).max() < 0.01
        assert 0.0 < np.sqrt(covariance[0, 0]) < 2e-3
    assert min(ages) >= 0.05
    assert max(ages) < 0.05 + 1.0 / 30.0 + 1e-6
    env.close()


CELL = find_cell()
Q = CELL.robot.posture("down")
ASIDE = np.array([-1.2, 0.0, 0.0, -1.0, 0.0, 0.5, 0.0])


def state(stamp):
    return SimpleNamespace(stamp=stamp, q=Q, log=np.zeros((0, 42)))


class Shown:
    """A source whose pictures the test chooses."""

    def __init__(self, picture):
        self.picture, self.is_unplugged, self.is_closed = picture, False, False

    def reset(self, fixture, seed):
        return Frame(self.picture, 0.05)

    def look(self, fixture, state):
        if self.is_unplugged:
            raise TrackerError("unplugged")
        return Frame(self.picture, 0.05)

    def close(self):
        self.is_closed = True


@pytest.fixture(scope="module")
def picture(opengl):
    source = Simulated(beside(), CELL)
    yield source.still(Q, PLACE, PLACE, 0)
    source.close()


def test_a_board_out_of_sight_grows_old_and_stays_where_it_was(picture):
    source = Shown(picture)
    tracker = MarkerTracker(beside(), source, CELL.robot)
    tracker.reset(PLACE, 0)
    tracker.update(PLACE, state(0.05))
    seen = tracker.estimate()
    assert seen.age == pytest.approx(0.05)
    assert tracker.reason == ""
    source.picture = np.full_like(picture, 128)
    for stamp in (0.1, 0.15, 0.2):
        tracker.update(PLACE, state(stamp))
    late = tracker.estimate()
    assert late.age == pytest.approx(0.2)
    np.testing.assert_array_equal(late.pose.position, seen.pose.position)
    assert tracker.reason == "no marker is in sight"


def test_a_board_that_was_never_seen_is_an_error(picture):
    tracker = MarkerTracker(beside(), Shown(np.full_like(picture, 128)), CELL.robot)
    tracker.reset(PLACE, 0)
    with pytest.raises(TrackerError, match=r"not seen the board .*: no marker"):
        tracker.estimate()


def test_a_mirrored_picture_is_named(picture):
    source = Shown(np.ascontiguousarray(picture[:, ::-1]))
    tracker = MarkerTracker(beside(), source, CELL.robot)
    tracker.reset(PLACE, 0)
    with pytest.raises(TrackerError, match="the picture is mirrored: switch"):
        tracker.estimate()


def test_an_unplugged_camera_holds_the_arm(picture, monkeypatch):
    env = make_env(PegInHole)
    source = Shown(picture)
    env.tracker = MarkerTracker(beside(), source, CELL.robot)
    env.reset(seed=0)
    stopped = []
    monkeypatch.setattr(env.arm, "stop", lambda: stopped.append(True))
    source.is_unplugged = True
    with pytest.raises(TrackerError, match="unplugged"):
        env.step(np.zeros(4, dtype=np.float32))
    assert stopped == [True]
    env.close()


def stopping(monkeypatch, source, **camera):
    """An environment whose camera shows what a test chooses, and whether it stopped."""
    tracker = MarkerTracker(beside(**camera), source, CELL.robot)
    env = make_env(PegInHole, tracker=tracker)
    stopped = []
    monkeypatch.setattr(env.arm, "stop", lambda: stopped.append(True))
    return env, stopped


def test_a_picture_of_another_size_in_motion_stops_the_arm(picture, monkeypatch):
    source = Shown(picture)
    env, stopped = stopping(monkeypatch, source)
    env.reset(seed=0, options={"fixture": PLACE})
    source.picture = picture[::2, ::2]
    with pytest.raises(ConfigError, match="320 x 240 pixels and the camera was"):
        env.step(np.zeros(4, dtype=np.float32))
    assert stopped == [True]
    env.close()


@pytest.mark.parametrize(
    ("shift", "tilt", "words"),
    [
        ((0.0, 0.0, 0.05), 0.0, r"z = 0\.1[45]\d+ m; allowed: 0\.079\d to 0\.120\d m"),
        ((0.0, 0.0, -0.03), 0.0, r"z = 0\.07\d+ m; allowed"),
        ((0.0, 0.0, 0.0), 0.3, r"tilted by 0\.(29|30)\d* rad; allowed: up to 0\.15"),
        ((0.05, -0.24, 0.0), 0.0, r"y = -0\.24\d+ m, outside the workspace"),
    ],
)
def test_a_board_where_the_fixture_cannot_stand_stops_the_arm(
    opengl, monkeypatch, shift, tilt, words
):
    at = Pose(
        PLACE.position + shift,
        quat_multiply(quat_from_vector(np.array([tilt, 0.0, 0.0])), PLACE.quat_wxyz),
    )
    drawn = Simulated(beside(focal=450.0), CELL)
    source = Shown(drawn.still(ASIDE, at, at, 0))
    drawn.close()
    env, stopped = stopping(monkeypatch, source, focal=450.0)
    with pytest.raises(TrackerError, match=words) as raised:
        env.reset(seed=0, options={"fixture": PLACE})
    assert "is the board on another part" in str(raised.value)
    assert stopped == [True]
    env.close()


@pytest.mark.parametrize("wrap", [lambda t: t, Occlusion, lambda t: Late(inner=t)])
def test_a_closed_environment_holds_no_camera(picture, wrap):
    source = Shown(picture)
    env = make_env(PegInHole, tracker=wrap(MarkerTracker(beside(), source, CELL.robot)))
    env.close()
    assert source.is_closed
    env.close()


@pytest.mark.parametrize(
    ("errors", "low", "high"),
    [
        ({}, 0.0, 1e-3),
        ({"focal_error": 0.02}, 5e-3, 3e-2),
        ({"centre_error": (6.0, 0.0)}, 2e-3, 1e-2),
        ({"position_error": (0.004, 0.0, 0.0)}, 3e-3, 5e-3),
        ({"rotation_error": (0.0, 0.0, 0.01)}, 3e-3, 8e-3),
    ],
)
def test_each_error_of_a_twins_camera_moves_what_is_seen(opengl, errors, low, high):
    source = Simulated(beside(), CELL, TwinCamera(**errors))
    tracker = MarkerTracker(beside(), source, CELL.robot)
    tracker.reset(PLACE, 0)
    gap = np.linalg.norm(tracker.estimate().pose.position - PLACE.position)
    source.close()
    assert low <= gap <= high


@pytest.mark.parametrize(
    ("key", "value", "low", "high"),
    [
        ("focal_error", 0.02, 5e-3, 3e-2),
        ("centre_error", (6.0, 0.0), 2e-3, 1e-2),
        ("position_error", (0.004, 0.0, 0.0), 3e-3, 5e-3),
    ],
)
def test_a_twins_file_has_each_of_these_errors_alone(
    opengl, tmp_path, key, value, low, high
):
    path = tmp_path / "own.toml"
    text = load_twin("easy").to_toml().partition("[camera]")[0]
    told = list(value) if isinstance(value, tuple) else value
    path.write_text(f"{text}[camera]\n{key} = {told}\n")
    errors = load_twin(path).camera
    assert any(errors.numbers())
    source = Simulated(beside(), CELL, errors)
    tracker = MarkerTracker(beside(), source, CELL.robot)
    tracker.reset(PLACE, 0)
    gap = np.linalg.norm(tracker.estimate().pose.position - PLACE.position)
    source.close()
    assert low <= gap <= high


@pytest.mark.parametrize(
    ("errors", "ages"),
    [
        ({"delay": 0.1, "rate": 100.0}, (0.1, 0.111)),
        ({"delay": 0.0, "rate": 5.0}, (0.0, 0.2)),
        ({"delay": 0.0, "rate": 20.0, "dropout": 0.7}, (0.0, 1.5)),
    ],
)
def test_delay_rate_and_dropouts_are_those_of_the_twin(opengl, errors, ages):
    source = Simulated(beside(), CELL, TwinCamera(**errors))
    tracker = MarkerTracker(beside(), source, CELL.robot)
    tracker.reset(PLACE, 1)
    seen = []
    for step in range(1, 23):
        tracker.update(PLACE, state(0.05 * step))
        if step > 5:
            seen.append(tracker.estimate().age)
    source.close()
    assert ages[0] - 1e-6 <= min(seen)
    assert max(seen) <= ages[1] + 1e-6
    if "dropout" in errors:
        assert max(seen) > 0.1


def test_what_moves_is_smeared_and_seen_where_it_was(opengl):
    source = Simulated(beside(), CELL, TwinCamera(delay=0.02, rate=20.0, exposure=0.01))
    tracker = MarkerTracker(beside(), source, CELL.robot)
    tracker.reset(PLACE, 2)
    speed = np.array([0.0, 0.1, 0.0])
    for step in range(1, 6):
        stamp = 0.05 * step
        fixture = PLACE._replace(position=PLACE.position + stamp * speed)
        tracker.update(fixture, state(stamp))
        seen = tracker.estimate()
        if seen.age < stamp:
            then = fixture.position - seen.age * speed
            assert np.linalg.norm(seen.pose.position - then) < 1.5e-3
    source.close()
