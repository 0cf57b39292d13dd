"""Pairs whose numbers are known: what a conversion finds, and how exact it is."""

import json

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.meshes.exactness import PieceSections, exactness_of
from dovetail.meshes.pair import convert
from dovetail.meshes.part_folder import part_table, write_part
from dovetail.meshes.way import Gap, find_way
from dovetail.tasks.insert.task import Insert
from dovetail.workcell.part_file import read_pair
from dovetail.workcell.part_text import whole_part
from dovetail.workcell.parts import Part, Primitive, turned_box
from extras import need
from meshes.solids import bead, circle, cone, cut, mesh, prism, square, united

need("shapely")
need("trimesh")
need("manifold3d")


def hexagon(across):
    return circle(across / np.sqrt(3.0), sides=6)


def block(side=30.0, low=-15.0, high=0.0):
    return prism(square(side), low, high)


def round_pair():
    """A round plug in a plate, chords of both on the same angles."""
    plug = prism(circle(4.0), -12.0, 40.0)
    return plug, cut(block(low=-12.0), prism(circle(4.3), -13.0, 1.0))


def square_pair():
    """A square plug 0.05 mm over the floor of its hole."""
    plug = prism(square(8.0), -10.0, 40.0)
    return plug, cut(block(), prism(square(8.4), -10.05, 1.0))


def hexagon_pair():
    plug = prism(hexagon(12.0), -10.0, 40.0)
    return plug, cut(block(), prism(hexagon(12.4), -10.0, 1.0))


def stepped_pair():
    """A shaft with a shoulder that ends the way on an inner step."""
    plug = united(prism(circle(3.0), -14.0, 0.0), prism(circle(5.0), -6.0, 40.0))
    hole = united(prism(circle(3.2), -20.0, 1.0), prism(circle(5.2), -6.1, 1.0))
    return plug, cut(block(low=-14.0), hole)


def keyed_pair():
    """A shaft with a key, in a hub with a keyway."""
    shapely = need("shapely")
    shaft = circle(5.0).union(shapely.box(-1.0, 0.0, 1.0, 6.0))
    hub = circle(5.2).union(shapely.box(-1.2, 0.0, 1.2, 6.2))
    return prism(shaft, -10.0, 40.0), cut(block(), prism(hub, -20.0, 1.0))


def cone_pair():
    """A taper of 1 in 5, its gap 0.3 mm in the plane."""
    plug = united(cone(4.0, 6.0, -10.0, 0.0), prism(circle(6.0), 0.0, 40.0))
    hole = united(cone(4.3, 6.3, -10.0, 0.0), prism(circle(6.3), -0.0, 1.0))
    return plug, cut(block(low=-10.0), hole)


PAIRS = {  # gap, depth, is_through, way to the end [mm]
    round_pair: (0.3, 12.0, True, None),
    square_pair: (0.2, 10.0, False, 0.05),
    hexagon_pair: (0.2, 10.0, False, 0.0),
    stepped_pair: (0.2, 14.0, True, 0.1),
    keyed_pair: (0.2, 10.0, True, None),
    cone_pair: (0.3, 10.0, True, 1.5),
}


@pytest.fixture(scope="module", params=PAIRS, ids=lambda pair: pair.__name__)
def case(request):
    plug, socket = request.param()
    return convert(mesh(plug), mesh(socket, "socket")), PAIRS[request.param]


def test_gap_depth_and_end_of_the_way_are_the_pairs_own(case):
    found, (gap, depth, is_through, way) = case
    assert found.axis == "-z"
    assert found.gap.median == pytest.approx(1e-3 * gap, abs=5e-6)
    assert found.gap.least == pytest.approx(1e-3 * gap * np.cos(np.pi / 64), abs=5e-6)
    assert found.depth == pytest.approx(1e-3 * depth, abs=1e-6)
    assert found.mouth[2] == pytest.approx(0.0, abs=1e-6)
    assert found.is_through == is_through
    exact = found.exactness
    assert exact is not None
    ends = (exact.stop_mesh, exact.stop_pieces)
    if way is None:
        assert ends == (None, None)
    else:
        assert ends == pytest.approx([1e-3 * way] * 2, abs=6e-5)
    assert found.is_go, found.reasons


def test_the_pieces_clearance_is_the_meshes(case):
    found, _ = case
    assert found.exactness is not None
    assert -1e-5 < found.exactness.low <= found.exactness.high < 1e-5
    assert abs(found.exactness.worst) < 2e-5
    assert found.pieces[0] <= 8
    assert found.pieces[1] <= 140


def slab(low, high):
    at, half = np.array([0.0, 0.0, (low + high) / 2.0]), (high - low) / 2.0
    return Primitive(f"slab{low}", "box", (0.01, 0.01, half), at)


@pytest.mark.parametrize("shift", [0.0, 1e-18, -1e-12])
def test_pieces_have_a_section_where_one_ends_and_the_next_begins(shift):
    middle = -(0.5**7)  # [m] exact in binary
    both = PieceSections(Part("two", (slab(2.0 * middle, middle), slab(middle, 0.0))))
    assert both.at(middle + shift).area == pytest.approx(0.02**2)


def test_where_pieces_are_missing_they_are_not_exact():
    whole = PieceSections(Part("plug", (slab(-0.01, 0.0),)))
    around = PieceSections(Part("socket", tuple(map(wall, range(4)))))
    gap = Gap(0.001, 0.001, 0.001, 0.001, np.zeros(3))
    exact = exactness_of((whole, around), (whole, around), gap)
    assert not exact.why_not()
    part = PieceSections(Part("plug", (slab(-0.01, -0.003),)))
    assert exactness_of((whole, around), (part, around), gap).why_not()


def wall(quarter):
    size, middle = (0.002, 0.015, 0.01), np.array([0.013, 0.0, -0.005])
    return turned_box(f"wall_{quarter}", size, middle, quarter * np.pi / 2.0)


def test_the_files_are_the_pair(case, tmp_path):
    found, _ = case
    file = write_part(found, tmp_path / "new" / "part")
    pair = read_pair(whole_part(file))
    assert pair.depth == pytest.approx(found.depth, abs=1e-7)
    assert pair.gap == pytest.approx(found.gap.median, abs=1e-7)
    counts = len(pair.held.primitives), len(pair.make_fixture(0.0).primitives)
    assert counts == found.pieces
    assert {one.name for one in file.parent.iterdir()} == {
        "part.toml",
        "plug.toml",
        "socket.toml",
    }
    Insert(part=str(file))


@pytest.mark.parametrize("widened", [5e-5, -5e-5])
def test_a_twins_offset_widens_the_gap_of_sections(case, widened):
    found, (gap, *_) = case
    shapely = need("shapely")
    pair = read_pair(json.dumps(part_table(found)))
    z = -found.depth / 2.0
    plug = shapely.union_all(
        [one.polygon(z) for one in found.held if one.low < z < one.high]
    )
    gaps = []
    for offset in (0.0, widened):
        hole = PieceSections(pair.make_fixture(offset)).at(z)
        gaps.append(plug.distance(hole))
    assert gaps[0] == pytest.approx(1e-3 * gap, abs=2e-5)
    assert gaps[1] - gaps[0] == pytest.approx(widened, abs=2e-6)


@pytest.mark.parametrize("axis", ["+z", "-x", "+y"])
def test_another_way_in_is_found(axis):
    plug, socket = square_pair()
    turn = {
        "+z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
        "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        "+y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    }[axis]
    both = []
    for body, name in ((plug, "plug"), (socket, "socket")):
        one = mesh(body, name)
        both.append(one._replace(vertices=one.vertices @ np.array(turn, float).T))
    found = convert(*both)
    assert found.axis == axis
    for one in both:
        back = [found.in_files(place) for place in found.in_part(one).vertices]
        np.testing.assert_allclose(back, one.vertices, atol=1e-12)
    assert found.depth == pytest.approx(0.010, abs=1e-6)
    assert found.is_go, found.reasons


def test_a_plug_larger_than_its_socket_is_refused():
    _, socket = square_pair()
    plug = prism(square(8.6), -10.0, 40.0)
    with pytest.raises(ConfigError) as error:
        convert(mesh(plug), mesh(socket))
    assert error.value.unit == "m2"
    # A frame 0.1 mm wide about 8.5 mm.
    assert error.value.value == pytest.approx(4 * 0.1 * 8.5e-6, rel=0.05)


def test_a_face_that_is_a_little_in_the_socket_is_cut_back_and_said():
    _, socket = square_pair()
    rib = prism(square(1.0, x=3.72), -0.5, 0)  # 0.02 mm in a wall, at the end alone
    found = convert(mesh(united(prism(square(8.0), -10.0, 40.0), rib)), mesh(socket))
    assert any("cut back" in note for note in found.plug.notes)
    assert not found.is_through
    assert found.is_go, found.reasons


def test_a_rib_that_is_pressed_along_a_wall_is_no_go():
    _, socket = square_pair()
    rib = prism(square(1.0, x=3.72), -9.0, 0)
    found = convert(mesh(united(prism(square(8.0), -10.0, 40.0), rib)), mesh(socket))
    assert not found.is_go
    assert "press fit" in " ".join(found.reasons)


@pytest.mark.parametrize("side", [8.4, 8.43])
def test_a_press_fit_is_no_go(side):
    _, socket = square_pair()
    found = convert(mesh(prism(square(side), -10.0, 40.0)), mesh(socket))
    assert not found.is_go
    assert not found.is_through
    assert "press fit" in " ".join(found.reasons)


def test_parts_that_are_far_from_one_another_are_refused():
    plug, socket = square_pair()
    plug.apply_translation([100.0, 0.0, 0.0])
    with pytest.raises(ConfigError, match="common frame"):
        convert(mesh(plug), mesh(socket))


def test_an_undercut_does_not_go_in_straight():
    plug = united(prism(circle(5.0), -10.0, -8.0), prism(circle(3.0), -10.0, 40.0))
    hole = united(prism(circle(5.3), -10.5, -7.5), prism(circle(3.3), -11.0, 1.0))
    both = mesh(plug), mesh(cut(block(), hole))
    with pytest.raises(ConfigError, match="undercut") as error:
        convert(*both)
    assert isinstance(error.value.value, float)
    assert error.value.value > 1e-6
    with pytest.raises(ConfigError, match="undercut"):
        convert(*both, axis="-z")


@pytest.mark.parametrize("z", [-8.2, -7.9, -7.6, -7.3, -7.0])
def test_a_bead_that_snaps_in_is_seen_between_two_sections(z):
    """It stands out by 0.4 mm over 0.8 mm of height: sections are 1.5 mm apart."""
    plug = united(prism(circle(6.0), -15, 20), bead(6.0, 0.4, z))
    block = cut(prism(square(24), -19, 0), prism(circle(6.2), -15, 1))
    socket = cut(block, bead(6.2, 0.5, z))
    with pytest.raises(ConfigError, match="undercut"):
        find_way(mesh(plug), mesh(socket))


def test_a_groove_of_the_plug_is_no_undercut():
    plug = cut(
        prism(circle(6.0), -15, 20),
        cut(prism(circle(7), -8, -7), prism(circle(5), -9, -6)),
    )
    socket = cut(prism(square(24), -19, 0), prism(circle(6.2), -15, 1))
    assert convert(mesh(plug), mesh(socket)).reasons == ()


@pytest.mark.parametrize("area", [circle(5), square(10)], ids=["round", "square"])
def test_a_plug_that_stands_on_its_socket_does_not_mate(area):
    """Each part from its own origin: no way in along the socket's top is found."""
    hole = area.buffer(0.2, join_style="mitre")
    socket = cut(prism(square(30), -25, 0), prism(hole, -20, 1))
    with pytest.raises(ConfigError, match="not on it"):
        find_way(mesh(prism(area, 0, 40)), mesh(socket))


def test_a_pin_deep_in_a_tub_leads_the_plug():
    """Of 60 mm of common height 2 mm lead it: they are looked at, too."""
    plug = united(prism(circle(12.0), -58, 20), prism(circle(3.0), -60, -58))
    hole = united(prism(square(60.0), -58, 1), prism(circle(3.1), -60, 1))
    socket = cut(prism(square(80.0), -64, 0), hole)
    assert find_way(mesh(plug), mesh(socket)).axis == "-z"


def test_walls_that_are_too_far_away_are_not_called_an_overlap():
    socket = cut(prism(square(50), -20, 0), prism(square(27), -15, 1))
    with pytest.raises(ConfigError, match="free along -z"):
        find_way(mesh(prism(square(20), -15, 20)), mesh(socket))


def test_a_plug_that_is_flush_is_held_by_a_stalk_on_it():
    plug = prism(square(8.0), -10.0, 0.0)
    _, socket = square_pair()
    found = convert(mesh(plug), mesh(socket))
    stalk = found.stalk
    assert stalk is not None
    assert stalk.low == pytest.approx(0.0, abs=6e-5)
    assert stalk.high > 0.020
    inside = need("shapely").box(-4e-3, -4e-3, 4e-3, 4e-3)
    assert all(inside.contains(slab.polygon()) for slab in stalk.slabs())
    assert found.is_go, found.reasons


def test_a_ring_over_a_post_is_held_by_a_hollow_stalk():
    ring = prism(circle(8.0).difference(circle(4.2)), -10.0, 0.0)
    post = united(block(low=-20.0, high=-10.0), prism(circle(4.0), -10.0, 3.0))
    found = convert(mesh(ring), mesh(post))
    assert found.depth == pytest.approx(0.013, abs=1e-6)
    assert found.stalk is not None
    assert all(len(slab.cutouts) == 1 for slab in found.stalk.slabs())
    assert found.is_go, found.reasons


def test_a_floor_is_never_thin():
    """The plug cannot be pushed through a floor of 0.5 mm."""
    plug = prism(square(8.0), -10.0, 40.0)
    socket = cut(block(low=-10.5), prism(square(8.4), -10.0, 1.0))
    found = convert(mesh(plug), mesh(socket))
    assert min(slab.low for slab in found.fixture) < -0.0149


def test_a_plug_that_stands_in_the_floor_is_lifted_and_said():
    plug = prism(square(8.0), -10.0, 40.0)
    socket = cut(block(), prism(square(8.4), -9.96, 1.0))
    found = convert(mesh(plug), mesh(socket))
    assert found.depth == pytest.approx(0.00996, abs=1e-6)
    assert any("lifted" in note for note in found.plug.notes)
    assert found.is_go, found.reasons


def test_a_plug_that_stands_far_in_the_floor_is_refused():
    plug = prism(square(8.0), -10.0, 40.0)
    socket = cut(block(), prism(square(8.4), -9.0, 1.0))
    with pytest.raises(ConfigError) as error:
        convert(mesh(plug), mesh(socket))
    assert error.value.value == pytest.approx(64e-6, rel=0.01)


def test_a_hole_in_the_plug_that_nothing_comes_into_costs_no_piece():
    ring = square(8.0).difference(circle(2.0))
    _, socket = square_pair()
    found = convert(mesh(prism(ring, -10.0, 40.0)), mesh(socket))
    assert found.pieces[0] == 1
    assert found.is_go, found.reasons


def test_a_thin_rim_does_not_grow_into_the_hole():
    """Outside it is a steep cone: hulls across it would reach into the opening."""
    plug = prism(circle(3.0), -12.0, 40.0)
    body = cone(9.0, 3.6, -12.0, 0.0)
    found = convert(mesh(plug), mesh(cut(body, prism(circle(3.2), -13.0, 1.0))))
    assert found.exactness is not None
    assert abs(found.exactness.worst) < 2e-5
    assert found.is_go, found.reasons


def test_parts_are_refused_along_an_axis_that_is_not_there():
    both = (mesh(body) for body in square_pair())
    with pytest.raises(ConfigError) as error:
        convert(*both, axis="-w")
    assert error.value.name == "axis"


def test_a_plug_longer_than_the_tool_is_held_lower():
    _, socket = square_pair()
    found = convert(mesh(prism(square(8.0), -10.0, 105.0)), mesh(socket))
    assert found.held[-1].high == pytest.approx(0.100, abs=1e-5)
    assert found.is_go, found.reasons
