"""The pin by which a plug with several is led: which, and that others are none."""

import json

import numpy as np
import pytest

from dovetail.tasks.insert.task import Insert
from extras import need

need("shapely")

BODY = {"outline": "rectangle 40 20", "z": [1, 60]}
PLATE = {"outline": "square 60", "z": [-28, -20]}
Z = [-20, 0]


def outline(held, fixture):
    """Return the outline that a search gets for a pair, sizes in mm."""
    pair = {"units": "mm", "gap": 0.3}
    both = {"held": {"shapes": [*held, BODY]}, "fixture": {"shapes": fixture}}
    return Insert(part=json.dumps(pair | both)).outline()


def pin(x, across, low=-20):
    """A round pin, at a place in x [mm]."""
    return {"outline": f"circle {across}", "at": [x, 0], "z": [low, 1]}


def block(x, across):
    """Half a socket around a place in x, with a hole at it [mm]."""
    hole = [f"circle {across + 0.6}"]
    return {"outline": "rectangle 16 40", "cutouts": hole, "at": [x, 0], "z": Z}


def middle_of(found):
    return 1e3 * found.opening[:-1].mean(axis=0)


def test_the_widest_pin_is_led_by_a_corner_that_alone_is_lowest():
    found = outline([pin(-8, 6), pin(8, 4)], [block(-8, 6), block(8, 4), PLATE])
    assert found.is_pin
    np.testing.assert_allclose(middle_of(found), [-8, 0], atol=0.01)
    x, y = 1e3 * found.corner - middle_of(found)
    assert np.hypot(x, y) == pytest.approx(3.3, rel=0.01)
    # Towards it, the other pin is at least 0.5 mm behind: it stays above the plate.
    way = np.array([x, y]) / np.hypot(x, y)
    assert 3.0 - (16 * way[0] + 2.0) > 0.5


def test_a_pin_that_is_shorter_is_not_led():
    held = [pin(-8, 6, low=-18), pin(8, 4)]
    found = outline(held, [block(-8, 6), block(8, 4), PLATE])
    np.testing.assert_allclose(middle_of(found), [8, 0], atol=0.01)


def test_one_pin_is_no_pin_among_others():
    assert not outline([pin(-8, 6)], [block(-8, 6), PLATE]).is_pin


def test_pins_without_walls_about_them_are_not_led():
    bar = {"outline": "rectangle 7 40", "z": Z}
    assert not outline([pin(-6, 4), pin(6, 4)], [bar, PLATE]).is_pin


def test_pieces_that_touch_are_one_plug():
    halves = [{"outline": "rectangle 5 10", "at": [x, 0], "z": Z} for x in (-2.5, 2.5)]
    cup = {"outline": "square 40", "cutouts": ["rectangle 10.6 10.6"], "z": Z}
    found = outline([*(half | {"z": [-20, 1]} for half in halves)], [cup, PLATE])
    assert not found.is_pin
    assert not found.is_divided


def test_contacts_inside_a_shell_are_no_pins():
    shell = {"outline": "rectangle 16 10", "cutouts": ["rectangle 14 8"]}
    contacts = [pin(-3, 1), pin(3, 1)]
    tongue = [
        {"outline": "rectangle 4 7", "z": Z},
        *({"outline": "rectangle 2.4 7", "at": [x, 0], "z": Z} for x in (-5.4, 5.4)),
    ]
    cup = {"outline": "square 40", "cutouts": ["rectangle 16.6 10.6"], "z": Z}
    found = outline([shell | {"z": [-20, 1]}, *contacts], [cup, *tongue, PLATE])
    assert not found.is_pin
    assert found.is_divided
