"""Outline of what goes into an opening first."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from dovetail.poses import quat_about_z
from dovetail.workcell.end_outline import end_outline, hull_line, surface_points
from dovetail.workcell.outline import signed_area
from dovetail.workcell.parts import Part, Primitive
from dovetail.workcell.sections import is_convex


def test_the_hull_holds_every_point_and_has_no_dent(rng):
    points = rng.normal(size=(200, 2))
    line = hull_line(points)
    assert is_convex(line)
    assert signed_area(line) > 0.0
    along = np.roll(line, -1, axis=0) - line
    for point in points:
        beside = point - line
        left = along[:, 0] * beside[:, 1] - along[:, 1] * beside[:, 0]
        assert left.min() > -1e-9
    assert {tuple(p) for p in line} <= {tuple(p) for p in points}


@pytest.mark.parametrize("kind", ["box", "cylinder", "prism"])
def test_no_corner_is_lost_where_a_column_is_not_quite_straight(kind, rng):
    size = (0.01, 0.01, 0.02) if kind == "box" else (0.01, 0.02)
    quarter = np.sqrt(0.5)
    turns = [np.array([quarter, 0.0, quarter, 0.0]), quat_about_z(0.0)]
    turns += [turn / np.linalg.norm(turn) for turn in rng.normal(size=(10, 4))]
    for turn in turns:
        for place in rng.uniform(-0.05, 0.05, size=(10, 3)):
            shape = Primitive("one", kind, size, place, turn)
            points = surface_points(held(shape))[:, :2]
            area = signed_area(hull_line(points))
            assert area == pytest.approx(ConvexHull(points).volume, rel=1e-6)


def test_points_on_a_straight_side_are_no_corners():
    grid = np.stack(np.meshgrid(range(4), range(3)), axis=-1).reshape(-1, 2)
    line = hull_line(grid.astype(float))
    assert sorted(map(tuple, line)) == [(0, 0), (0, 2), (3, 0), (3, 2)]


def held(*primitives):
    return Part("held", primitives)


def test_only_the_end_counts_and_it_is_seen_from_above_the_fixture():
    # In the TCP's frame z points down, so that y turns its sign.
    end = Primitive("end", "box", (0.002, 0.001, 0.01), np.array([0.001, 0.003, -0.01]))
    wide = Primitive("top", "box", (0.02, 0.02, 0.01), np.array([0.0, 0.0, -0.03]))
    line = end_outline(held(end, wide), 0.0005)
    np.testing.assert_allclose(line.min(axis=0), [-0.0015, -0.0045])
    np.testing.assert_allclose(line.max(axis=0), [0.0035, -0.0015])
    assert signed_area(line) == pytest.approx(0.005 * 0.003)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_a_cylinder_is_round(angle):
    shape = Primitive(
        "pin",
        "cylinder",
        (0.004, 0.01),
        np.array([0.0, 0.0, -0.01]),
        quat_about_z(angle),
    )
    line = end_outline(held(shape), 0.0)
    np.testing.assert_allclose(np.hypot(*line.T), 0.004)
    assert signed_area(line) == pytest.approx(np.pi * 0.004**2, rel=0.01)
    points = surface_points(held(shape))
    np.testing.assert_allclose([points[:, 2].min(), points[:, 2].max()], [-0.02, 0.0])


@pytest.mark.parametrize(
    "lowest",
    [[(0, 0)], [(0, -4), (0, 4)]],
    ids=["a point", "an edge"],
)
def test_an_end_without_an_area_is_as_wide_as_what_follows(lowest):
    corners = [(x, y, 0.0) for x, y in lowest]
    corners += [(x, y, -15.0) for x in (-5, 5) for y in (-4, 4)]
    shape = Primitive("tip", "convex", tuple(1e-3 * np.ravel(corners)), np.zeros(3))
    line = end_outline(held(shape), 0.0002)
    np.testing.assert_allclose(line.max(axis=0), [0.0052, 0.0042])
    np.testing.assert_allclose(line.min(axis=0), [-0.0052, -0.0042])


def test_a_sharp_corner_of_the_end_is_no_refusal():
    corners = [(x, y, z) for x, y in ((0, 0), (20, 1), (20, -1)) for z in (0, -30)]
    shape = Primitive("blade", "convex", tuple(1e-3 * np.ravel(corners)), np.zeros(3))
    line = end_outline(held(shape), 0.0002)
    assert is_convex(line)
    assert line[:, 0].min() == pytest.approx(-0.0004)
