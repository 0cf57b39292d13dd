"""Places to hold a plug, on pairs whose answer is known."""

import numpy as np
import pytest

from extras import need

trimesh = need("trimesh")
need("shapely")

from dovetail.meshes.hold import find_hold  # noqa: E402
from dovetail.meshes.slices import Slicer  # noqa: E402

DEPTH = 0.020


def block(low, high):
    """A box from one corner to the other [mm]."""
    low, high = 1e-3 * np.array(low, float), 1e-3 * np.array(high, float)
    box = trimesh.creation.box(high - low)
    box.apply_translation((low + high) / 2.0)
    return box


def shaft(diameter, low, high, sides=64):
    """A cylinder about z [mm]."""
    made = trimesh.creation.cylinder(
        5e-4 * diameter, height=1e-3 * (high - low), sections=sides
    )
    made.apply_translation([0.0, 0.0, 5e-4 * (low + high)])
    return made


def ring(inner, outer, low, high):
    made = trimesh.creation.annulus(
        5e-4 * inner, 5e-4 * outer, height=1e-3 * (high - low), sections=64
    )
    made.apply_translation([0.0, 0.0, 5e-4 * (low + high)])
    return made


def joined(*bodies):
    """Bodies that overlap or touch, as one list of triangles."""
    return trimesh.util.concatenate(bodies)


WIDE_PLATE = ring(10.4, 80.0, -20.0, 0.0)


def test_a_shaft_that_stands_out_is_held_by_its_upper_20_mm():
    hold = find_hold(shaft(10.0, -20.0, 40.0), WIDE_PLATE, DEPTH)
    assert hold.kind == "fingers"
    assert hold.reach == hold.bare == DEPTH
    assert hold.grip.width == pytest.approx(0.010, abs=1e-4)
    assert hold.grip.touching == pytest.approx(0.020, abs=1e-3)
    assert hold.grip.low == pytest.approx(0.020, abs=1e-6)
    assert np.allclose(hold.grip.middle, 0.0, atol=1e-4)


def test_fingers_close_across_the_flats_of_a_turned_bar():
    bar = block([-4, -15, -20], [4, 15, 40])
    turn = np.deg2rad(37.0)
    bar.apply_transform(trimesh.transformations.rotation_matrix(turn, [0, 0, 1]))
    grip = find_hold(bar, WIDE_PLATE, DEPTH).grip
    assert grip.width == pytest.approx(0.008, abs=1e-5)
    assert grip.turn == pytest.approx(turn, abs=1e-3)


def test_a_short_stand_is_held_by_as_much_as_there_is():
    """12 mm above a wide plate, with 1 mm of air: fingers reach 10 mm down."""
    grip = find_hold(shaft(10.0, -20.0, 12.0), WIDE_PLATE, DEPTH).grip
    assert grip.touching == pytest.approx(0.010, abs=1e-3)
    assert grip.low >= 0.001


def test_a_flush_shaft_needs_a_stalk():
    hold = find_hold(shaft(10.0, -20.0, 0.0), WIDE_PLATE, DEPTH)
    assert hold.kind == "stalk"
    assert hold.reach == DEPTH
    assert 0.0 < DEPTH - hold.bare < 0.005  # fingers alone: to a little above it
    assert hold.stalk.outline.area == pytest.approx(np.pi * 0.005**2, rel=0.1)
    assert hold.stalk.high - hold.stalk.neck == pytest.approx(0.020)


def test_a_sunk_shaft_has_a_stalk_that_stays_inside_the_hole():
    plug, plate = shaft(10.0, -30.0, -10.0), ring(10.4, 80.0, -30.0, 0.0)
    stalk = find_hold(plug, plate, 0.030).stalk
    assert stalk.neck > 0.0
    rim = Slicer(plate.vertices, plate.faces).at(-0.005)
    assert rim.area > 0.0
    assert stalk.outline.intersection(rim).area == 0.0


def test_a_cap_over_a_post_is_held_outside():
    """The post comes out above the cap; beside the cap there is room."""
    cap, post = ring(10.4, 20.0, -15.0, 0.0), shaft(10.0, -40.0, 10.0)
    hold = find_hold(cap, post, 0.015)
    assert hold.kind == "fingers"
    assert hold.grip.width == pytest.approx(0.020, abs=1e-4)


def test_a_cap_in_a_rim_over_a_post_has_a_hollow_stalk():
    cap = ring(10.4, 20.0, -15.0, 0.0)
    socket = joined(shaft(10.0, -20.0, 10.0), ring(20.4, 60.0, -20.0, 5.0))
    hold = find_hold(cap, socket, 0.020)
    assert hold.kind == "stalk"
    (hole,) = hold.stalk.outline.interiors
    assert np.hypot(*np.array(hole.coords).T).min() > 0.005
    assert all(np.hypot(*piece.mean(axis=0)) > 0.004 for piece in hold.stalk.pieces())


def test_a_thin_cap_in_a_rim_cannot_be_held_to_the_end():
    """Its wall of 0.6 mm is too thin for a stalk; fingers stop above the rim."""
    cap = ring(10.4, 11.6, -15.0, 0.0)
    socket = joined(shaft(10.0, -20.0, 10.0), ring(12.0, 60.0, -20.0, 5.0))
    hold = find_hold(cap, socket, 0.020)
    assert hold.kind == "none"
    assert hold.reach < hold.depth - 0.005
    assert hold.reach == hold.bare


def test_a_flange_is_held_and_not_the_shaft_below_it():
    """Fingers come from above: what is under a wider head is out of their reach."""
    plug = joined(shaft(10.0, -20.0, 30.0), shaft(24.0, 25.0, 30.0))
    grip = find_hold(plug, WIDE_PLATE, DEPTH).grip
    assert grip.width == pytest.approx(0.024, abs=2e-4)
    assert grip.touching == pytest.approx(0.005, abs=1e-3)


def test_a_wedge_is_not_held_by_faces_that_turn_it_away():
    """A triangle's corner is opposite the middle of a side, never of another corner."""
    hold = find_hold(shaft(20.0, -20.0, 40.0, sides=3), WIDE_PLATE, DEPTH)
    assert hold.grip is not None
    along = np.array([np.cos(hold.grip.turn), np.sin(hold.grip.turn)])
    corners = 0.010 * np.array(
        [[np.cos(a), np.sin(a)] for a in np.deg2rad([0, 120, 240])]
    )
    reach = corners @ along
    assert hold.grip.width == pytest.approx(np.ptp(reach), abs=1e-4)
    assert hold.grip.width == pytest.approx(0.015, abs=1e-4)


def test_a_plate_wider_than_the_stroke_is_not_between_the_fingers():
    plate = block([-60, -60, -20], [60, 60, 20])
    assert find_hold(plate, shaft(5.0, -60.0, -20.0), DEPTH).grip is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wall_beside_the_plug_turns_the_fingers(side):
    """A wall 7 mm beside a round shaft leaves no room for a finger of 12 mm there."""
    wall = block([12.0, -40.0, -20.0], [20.0, 40.0, 30.0])
    wall.vertices[:, 0] *= side
    grip = find_hold(shaft(10.0, -20.0, 25.0), joined(WIDE_PLATE, wall), DEPTH).grip
    assert grip.touching == pytest.approx(0.020, abs=1e-3)
    assert (side * grip.pads()[:, :, 0]).max() < 0.0111


def test_fingers_do_not_rest_on_the_socket():
    """Fingers of 20 mm from the mouth up would: they take less of it, 1 mm higher."""
    hold = find_hold(shaft(10.0, -20.0, 20.0), WIDE_PLATE, DEPTH)
    assert hold.kind == "fingers"
    assert hold.grip.low >= 0.001
