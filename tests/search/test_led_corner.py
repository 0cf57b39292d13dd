"""Corners by which a part is led: of openings, posts, pins and notched outlines."""

import numpy as np
import pytest

from dovetail.search.led_corner import SoughtOpening, far_corners
from dovetail.tasks.task import Outline
from dovetail.workcell.outline import moved_corners

BOX = np.array([[0, 0], [16, 0], [16, 12], [0, 12]])
ARMS = np.array([(3, 1), (1, 1), (1, 3), (-1, 3), (-1, 1), (-3, 1)])
PLUS = np.vstack([ARMS, -ARMS])


def outline(corners, **kinds):
    """Return an outline [mm] of a fixture that is 20 mm deep."""
    closed = 1e-3 * np.array([*corners, corners[0]], dtype=float)
    return Outline(closed, 0.05, 0.02, **kinds)


@pytest.mark.parametrize("at", [(0.0, 0.0), (8.0, 6.0), (30.0, 6.0)])
def test_where_the_origin_of_an_outline_lies_does_not_matter(at):
    opening = SoughtOpening(outline(BOX - at), 0.0001)
    middle = np.array([8.0, 6.0]) - at
    np.testing.assert_allclose(1e3 * opening.middle, middle, atol=1e-9)
    assert opening.radius == pytest.approx(0.010)
    assert opening.catch == pytest.approx(0.010)  # its half width of 6 mm is more


def test_the_led_corner_of_the_part_ends_at_that_of_the_opening():
    gap = 0.0002
    part = moved_corners(1e-3 * (BOX - [8.0, 6.0]), -gap)
    (led,) = SoughtOpening(outline(BOX - [8.0, 6.0]), gap).corners
    # A corner is farther off than the gap; the part's may not be beyond its own.
    nearest = np.linalg.norm(part - led.on_part[:2], axis=1).min()
    assert nearest < gap
    assert led.size < 0.010
    np.testing.assert_allclose(led.to_walls, led.along)
    assert led.tilt_axis @ led.along == pytest.approx(0.0)


def test_what_goes_over_a_post_is_led_from_outside():
    square = np.array([[4, 4], [-4, 4], [-4, -4], [4, -4]])
    post = outline(square, is_post=True)
    (led,) = SoughtOpening(post, 0.0002).corners
    assert led.size > np.hypot(0.004, 0.004)
    np.testing.assert_allclose(led.to_walls, -led.along)


def test_a_given_corner_is_taken_and_a_pin_tilts_about_it_far_out():
    pin = BOX * 0.25 + [30.0, -1.5]
    corner = 1e-3 * np.array([34.0, 1.5])
    opening = SoughtOpening(outline(pin, corner=corner, is_pin=True), 0.0002)
    (led,) = opening.corners
    np.testing.assert_allclose(opening.middle, [0.032, 0.0], atol=1e-9)
    np.testing.assert_allclose(led.along[:2], [0.8, 0.6], atol=1e-9)
    assert led.lever == pytest.approx(0.8 * 0.032 + led.size)
    assert SoughtOpening(outline(pin), 0.0002).corners[0].lever == opening.radius


def test_the_far_corners_of_a_notched_opening_are_all_tried_spread_around():
    far = far_corners(np.array([*PLUS, PLUS[0]], dtype=float))
    assert len({tuple(point) for point in far}) == len(far) == 8
    angles = [np.arctan2(y, x) for x, y in far[:3]]
    turns = np.abs(np.angle(np.exp(1j * np.diff(angles))))
    assert (turns > np.radians(60)).all()
    opening = SoughtOpening(outline(PLUS), 0.0001)
    assert opening.is_notched
    assert len(opening.corners) == 8
