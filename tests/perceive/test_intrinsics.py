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


def corners(count=20, noise=0.1, tilt=0.7, spread=0.1, lens=LENS, seed=0):
    rng, projection, made = np.random.default_rng(seed), Projection(lens), []
    size, near = [lens.width, lens.height], lens.focal[0] / 1180.0 * 1280 / lens.width
    while len(made) < count:
        azimuth, lean = rng.uniform(-np.pi, np.pi), rng.uniform(0.02, tilt)
        flat = np.sin(lean)
        out = np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.cos(lean)])
        target = PLACE.position + np.array([*rng.uniform(-spread, spread, 2), 0.0])
        look = looking(target + near * rng.uniform(0.25, 0.4) * out, target)
        look = compose(look, Pose(np.zeros(3), quat_about_z(rng.uniform(-2.0, 2.0))))
        seen = projection.place(compose(inverse(look), PLACE), BOARD.corners)
        if (seen > 0).all() and (seen < size).all():
            made.append(seen + rng.normal(0.0, noise, seen.shape))
    return made


def fit(seen, lens=LENS):
    return fit_lens(seen, [BOARD.corners] * len(seen), lens.width, lens.height)


def gaps(found, lens):
    """How far focal lengths and centre are from the truth [pixels]."""
    values = np.array([*found.lens.focal, *found.lens.centre])
    return np.abs(values - [*lens.focal, *lens.centre])


def test_a_planted_lens_is_found_with_its_deviation():
    found = fit(corners())
    gap = gaps(found, LENS)
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


@pytest.mark.parametrize("focal", [1500.0, 2500.0])
def test_a_long_lens_is_found_without_the_terms_that_it_does_not_show(focal):
    lens = Lens(width=640, height=480, focal=(focal, focal), centre=(325.0, 235.0))
    inside = 0
    for seed in range(5):
        found = fit(corners(noise=0.03, lens=lens, seed=seed), lens)
        gap = gaps(found, lens)
        assert gap[:2].max() < 0.003 * focal
        assert all(abs(term) <= 5.0 for term in found.lens.distortion)
        inside += int((gap < 1.96 * np.array(found.lens.deviation)).sum())
    assert inside >= 16  # of 20 at 95 %


def test_a_lens_too_long_for_its_pictures_is_no_go_and_not_too_sure():
    lens = Lens(width=640, height=480, focal=(6000.0, 6000.0), centre=(325.0, 235.0))
    found = fit(corners(noise=0.06, lens=lens), lens)
    assert (gaps(found, lens) < 3.5 * np.array(found.lens.deviation)).all()
    assert found.objections() != []


def test_a_strong_distortion_stays_in_the_lens():
    lens = Lens(
        width=1280, height=960, focal=(900.0, 905.0), centre=(640.0, 480.0),
        distortion=(-0.3, 0.15, 0.001, -0.001, -0.08),
    )  # fmt: skip
    found = fit(corners(noise=0.02, lens=lens), lens)
    assert found.fixed == ()
    assert found.lens.distortion == pytest.approx(lens.distortion, abs=0.05)


def test_a_fit_that_is_no_lens_is_refused_in_words_of_the_lens():
    lens = Lens(width=640, height=480, focal=(30_000.0,) * 2, centre=(325.0, 235.0))
    with pytest.raises(ConfigError) as caught:
        fit(corners(noise=1.0, lens=lens, tilt=0.5), lens)
    assert "pictures do not tell" in str(caught.value)
