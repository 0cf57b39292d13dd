"""Gaps between sections whose distances are known."""

import numpy as np
import pytest

from extras import need

shapely = need("shapely")

from dovetail.meshes.gaps import Clearance, gaps_at  # noqa: E402


def square(side):
    half = side / 2.0
    return shapely.box(-half, -half, half, half)


def test_the_gap_of_a_square_is_that_on_each_side():
    around = square(0.040).difference(square(0.0106))
    found = Clearance(levels=(gaps_at(0.0, square(0.010), around),))
    assert found.quartiles == pytest.approx((3e-4,) * 3)
    level, at = found.tightest
    assert level.gaps[at] == pytest.approx(3e-4)
    assert np.abs(level.points).max() == pytest.approx(0.005)
    assert np.abs(level.walls).max() == pytest.approx(0.0053)


def test_a_shifted_plug_is_tightest_where_it_was_shifted_to():
    around = square(0.040).difference(square(0.0106))
    plug = shapely.transform(square(0.010), lambda xy: np.add(xy, [2e-4, 0.0]))
    level, at = Clearance(levels=(gaps_at(0.0, plug, around),)).tightest
    assert level.gaps[at] == pytest.approx(1e-4)
    assert level.points[at, 0] == pytest.approx(0.0052)


def test_the_outside_of_a_thin_cap_does_not_face_its_post():
    cap = square(0.012).difference(square(0.0104))
    found = gaps_at(0.0, cap, square(0.010))
    assert found.gaps.max() == pytest.approx(2e-4 * np.sqrt(2.0))


def test_what_is_inside_the_wall_counts_negative():
    around = square(0.040).difference(square(0.0098))
    found = gaps_at(0.0, square(0.010), around)
    assert np.median(found.gaps) == pytest.approx(-1e-4)


def test_a_plug_above_the_socket_has_no_gap():
    found = gaps_at(0.0, square(0.010), shapely.Polygon())
    assert not Clearance(levels=(found,)).is_measured
