"""The fixture next below its mouth: posts, and corners that walls stop."""

import json

import numpy as np
import pytest

from dovetail.tasks.insert.task import Insert
from extras import need

need("shapely")

STEM = {"outline": "circle 20", "z": [1, 60]}
PLATE = {"outline": "square 60", "z": [-28, -20]}
Z = [-20, 0]


def outline(held, fixture):
    """Return the outline that a search gets for a pair, sizes in mm."""
    pair = {"units": "mm", "gap": 0.3}
    both = {"held": {"shapes": held}, "fixture": {"shapes": fixture}}
    return Insert(part=json.dumps(pair | both)).outline()


@pytest.mark.parametrize("at", [[0, 0], [4, 0]])
def test_a_ring_goes_over_a_post(at):
    ring = {"outline": "square 20", "cutouts": ["circle 8.6"], "z": [-20, 1]}
    post = {"outline": "circle 8", "z": [-20, 0], "at": at}
    held = [ring | {"at": at}, STEM]
    found = outline(held, [post, PLATE])
    assert found.is_post
    middle = found.opening[:-1].mean(axis=0)
    np.testing.assert_allclose(middle, np.array(at) / 1e3, atol=1e-6)
    radii = np.linalg.norm(found.opening[:-1] - middle, axis=1)
    np.testing.assert_allclose(radii, 0.004, rtol=0.02)


def test_a_ring_in_a_groove_is_led_as_a_plug_is():
    ring = {"outline": "circle 20", "cutouts": ["circle 8.6"], "z": [-20, 1]}
    post = {"outline": "circle 8", "z": [-20, 0]}
    cup = {"outline": "square 60", "cutouts": ["circle 20.6"], "z": [-20, 0]}
    found = outline([ring, STEM], [post, cup, PLATE])
    assert not found.is_post
    assert np.abs(found.opening).max() == pytest.approx(0.0103, rel=0.01)


def slot(half, open_to, z):
    """Walls of a slot of a half width that is open to a side in x."""
    near, far = sorted((-20 * open_to, -half * open_to))
    wide = 20 - half
    walls = [
        {"outline": f"rectangle 40 {wide}", "at": [0, half + wide / 2]},
        {"outline": f"rectangle 40 {wide}", "at": [0, -half - wide / 2]},
        {"outline": [[near, -half], [far, -half], [far, half], [near, half]]},
    ]
    return [wall | {"z": z} for wall in walls]


@pytest.mark.parametrize("open_to", [1, -1])
@pytest.mark.parametrize("is_stepped", [False, True])
def test_a_slot_that_is_open_to_a_side_is_searched_with_a_corner_at_its_walls(
    open_to, is_stepped
):
    held = [{"outline": "square 10", "z": [-20, 60]}]
    fixture = slot(5.3, open_to, [-20, 0])
    if is_stepped:  # the mouth is wider than the end: its walls are farther out
        held = [{"outline": "square 10", "z": [-20, -10]}]
        held += [{"outline": "square 16", "z": [-10, 60]}]
        fixture = slot(5.4, open_to, [-20, -10]) + slot(8.4, open_to, [-10, 0])
    found = outline(held, [*fixture, PLATE])
    assert not found.is_post
    assert found.corner[0] * open_to < 0.0


def test_in_a_closed_opening_the_farthest_corner_is_searched_with():
    hole = {"outline": "square 60", "cutouts": ["rectangle 30.6 10.6"], "z": [-20, 0]}
    held = [{"outline": "rectangle 30 10", "z": [-20, 60]}]
    corner = outline(held, [hole, PLATE]).corner
    np.testing.assert_allclose(np.abs(corner), [0.0153, 0.0053], atol=1e-5)


@pytest.mark.parametrize("open_to", [1, -1])
def test_an_end_far_beside_the_middle_is_searched_with_a_corner_at_its_walls(open_to):
    held = [{"outline": "square 10", "at": [30, 0], "z": [-20, 60]}]
    fixture = [
        one | {"at": [30, one.get("at", [0, 0])[1]]}
        for one in slot(5.3, open_to, [-20, 0])
    ]
    found = outline(held, [*fixture, PLATE])
    assert (found.corner[0] - 0.03) * open_to < 0.0


@pytest.mark.parametrize(("width", "is_divided"), [(1, False), (6, True)])
def test_walls_inside_an_opening_divide_it_where_they_are_many(width, is_divided):
    fork = [{"outline": "rectangle 2 20", "at": [x, 0], "z": [-20, 1]} for x in (-9, 9)]
    back = {"outline": "rectangle 20 2", "at": [0, 9], "z": [-20, 1]}
    cup = {"outline": "square 40", "cutouts": ["square 20.6"], "z": [-20, 0]}
    tongue = {"outline": f"rectangle {width} 14", "z": [-20, 0]}
    found = outline([*fork, back, STEM], [cup, tongue, PLATE])
    assert not found.is_pin
    assert found.is_divided is is_divided
