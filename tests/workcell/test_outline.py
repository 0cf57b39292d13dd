"""Outlines: words, points and SVG paths; offsets; convex pieces."""

import math

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.workcell.outline import CURVE, Outline, read_outline, signed_area
from extras import need

MM = 1e-3
KEYED = [[-8, -5], [8, -5], [8, 5], [2, 5], [2, 7], [-2, 7], [-2, 5], [-8, 5]]


def read(value, cutouts=()):
    return read_outline("outline", value, MM, cutouts)


@pytest.mark.parametrize(
    ("word", "sides"),
    [("triangle 12", 3), ("square 12", 4), ("hexagon 12", 6), ("polygon 7 12", 7)],
)
def test_a_word_is_a_regular_outline_of_that_width_across_flats(word, sides):
    line = read(word).outer
    after = np.roll(line, -1, axis=0)
    along = after - line
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert len(line) == sides
    np.testing.assert_allclose(np.einsum("ij,ij->i", normal, line), 0.006, atol=1e-15)
    assert normal[:, 0].max() == pytest.approx(1.0)  # a flat for the finger


def test_a_circle_is_at_most_the_tolerance_away_from_its_corners():
    line = read("circle 20").outer
    np.testing.assert_allclose(np.linalg.norm(line, axis=1), 0.010, atol=1e-15)
    middle = (line + np.roll(line, -1, axis=0)) / 2.0
    assert 0.010 - np.linalg.norm(middle, axis=1).min() <= CURVE


@pytest.mark.parametrize("turn", [0, 1])
@pytest.mark.parametrize("tilt", [0, 30])
def test_an_svg_arc_lies_on_its_ellipse(turn, tilt):
    # A half ellipse of 8 x 4 about the origin, its ends on the long axis.
    c, s = 8 * math.cos(math.radians(tilt)), 8 * math.sin(math.radians(tilt))
    line = read(f"M {c} {s} A 8 4 {tilt} 0 {turn} {-c} {-s} Z").outer / MM
    back = np.radians(tilt)
    x = np.cos(back) * line[:, 0] + np.sin(back) * line[:, 1]
    y = -np.sin(back) * line[:, 0] + np.cos(back) * line[:, 1]
    np.testing.assert_allclose((x / 8) ** 2 + (y / 4) ** 2, 1.0, atol=1e-9)
    assert (y >= -1e-9).all() if turn else (y <= 1e-9).all()
    area = math.pi * 8 * 4 / 2
    assert area * 0.98 < signed_area(line) < area


def test_svg_commands_draw_what_the_specification_says():
    square = read("M 0 0 L 10 0 L 10 10 L 0 10 Z").outer
    for same in ("M0,0H10V10H0Z", "m 0 0 h 10 v 10 h -10 z", "M0 0 10 0 10 10 0 10z"):
        np.testing.assert_array_equal(read(same).outer, square)
    # A cubic curve of a straight line's control points adds points of that line only.
    line = read("M 0 0 C 2 0 8 0 10 0 L 10 10 L 0 10 Z").outer
    assert signed_area(line) == pytest.approx(1e-4)
    # The area under a parabola with its control point at height h is 2/3 of w h / 2.
    curve = read("M 0 0 Q 5 6 10 0 Z").outer
    assert signed_area(curve) == pytest.approx(20e-6, rel=0.02)
    same = read("M 0 0 Q 5 6 10 0 T 20 0 L 20 -9 L 0 -9 Z").outer
    up, down = same[same[:, 1] > 0], same[(same[:, 1] < 0) & (same[:, 1] > -0.004)]
    assert len(up) == len(down)
    np.testing.assert_allclose(
        sorted(up[:, 1]), sorted(-down[:, 1]), atol=1e-15, err_msg="T mirrors"
    )


def test_further_lines_of_a_path_are_holes():
    need("shapely")
    outline = read("M 0 0 H 10 V 10 H 0 Z M 3 3 H 6 V 6 H 3 Z")
    (hole,) = outline.cutouts
    assert signed_area(hole) == pytest.approx(9e-6)


@pytest.mark.parametrize("value", ["hexagon 12", KEYED, "circle 16"])
@pytest.mark.parametrize("distance", [3e-4, 1e-3, -5e-4])
def test_an_offset_moves_every_edge_by_the_distance_and_none_else(value, distance):
    outline = read(value)
    moved = outline.offset(distance).outer
    along = np.roll(outline.outer, -1, axis=0) - outline.outer
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    apart = np.einsum("ij,ij->i", moved - outline.outer, normal)
    np.testing.assert_allclose(apart, distance, rtol=0, atol=1e-15)
    edges = np.roll(moved, -1, axis=0) - moved
    turn = along[:, 0] * edges[:, 1] - along[:, 1] * edges[:, 0]
    np.testing.assert_allclose(turn, 0.0, atol=1e-15)


@pytest.mark.parametrize("value", ["hexagon 12", KEYED, "circle 16"])
def test_convex_pieces_are_convex_and_fill_the_area_without_overlap(value, rng):
    shapely = need("shapely")
    from dovetail.workcell.sections import convex_pieces

    hole = read(value)
    square = 0.02 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    for outline in (hole, Outline(square, (hole.outer,))):
        pieces = convex_pieces(outline)
        area = shapely.Polygon(outline.outer, outline.cutouts)
        assert sum(map(signed_area, pieces)) == pytest.approx(area.area, rel=1e-12)
        for piece in map(shapely.Polygon, pieces):
            assert piece.convex_hull.area == pytest.approx(piece.area, rel=1e-9)
            assert piece.difference(area).area < 1e-15
    assert len(convex_pieces(read("hexagon 12"))) == 1


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([[0, 0], [4, 0], [4, 4], [2, -2]], r"crosses itself at \(.*\) mm"),
        ([[0, 0], [1, 1], [1, 0], [0, 1]], r"crosses itself at \(0.5, 0.5\) mm"),
        ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], r"crosses itself at \(2, 0\) mm"),
        ([[0, 0], [1, 0], [2, 0]], "area of 0 mm2"),
        ([[0, 0], [0.01, 0], [0, 0.01]], "area of 5e-05 mm2"),
        ([[0, 0], [1, 0]], "2 different corners"),
        ([[0, 0], [1, float("nan")], [0, 1]], "point 1 of outline"),
        ([[0, 0], [1, True], [0, 1]], "point 1 of outline"),
        ([[0, 0]] * 100_000, "100000 points; allowed: up to 1000"),
        ([[0, 0], [4000, 0], [0, 4000]], "units right"),
        ("hexagon", "width across flats"),
        ("hexagon 12 mm", "without a unit"),
        ("polygon 2 12", "number of sides"),
        ("circle -3", "its diameter"),
        ("blob 3", "known words: triangle"),
        ("M 0 0 L 1", "lacks a number for L"),
        ("M 0 0 L 1 x", "lacks a number"),
        ("M 0 0 L 9 0 A 5 5 0 2 0 0 9 Z", "lacks a number for A"),
        ("M 0 0 L 9e5 0 L 0 9e5 Z", "units right"),
        ("M 0 0 C 1e6 9e5 2 2 9 9 L 0 9 Z", "more than 1000 corners"),
        ("M 0 0 C 9e99 1e200 2 2 9 9 L 0 9 Z", "the number 9e99"),
        ("M 0 0 " + "L 1 1 L 2 2 " * 50_000, "characters; allowed"),
        ("M 0 0 " + "L 1 1 L 2 2 " * 5_000, "more than 1000 corners"),
        (12, "give a word"),
        ({"hexagon": 12}, "give a word"),
    ],
)
def test_what_is_no_outline_is_refused(value, words):
    with pytest.raises(ConfigError, match=words):
        read(value)


@pytest.mark.parametrize(
    "hole", ["square 14", "square 12", [[0, 0], [20, 0], [20, 1], [0, 1]]]
)
def test_a_hole_that_is_not_inside_is_refused(hole):
    need("shapely")
    with pytest.raises(ConfigError, match="must lie inside and apart"):
        read("square 12", [hole])


def test_cutouts_are_counted_while_they_are_read():
    with pytest.raises(ConfigError, match="corners; allowed: up to 1000"):
        read("square 12", ["square 1"] * 100_000)


def test_an_offset_that_closes_a_detail_says_where():
    with pytest.raises(ConfigError, match=r"at \(-?8, .*\) mm"):
        read(KEYED).offset(-0.006)
    with pytest.raises(ConfigError, match="sharper than 15 deg"):
        read([[0, 0], [100, 0], [100, 5]]).offset(0.001)
