"""A planted lens is found, and pictures that do not tell are refused."""

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.perceive.board import Board
from dovetail.perceive.camera import Lens
from dovetail.perceive.intrinsics import fit_lens
from dovetail.perceive.projection import Projection
from dovetail.poses import Pose, compose, inverse, quat_about_z

from .scene import PLACE, looking

LENS = Lens(
    width=1280, height=960, focal=(1180.0, 1190.0), centre=(650.0, 470.0),
    distortion=(-0.1, 0.05, 0.001, -0.001, 0.0),
)  # fmt: skip
BOARD = Board()


def corners(count=20, noise=0.1, tilt=0.7, spread=0.1):
    rng, projection, made = np.random.default_rng(0), Projection(LENS), []
    while len(made) < count:
        azimuth, lean = rng.uniform(-np.pi, np.pi), rng.uniform(0.02, tilt)
        flat = np.sin(lean)
        out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.cos(lean)])
        target = PLACE.position + np.array([*rng.uniform(-spread, spread, 2), 0.0])
        look = looking(target + rng.uniform(0.25, 0.4) * out, target)
        look = compose(look, Pose(np.zeros(3), quat_about_z(rng.uniform(-2.0, 2.0))))
        seen = projection.place(compose(inverse(look), PLACE), BOARD.corners)
        if (seen > 0).all() and (seen < [1280, 960]).all():
            made.append(seen + rng.normal(0.0, noise, seen.shape))
    return made


def fit(seen):
    return fit_lens(seen, [BOARD.corners] * len(seen), 1280, 960)


def test_a_planted_lens_is_found_with_its_deviation():
    found = fit(corners())
    values = np.array([*found.lens.focal, *found.lens.centre])
    gap = np.abs(values - [*LENS.focal, *LENS.centre])
    assert (gap < 3.5 * np.array(found.lens.deviation)).all()
    assert gap.max() < 6.0
    assert found.error == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)
    assert len(found.errors) == 20
    assert found.objections() == []


def test_a_bent_board_is_no_go():
    assert any(
        "is the board flat" in text for text in fit(corners(noise=0.6)).objections()
    )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"count": 5}, "5 pictures show the board; a lens needs 6"),
        ({"tilt": 0.1}, "tilted by 0.* rad at most"),
        ({"spread": 0.0, "count": 6}, "% of the pictures' width"),
    ],
)
def test_pictures_that_do_not_tell_are_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        fit(corners(**settings))
