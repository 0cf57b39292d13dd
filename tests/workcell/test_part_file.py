"""Files of parts: the built pieces keep the stated gap, and wrong files are refused."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.workcell.outline import read_outline, signed_area
from dovetail.workcell.part_file import read_pair
from dovetail.workcell.part_text import whole_part
from extras import need

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
NAMES = ("hexagon", "d_shaft", "keyed_plug")
SHORT = {
    "units": "mm",
    "outline": "hexagon 20",
    "length": 70,
    "depth": 20,
    "gap": 0.3,
}
LISTED = {
    "units": "mm",
    "gap": 0.2,
    "held": {
        "density": 1000,
        "shapes": [
            {"outline": "circle 10", "z": [-15, 40]},
            {"outline": "rectangle 20 10", "z": [40, 50], "at": [1, 2]},
        ],
    },
    "fixture": {
        "shapes": [
            {"outline": "square 60", "cutouts": ["circle 10.4"], "z": [-15, 0]},
            {"outline": "square 60", "z": [-20, -15]},
        ]
    },
}

need("shapely")


def pair_of(table):
    return read_pair(json.dumps(table))


def section(part, z):
    """Return the area of a part's pieces at a height, as a polygon of shapely."""
    shapely = need("shapely")
    areas = []
    for piece in part.primitives:
        corners = piece.corners()
        low, high = corners[:, 2].min(), corners[:, 2].max()
        if not low < z < high:
            continue
        below, above = corners[corners[:, 2] < z], corners[corners[:, 2] > z]
        if below.shape == above.shape:  # a prism: no rounding of what is between
            cut = below
        else:
            below, above = below[:, None], above[None]
            share = (z - below[..., 2:]) / (above[..., 2:] - below[..., 2:])
            cut = (below + share * (above - below)).reshape(-1, 3)
        areas.append(shapely.MultiPoint(cut[:, :2]).convex_hull)
    return shapely.union_all(areas, grid_size=1e-10)


def edges(line):
    """Yield the ends of a line's edges; rounding makes short ones at corners."""
    for a, b in pairwise(np.array(line.coords)):
        if np.linalg.norm(b - a) > 5e-4:
            yield a, b


def plug_of(pair):
    """Return the section of the held part as the fixture sees it."""
    shapely = need("shapely")
    seen = section(pair.held, -0.001)
    return shapely.transform(seen, lambda xy: xy * [1.0, -1.0])


@pytest.mark.parametrize("widened", [0.0, 1e-4, -1e-4])
@pytest.mark.parametrize("name", NAMES)
def test_the_gap_is_the_stated_one_everywhere(name, widened):
    shapely = need("shapely")
    pair = read_pair(whole_part(EXAMPLES / f"{name}.toml"))
    gap, plug = pair.gap + widened, plug_of(pair)
    socket = pair.make_fixture(widened)
    for z in (-0.0011, -pair.depth / 2, -pair.depth + 1e-5):
        solid = section(socket, z)
        # No point of the socket is nearer than the gap, and each edge has it.
        assert plug.distance(solid) == pytest.approx(gap, abs=1e-6)
        for a, b in edges(plug.exterior):
            edge = shapely.LineString([a + 0.45 * (b - a), a + 0.55 * (b - a)])
            assert edge.distance(solid) == pytest.approx(gap, abs=1e-6)
        # And from the socket's side: every point of its opening, corners apart.
        opening = max(solid.interiors, key=lambda line: line.length)
        for a, b in edges(opening):
            middle = shapely.Point((a + b) / 2.0)
            assert middle.distance(plug) == pytest.approx(gap, abs=1e-6)


def test_mujocos_own_distance_from_plug_to_socket_is_the_gap():
    import mujoco

    from dovetail.envs.registered import find_cell
    from dovetail.plants.mjcf import build_mjcf

    cell = find_cell("dovetail/Insert-v0", part=str(EXAMPLES / "keyed_plug.toml"))
    model = mujoco.MjModel.from_xml_string(build_mjcf(cell.loaded_robot(), cell))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    tcp, turn = data.site_xpos[0], np.zeros(4)
    mujoco.mju_mat2Quat(turn, data.site_xmat[0])
    flip, hole = np.array([0.0, 1.0, 0.0, 0.0]), np.zeros(4)
    mujoco.mju_mulQuat(hole, turn, flip)
    data.mocap_quat[0] = hole
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, np.array([0.0, 0.0, 1.0]), hole)
    data.mocap_pos[0] = tcp + 0.010 * out  # half way in
    mujoco.mj_forward(model, data)
    plug = [i for i in range(model.ngeom) if model.geom(i).name.startswith("plug")]
    walls = [i for i in range(model.ngeom) if model.geom(i).name.startswith("socket")]
    apart = min(
        mujoco.mj_geomDistance(model, data, i, j, 0.01, None)
        for i in plug
        for j in walls
    )
    assert apart == pytest.approx(0.0004, abs=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_the_chamfer_widens_the_mouth_by_45_degrees(name):
    pair = read_pair(whole_part(EXAMPLES / f"{name}.toml"))
    socket, plug = pair.make_fixture(0.0), plug_of(pair)
    for z in (-0.0008, -0.0004, -0.0001):
        apart = plug.distance(section(socket, z))
        assert apart == pytest.approx(pair.gap + 0.001 + z, abs=1e-6)


def test_the_plug_weighs_what_its_outline_says_and_ends_at_the_tcp():
    pair = read_pair(whole_part(EXAMPLES / "keyed_plug.toml"))
    mass = sum(piece.mass for piece in pair.held.primitives)
    assert mass == pytest.approx(1200 * (24 * 14 + 6 * 3) * 70 * 1e-9)
    corners = pair.held.corners
    assert corners[:, 2].max() == 0.0
    assert corners[:, 2].min() == pytest.approx(-0.070)
    assert corners[:, 1].min() == pytest.approx(-0.010)  # the key, seen from the tool
    assert pair.depth == pytest.approx(0.020)


def test_a_blind_socket_has_a_floor_and_a_through_one_none():
    blind, through = pair_of(SHORT), pair_of(SHORT | {"through": True})
    assert blind.make_fixture(0.0).corners[:, 2].min() == pytest.approx(-0.030)
    assert through.make_fixture(0.0).corners[:, 2].min() == pytest.approx(-0.020)


def test_a_plug_with_a_hole_goes_over_a_pin():
    pair = pair_of(SHORT | {"cutouts": ["circle 8"]})
    solid = section(pair.make_fixture(0.0), -0.010)
    assert plug_of(pair).distance(solid) == pytest.approx(0.0003, abs=1e-6)
    pin = min(solid.geoms, key=lambda area: area.area)
    plug = read_outline("o", "circle 8", 1e-3).outer
    assert pin.area < signed_area(plug)
    assert np.hypot(*np.array(pin.exterior.coords).T).max() == pytest.approx(
        0.0037, abs=3e-6
    )


def test_listed_shapes_become_boxes_cylinders_and_convex_pieces():
    pair = pair_of(LISTED)
    kinds = [piece.kind for piece in pair.held.primitives]
    assert kinds == ["cylinder", "box"]
    assert pair.held.primitives[0].size == pytest.approx((0.005, 0.0275))
    mass = sum(piece.mass for piece in pair.held.primitives)
    assert mass == pytest.approx(1000 * (np.pi * 25 * 55 + 2000) * 1e-9)
    fixture = pair.make_fixture(0.0)
    assert {piece.kind for piece in fixture.primitives} == {"convex", "box"}
    wide, narrow = (
        section(pair.make_fixture(w), -0.01).area for w in (-0.0001, 0.0001)
    )
    assert wide - narrow == pytest.approx((240 + np.pi * 10.4) * 2e-7, rel=0.02)
    assert pair.depth == pytest.approx(0.015)
    inches = LISTED | {"units": "inch"}
    with pytest.raises(ConfigError, match=r"units right|allowed"):
        pair_of(inches)


def test_corners_give_a_hull_that_a_twin_makes_thinner():
    corners = [[x, y, z] for x in (5, 15) for y in (-5, 5) for z in (-15, 0)]
    slope = [*corners[:4], [20, -5, -15], [20, 5, -15]]
    table = LISTED | {"fixture": {"shapes": [{"corners": corners}]}}
    piece = pair_of(table).make_fixture(0.0001).corners
    np.testing.assert_allclose(piece.min(axis=0), [0.0051, -0.0049, -0.015], atol=1e-9)
    np.testing.assert_allclose(piece.max(axis=0), [0.0149, 0.0049, 0.0], atol=1e-9)
    table = LISTED | {"fixture": {"shapes": [{"corners": slope}]}}
    # At each height a slope of 45 degrees is nearer by the distance, as the wall is.
    less = pair_of(table).make_fixture(0.0001).corners
    np.testing.assert_allclose(less.min(axis=0), [0.0051, -0.0049, -0.015], atol=1e-9)
    np.testing.assert_allclose(less.max(axis=0), [0.0199, 0.0049, -0.0002], atol=1e-9)
    with pytest.raises(ConfigError, match="leaves nothing"):
        pair_of(table).make_fixture(0.006)


def write(folder, **files):
    for name, text in files.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


ONE = 'units = "mm"\nshapes = [{ outline = "hexagon 10", z = [-9, 40] }]\n'
PAIR = 'units = "mm"\nheld = "one.toml"\nfixture = "two.toml"\ngap = 0.2\n'
TWO = """units = "cm"
[[shapes]]
outline = "square 4"
cutouts = ["hexagon 1.04"]
z = [-1, 0]
"""


def test_a_pair_may_name_two_files_and_its_text_names_none(tmp_path):
    folder = write(tmp_path, pair=PAIR, one=ONE, two=TWO)
    text = whole_part(folder / "pair.toml")
    assert ".toml" not in text
    pair = read_pair(text)
    assert pair.name == "pair"
    assert pair.make_fixture(0.0).corners[:, 0].max() == pytest.approx(0.02)
    assert whole_part(text) == text


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"pair": PAIR.replace("one", "pair"), "two": TWO}, "names itself: pair"),
        (
            {"pair": PAIR, "one": PAIR.replace("one", "pair"), "two": TWO},
            "names itself: pair.toml -> one.toml -> pair.toml",
        ),
        ({"pair": PAIR, "two": TWO}, "there is no part .*one.toml"),
        ({"pair": 'held = "a\\u0000b"'}, "cannot read the part"),
        ({"pair": "units = mm"}, "is not TOML"),
        ({"pair": "units = 'mm'\ngap = nan"}, "NaN or infinite"),
        ({"pair": "units = 2020-01-01"}, "date or a time"),
        ({"pair": "x = " + "[" * 100 + "]" * 100}, "is not TOML"),
        ({"pair": "# " + "x" * 400_000}, "has 40.* bytes; allowed"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused(tmp_path, files, words):
    folder = write(tmp_path, **files)
    with pytest.raises(ConfigError, match=words):
        read_pair(whole_part(folder / "pair.toml"))


def test_a_device_or_a_folder_is_no_part(tmp_path):
    for path in ("/dev/zero", tmp_path):
        with pytest.raises(ConfigError, match="cannot read the part"):
            whole_part(path)


def listed(part, **change):
    """Return the listed pair with something else in its first shape of a part."""
    table = json.loads(json.dumps(LISTED))
    table[part]["shapes"][0] |= change
    return table


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({k: v for k, v in SHORT.items() if k != "units"}, 'units is missing; .*"mm"'),
        (SHORT | {"units": "furlong"}, "units is 'furlong'; .*known: mm, cm, m, inch"),
        (SHORT | {"gab": 1}, "gab .did you mean gap"),
        (SHORT | {"gap": -0.1}, "gap is -0.0001 m; allowed: 0 to 0.01 m"),
        (SHORT | {"gap": "0.1 mm"}, "gap is '0.1 mm'; give a number"),
        (SHORT | {"gap": True}, "gap is 'True'; give a number"),
        (SHORT | {"depth": 200}, "depth is 0.2 m; allowed: 0.002 to 0.06 m"),
        (SHORT | {"chamfer": 11}, "chamfer is 0.011 m; allowed: 0 to 0.01 m"),
        (SHORT | {"density": 0.1}, "density is 0.1 kg/m3"),
        (SHORT | {"block": 20}, "block is 20 mm; the socket in it needs at least"),
        (SHORT | {"outline": [[0, 0], [1, 1], [1, 0], [0, 1]]}, "crosses itself"),
        (SHORT | {"outline": None}, "give a word"),
        (SHORT | {"cutouts": "circle 3"}, "give a list"),
        (SHORT | {"cutouts": ["circle 30"]}, "inside and apart"),
        (SHORT | {"name": "x" * 200}, "name is"),
        (SHORT | {"name": "\x1b[2J"}, "name is"),
        ({k: v for k, v in SHORT.items() if k != "gap"}, "gap is missing"),
        (LISTED | {"held": "/etc/passwd"}, "give a table with shapes"),
        (LISTED | {"outline": "hexagon 3"}, "unknown settings of a pair: outline"),
        ({k: v for k, v in LISTED.items() if k != "gap"}, "gap is missing"),
        ({"units": "mm", "shapes": []}, "the shapes of one part"),
        (LISTED | {"held": {"shapes": []}}, "0 shapes; give 1 to 500"),
        (LISTED | {"held": {"shapes": [{}] * 501}}, "501 shapes"),
        (LISTED | {"held": {"shapes": [3]}}, "held_0 is 3; give a table"),
        (listed("held", z=[5, -5]), "lowest and the highest height"),
        (listed("held", z=[5]), "held_0: shape z"),
        (listed("held", z=[5, float("inf")]), "no number of JSON"),
        (listed("held", z=["a", "b"]), "held_0: z is 'a'"),
        (listed("held", corners=[[0, 0, 0]]), "either an outline with z, or corners"),
        (listed("held", colour="red"), "unknown settings of shape: colour"),
        (listed("held", z=[5, 10]), "lowest point is at z = 5 mm"),
        (listed("fixture", turn_deg=400), "allowed: -360 to 360 deg"),
        (3, "give a table of settings"),
    ],
)
def test_a_wrong_definition_is_refused_and_says_what_to_write(table, words):
    with pytest.raises(ConfigError, match=words):
        pair_of(table).make_fixture(0.0)


def test_a_narrower_gap_than_none_is_refused():
    with pytest.raises(ConfigError, match=r"allowed is -0\.3 mm and more"):
        pair_of(SHORT).make_fixture(-0.00031)
