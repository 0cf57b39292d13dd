"""Fixtures in figures: an opening, a post, a floor and a pin, from above and aside."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from dovetail import Primitive
from dovetail.evaluation.fixture_figure import draw_from_above, draw_from_side
from dovetail.tasks.gear_mesh.task import GearMesh
from dovetail.tasks.insert.task import Insert
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, Part

CAP = {
    "name": "cap",
    "units": "mm",
    "gap": 0.2,
    "held": {
        "density": 1200,
        "shapes": [
            {"outline": "circle 16", "cutouts": ["circle 10.4"], "z": [-15, 5]},
            {"outline": "circle 16", "z": [5, 40]},
        ],
    },
    "fixture": {
        "shapes": [
            {"outline": "circle 10", "z": [-20, 0]},
            {"outline": "square 40", "z": [-30, -20]},
        ]
    },
}


def layers(draw, fixture):
    """Return what is behind and what is cut, each as a function of a place [mm]."""
    axes = Figure().subplots()
    draw([axes], fixture)
    assert len(axes.collections) == 4
    return [
        lambda x, y, drawn=drawn: any(
            path.contains_point((x, y)) for path in drawn.get_paths()
        )
        for drawn in axes.collections[1::2]
    ]


def test_an_opening_is_left_out_of_the_section():
    behind, cut = layers(draw_from_above, PegInHole().fixture(0.0))
    assert cut(30.0, 30.0)
    assert not cut(0.0, 0.0)
    assert not behind(0.0, 0.0)  # no floor
    behind, cut = layers(draw_from_side, PegInHole().fixture(0.0))
    assert cut(30.0, -10.0)
    assert behind(0.0, -10.0)
    assert not cut(0.0, -10.0)
    assert not behind(0.0, 10.0)


def test_a_post_is_filled_and_its_base_lies_behind():
    fixture = Insert(part=json.dumps(CAP)).fixture(0.0)
    behind, cut = layers(draw_from_above, fixture)
    assert cut(0.0, 0.0)
    assert not cut(10.0, 0.0)
    assert behind(15.0, 15.0)
    _, cut = layers(draw_from_side, fixture)
    assert cut(0.0, -10.0)
    assert cut(18.0, -25.0)
    assert not cut(18.0, -10.0)


def test_a_task_without_an_opening_is_drawn():
    _, cut = layers(draw_from_above, GearMesh().fixture(0.0))
    assert cut(0.0, 0.0)  # the pin


def test_what_moves_is_drawn_where_it_starts():
    joint = Joint(
        name="drawer",
        kind="slide",
        axis=np.array([1.0, 0.0, 0.0]),
        origin=np.zeros(3),
        range=(0.0, 0.05),
        start=0.03,
    )
    base = Primitive("base", "box", (0.01, 0.01, 0.01), np.array([0.0, 0.0, -0.02]))
    block = Primitive("block", "box", (0.01,) * 3, np.zeros(3), mass=0.1)
    fixture = Part("drawer", (base,), (Moving(joint, (block,)),))
    for draw in (draw_from_above, draw_from_side):
        _, cut = layers(draw, fixture)
        assert cut(30.0, -2.0)
        assert not cut(0.0, -2.0)


def test_a_lying_cylinder_is_seen_whole():
    lying = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # along x
    bar = Primitive("bar", "cylinder", (0.01, 0.02), np.array([0.01, 0.0, 0.0]), lying)
    behind, cut = layers(draw_from_above, Part("bar", (bar,)))
    for x in (-9.5, 29.5):
        for y in (-9.5, 9.5):
            assert behind(x, y)
    assert cut(29.5, 9.5)


def test_what_the_plane_does_not_meet_is_only_seen():
    low = Primitive("low", "box", (0.01, 0.01, 0.005), np.array([0.0, 0.03, -0.02]))
    for draw, y in ((draw_from_above, 30.0), (draw_from_side, -20.0)):
        behind, cut = layers(draw, Part("low", (low,)))
        assert behind(0.0, y)
        assert not cut(0.0, y)


@pytest.mark.parametrize(
    ("draw", "place"), [(draw_from_above, (7, 2)), (draw_from_side, (7, 5))]
)
def test_axes_are_not_mirrored(draw, place):
    box = Primitive("box", "box", (0.001, 0.001, 0.001), 1e-3 * np.array([7, 2, 5]))
    behind, _ = layers(draw, Part("box", (box,)))
    assert behind(*place)
    assert not behind(-place[0], place[1])
    assert not behind(place[0], -place[1])
