"""A picture gives the right pose with the right covariance, or the reason for none."""

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.camera import Lens
from dovetail.perceive.detect import Detection, DetectionFailure, Detector, explain
from dovetail.perceive.edges import Edges
from dovetail.perceive.projection import Projection
from dovetail.perceive.simulated import Simulated, spoil
from dovetail.plants.twin_camera import TwinCamera, TwinImage
from dovetail.poses import Pose, compose, inverse, quat_about_z, rotation_error

from .scene import PLACE, beside, looking

AWAY = np.array([-1.2, 0.0, 0.0, -1.0, 0.0, 0.5, 0.0])
REGION = 12.592  # 95 % of chi squared, 6 degrees of freedom


@pytest.fixture(scope="module")
def source(opengl):
    source = Simulated(beside(), find_cell(), TwinCamera())
    yield source
    source.close()


@pytest.fixture(scope="module")
def picture(source):
    return source.still(AWAY, PLACE, PLACE, 0)


def detector(**board):
    return Detector(Board(**board), beside().lens)


def test_the_pose_of_a_picture_is_right_and_lies_in_its_region(source):
    rng, inside, camera = np.random.default_rng(4), [], source.camera
    for number in range(24):
        fixture = Pose(
            PLACE.position + np.array([*rng.uniform(-0.04, 0.04, 2), 0.0]),
            quat_about_z(rng.uniform(-0.4, 0.4)),
        )
        seen = detector().find(source.still(AWAY, fixture, fixture, number))
        true = compose(inverse(camera.pose), fixture)
        gap = seen.pose.position - true.position
        turn = rotation_error(seen.pose.quat_wxyz, true.quat_wxyz)
        assert np.linalg.norm(gap) < 1.5e-3
        e = np.concatenate([gap, turn])
        inside.append(e @ np.linalg.solve(seen.covariance, e) < REGION)
    assert np.mean(inside) >= 0.85  # benchmarks/camera.py has 400 of them


def test_both_poses_of_the_flat_board_come_with_their_errors(picture):
    seen = detector().find(picture)
    assert isinstance(seen, Detection)
    assert seen.error < 0.1
    assert seen.other_error > 3.0 * seen.error
    turn = rotation_error(seen.pose.quat_wxyz, seen.other.quat_wxyz)
    assert np.linalg.norm(turn) > 0.2


@pytest.mark.parametrize(("distance", "is_told"), [(0.5, True), (80.0, False)])
def test_two_poses_that_cannot_be_told_apart_are_refused(distance, is_told):
    lens = Lens.ideal(640, 480, 1200.0 * distance)  # from afar perspective is lost
    far = PLACE.position + distance * np.array([0.35, 0.0, 0.94])
    seen = compose(inverse(looking(far, PLACE.position)), PLACE)
    points = Board().corners
    corners = Projection(lens).place(seen, points)
    corners += np.random.default_rng(0).normal(0.0, 0.05, corners.shape)
    way = np.roll(corners, -1, axis=1) - corners
    normal = np.stack([way[..., 1], -way[..., 0]], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    edges = Edges(normal, (normal * corners).sum(axis=2), corners, np.ones(8, bool))
    found = Detector(Board(), lens)._fit(points, edges, np.arange(8))
    if is_told:
        assert isinstance(found, Detection)
    else:
        assert isinstance(found, DetectionFailure)
        assert found.reason == "ambiguous"


def test_a_mirrored_picture_is_named(picture):
    flipped = np.ascontiguousarray(picture[:, ::-1])
    seen = detector().find(flipped)
    assert isinstance(seen, DetectionFailure)
    assert "mirrored" in explain(detector(), flipped, seen)


def test_another_board_is_named(picture):
    seen = detector(first_id=100).find(picture)
    assert isinstance(seen, DetectionFailure)
    assert seen.reason == "other"
    assert "[0, 1, 2, 3, 4, 5, 6, 7]" in seen.words
    assert "100 to 107" in seen.words


def test_two_boards_are_refused(picture):
    both = picture.copy()
    both[:, 320:] = np.roll(picture, 170, axis=1)[:, 320:]
    both[:, :320] = np.roll(picture, -170, axis=1)[:, :320]
    seen = detector().find(both)
    assert isinstance(seen, DetectionFailure)
    assert seen.reason == "two"


@pytest.mark.parametrize(("share", "is_seen"), [(0.35, True), (0.95, False)])
def test_a_covered_board_is_right_or_not_seen(source, picture, share, is_seen):
    camera = source.camera
    true = compose(inverse(camera.pose), PLACE)
    corners = Projection(camera.lens).place(true, Board().corners).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    covered = picture.copy()
    covered[:, int(low[0]) - 4 : int(low[0] + share * (high[0] - low[0]))] = 90
    seen = detector().find(covered)
    assert isinstance(seen, Detection) == is_seen
    if isinstance(seen, Detection):
        assert np.linalg.norm(seen.pose.position - true.position) < 2e-3
    else:
        assert seen.reason in ("few", "none")


def test_the_wrong_resolution_is_refused(picture):
    with pytest.raises(ConfigError, match="320 x 240 pixels and the camera was"):
        detector().find(picture[::2, ::2].copy())


def test_glare_and_darkness_hide_the_board_and_do_not_move_it(source, picture):
    true = compose(inverse(source.camera.pose), PLACE)
    for light in (-200.0, 60.0, 400.0):
        changed = np.clip(picture.astype(float) + light, 0, 255).astype(np.uint8)
        seen = detector().find(changed)
        if isinstance(seen, Detection):
            assert np.linalg.norm(seen.pose.position - true.position) < 2e-3


def test_a_sensor_blurs_and_adds_noise():
    grey = np.full((60, 80), 100.0, dtype=np.float32)
    rng = np.random.default_rng(0)
    noisy = spoil(grey, TwinImage(noise=5.0, blur=0.0), rng)
    assert noisy.std() == pytest.approx(5.0, rel=0.05)
    grey[:, 40:] = 200.0
    soft = spoil(grey, TwinImage(noise=0.0, blur=2.0), rng)
    assert 100 < soft[30, 38] < 150 < soft[30, 41] < 200
