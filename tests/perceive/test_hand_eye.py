"""A planted camera is found where it is, and motions that do not tell are refused."""

import re

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.camera import Lens
from dovetail.perceive.hand_eye import HandEyeSample, calibrate, closed_form
from dovetail.perceive.projection import Projection
from dovetail.poses import (
    Pose,
    compose,
    inverse,
    quat_about_z,
    quat_from_vector,
    rotation_error,
)

from .scene import PLACE, looking

LENS = Lens.ideal(1280, 960, 1200.0)
TRUE = Pose(np.array([0.01, 0.09, 0.03]), quat_from_vector(np.array([0.3, 0.1, -0.2])))
BOARD = Board()


def views(seed=0, count=12, noise=0.3, mount="flange", size=1.0, roll_only=False):
    rng, projection, made = np.random.default_rng(seed), Projection(LENS), []
    for _ in range(count):
        azimuth, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.7, 1.3)
        if roll_only:
            azimuth, height = 0.3, 1.0
        flat = np.cos(height)
        out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(height)])
        look = looking(PLACE.position + rng.uniform(0.3, 0.5) * out, PLACE.position)
        look = compose(look, Pose(np.zeros(3), quat_about_z(rng.uniform(-0.7, 0.7))))
        seen = compose(inverse(look), PLACE)
        corners = projection.place(seen, size * BOARD.corners)
        corners = corners + rng.normal(0.0, noise, corners.shape)
        pose = projection.flat_poses(BOARD.corners, corners, BOARD.thickness)[0]
        moving = compose(look, inverse(TRUE))
        flange = moving if mount == "flange" else inverse(moving)
        made.append(HandEyeSample(flange, pose, corners, BOARD.corners))
    return made


@pytest.mark.parametrize("mount", ["flange", "world"])
def test_a_planted_camera_is_found_inside_its_interval(mount):
    found = calibrate(views(mount=mount, noise=0.3), LENS, mount)
    gap = found.camera.position - TRUE.position
    assert np.linalg.norm(gap) < 3e-4
    assert (np.abs(gap) < 2.0 * found.interval).all()
    assert found.error == pytest.approx(0.3, rel=0.1)
    assert found.objections() == []
    assert np.linalg.norm(found.board.position - PLACE.position) < 1e-3
    assert 1e-5 < found.leave_one_out_rms < 1e-3


def test_without_noise_the_closed_form_is_exact():
    made = views(noise=0.0)
    found = closed_form([view.flange for view in made], [view.board for view in made])
    np.testing.assert_allclose(found.position, TRUE.position, atol=1e-7)
    turn = rotation_error(found.quat_wxyz, TRUE.quat_wxyz)
    np.testing.assert_allclose(turn, 0.0, atol=1e-7)


def test_more_noise_gives_a_wider_interval_in_proportion():
    one, four = (calibrate(views(noise=n), LENS, "flange") for n in (0.1, 0.4))
    ratio = four.interval / one.interval
    np.testing.assert_allclose(ratio, 4.0, rtol=0.15)


def test_turns_about_one_axis_are_refused_by_its_name():
    with pytest.raises(ConfigError, match="about one axis"):
        calibrate(views(roll_only=True), LENS, "flange")


def test_an_arm_that_only_shifts_is_refused():
    (view,) = views(count=1)
    moved = [
        view._replace(
            flange=view.flange._replace(
                position=view.flange.position + np.array([0.01 * i, 0.0, 0.0])
            )
        )
        for i in range(8)
    ]
    with pytest.raises(ConfigError, match="do not only shift"):
        calibrate(moved, LENS, "flange")


def test_too_few_pictures_are_refused():
    with pytest.raises(ConfigError, match="5 pictures show the board"):
        calibrate(views(count=5), LENS, "flange")


@pytest.mark.parametrize(("shift", "word"), [(1, "before"), (-1, "after")])
def test_pictures_and_poses_out_of_step_are_named(shift, word):
    made = views(count=14)
    flanges = np.roll(np.arange(14), shift)
    moved = [
        made[i]._replace(flange=made[j].flange)
        for i, j in zip(range(14), flanges, strict=True)
    ]
    with pytest.raises(ConfigError, match=r"out of step: each picture fits the pose"):
        calibrate(moved[1:-1], LENS, "flange")


def test_shuffled_poses_are_named():
    made = views(count=14)
    order = np.random.default_rng(3).permutation(14)
    shuffled = [
        view._replace(flange=made[j].flange)
        for view, j in zip(made, order, strict=True)
    ]
    with pytest.raises(ConfigError, match="pictures and poses do not belong together"):
        calibrate(shuffled, LENS, "flange")


@pytest.mark.parametrize("size", [0.97, 1.02])
def test_a_print_of_another_size_is_measured_by_the_arm(size):
    with pytest.raises(ConfigError, match="of the size that is said") as raised:
        calibrate(views(size=size), LENS, "flange")
    percent, deviation = re.findall(r"[0-9.]+", str(raised.value))[:2]
    assert float(percent) == pytest.approx(100 * size, abs=2.0 * float(deviation))
    assert float(deviation) < 0.5


def test_corners_far_off_are_no_go():
    objections = calibrate(views(noise=2.5), LENS, "flange").objections()
    assert any("calibrate the lens" in text for text in objections)
