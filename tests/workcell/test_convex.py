"""A convex shape: its hull, mass, inertia, corners, and what engines make of it."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.mjcf import build_mjcf
from dovetail.poses import Pose, quat_about_z
from dovetail.workcell.hull import hull_faces, solid_of
from dovetail.workcell.parts import IDENTITY, Part, Primitive, unit_inertia

RADIUS, HEIGHT = 0.012, 0.05
QUAT = np.array([0.8, 0.36, -0.48, 0.0])


def hexagon(sides=6, at=(0.01, -0.02, 0.03)):
    """Return the corners of a regular prism about a point, shape (2 * sides, 3)."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    x, y = RADIUS * np.cos(angle), RADIUS * np.sin(angle)
    halves = [np.full(sides, z) for z in (-HEIGHT / 2, HEIGHT / 2)]
    return np.vstack([np.stack([x, y, z], axis=1) for z in halves]) + at


def convex(corners, mass=0.0, quat=IDENTITY, name="plug"):
    numbers = tuple(np.asarray(corners, dtype=float).ravel().tolist())
    return Primitive(name, "convex", numbers, np.zeros(3), quat, mass=mass)


@pytest.mark.parametrize("sides", [3, 4, 6, 36])
def test_volume_centre_and_inertia_of_a_regular_prism(sides):
    solid = solid_of(convex(hexagon(sides)).size)
    area = sides / 2.0 * RADIUS**2 * np.sin(2.0 * np.pi / sides)
    # Of a regular polygon: I = A / 2 * R^2 (2 + cos(2 pi / n)) / 6 about a diameter.
    across = RADIUS**2 * (2.0 + np.cos(2.0 * np.pi / sides)) / 12.0
    side = across + HEIGHT**2 / 12.0
    assert solid.volume == pytest.approx(area * HEIGHT, rel=1e-12)
    np.testing.assert_allclose(solid.centre, (0.01, -0.02, 0.03), rtol=0, atol=1e-14)
    expected = np.diag([side, side, 2.0 * across])
    np.testing.assert_allclose(solid.inertia, expected, rtol=0, atol=1e-14)


def test_points_inside_and_on_faces_change_nothing(rng):
    corners = hexagon()
    inner = rng.dirichlet(np.ones(len(corners)), 40) @ corners
    faces = corners[hull_faces(corners)].mean(axis=1)
    mixed = rng.permutation(np.vstack([corners, inner, faces, corners]))
    plain, more = solid_of(convex(corners).size), solid_of(convex(mixed).size)
    assert more.volume == pytest.approx(plain.volume, rel=1e-9)
    np.testing.assert_allclose(more.inertia, plain.inertia, rtol=0, atol=1e-12)


def test_hull_of_random_points_holds_them_all_and_is_closed(rng):
    for _ in range(20):
        points = rng.normal(size=(60, 3))
        faces = hull_faces(points)
        a, b, c = (points[faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        heights = np.einsum("fpk,fk->fp", points - a[:, None], normals)
        assert heights.max() < 1e-9
        edges = {(f[i], f[(i + 1) % 3]) for f in faces.tolist() for i in range(3)}
        assert len(edges) == 3 * len(faces)
        assert all((j, i) in edges for i, j in edges)


def test_a_box_and_the_convex_of_its_corners_weigh_the_same():
    size, at = (0.01, 0.02, 0.03), np.array([0.04, 0.05, -0.06])
    box = Primitive("box", "box", size, at, QUAT, mass=0.3)
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
    same = convex(signs * size, 0.3, QUAT)._replace(position=at)
    np.testing.assert_allclose(same.centre(), box.centre(), atol=1e-15)
    np.testing.assert_allclose(unit_inertia(same), unit_inertia(box), atol=1e-16)
    np.testing.assert_allclose(
        np.sort(same.corners(), axis=0), np.sort(box.corners(), axis=0), atol=1e-15
    )


def test_payload_counts_the_centre_of_mass_of_a_convex_and_not_its_origin():
    cell = find_cell()
    held = Part("plug", (convex(hexagon() - [0.0, 0.0, 0.1], mass=0.4),))
    payload = replace(cell, held=held).payload()
    tool = sum(p.mass * p.position for p in cell.tool.primitives)
    tcp = np.array([0.0, 0.0, cell.tool.length])
    turned = np.array([-0.01, 0.02, 0.03 - 0.1])  # half a turn on the flange
    expected = (tool + 0.4 * (tcp + turned)) / (1.2 + 0.4)
    assert payload.mass == pytest.approx(1.6)
    np.testing.assert_allclose(payload.com, expected, atol=1e-12)


def test_mujoco_builds_the_same_body(tmp_path):
    import mujoco

    corners = hexagon()
    cell = replace(find_cell(), held=Part("plug", (convex(corners, quat=QUAT),)))
    model = mujoco.MjModel.from_xml_string(build_mjcf(cell.loaded_robot(), cell))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom, mesh = model.geom("plug").id, model.mesh("plug").id
    begin, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = model.mesh_vert[begin : begin + count]
    built = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    tcp, turn = data.site_xpos[0], data.site_xmat[0].reshape(3, 3)
    (shape,) = cell.held.primitives
    expected = shape.corners() @ turn.T + tcp
    order = [np.lexsort(np.round(p, 6).T) for p in (built, expected)]
    np.testing.assert_allclose(built[order[0]], expected[order[1]], atol=1e-7)


def test_mujoco_finds_the_same_mass_and_inertia(rng):
    import mujoco

    corners = rng.normal(size=(30, 3)) * 0.01
    text = " ".join(map(str, corners.ravel()))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset><mesh name='m' vertex='{text}' inertia='exact'/></asset>"
        "<worldbody><body><freejoint/><geom type='mesh' mesh='m' density='2700'/>"
        "</body></worldbody></mujoco>"
    )
    solid = solid_of(convex(corners).size)
    mass = float(model.body_mass[1])
    assert mass == pytest.approx(2700 * solid.volume, rel=1e-5)
    np.testing.assert_allclose(model.body_ipos[1], solid.centre, atol=1e-8)
    np.testing.assert_allclose(
        np.sort(model.body_inertia[1]) / mass,
        np.linalg.eigvalsh(solid.inertia),
        rtol=1e-4,
    )


def test_bullet_refuses_a_convex_and_names_its_margin():
    from dovetail.plants.bullet_plant import BulletPlant

    cell = replace(find_cell(), held=Part("plug", (convex(hexagon()),)))
    with pytest.raises(ConfigError, match=r"convex 'plug' .* 1 mm margin"):
        BulletPlant(cell)


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ((0.0,) * 9, "has 9 numbers; .* at least four corners"),
        ((0.0,) * 13, "has 13 numbers"),
        ((0.0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1e-8), "is .* mm thick"),
        ((0.0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, float("nan")), "beyond 10 m"),
        ((0.0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 11.0), "beyond 10 m"),
    ],
)
def test_a_convex_that_no_engine_can_build_is_refused(size, words):
    with pytest.raises(ConfigError, match=words):
        Part("plug", (Primitive("p", "convex", size, np.zeros(3)),))


def test_lowest_corner_of_a_turned_convex_is_its_own():
    part = Part("plug", (convex(hexagon(at=(0.0, 0.0, 0.0)), quat=quat_about_z(0.3)),))
    assert part.corners.shape == (12, 3)
    assert part.corners[:, 2].min() == pytest.approx(-HEIGHT / 2)


def test_drake_builds_a_convex_and_feels_it_on_a_box():
    pytest.importorskip("pydrake")
    from dovetail.plants.drake_plant import DrakePlant

    cell = find_cell()
    corners = hexagon(at=(0.0, 0.0, -HEIGHT / 2))
    plug = Part("plug", (convex(corners, mass=0.1),))
    plate = Primitive("plate", "box", (0.05, 0.05, 0.01), np.array([0.0, 0.0, -0.01]))
    cell = replace(cell, held=plug, make_fixture=lambda _: Part("plate", (plate,)))
    plant = DrakePlant(cell)
    tool = cell.loaded_robot().tool_pose(q := cell.robot.posture("down"))
    below = Pose(tool.position - [0.0, 0.0, -0.0002], IDENTITY)
    plant.reset(q, below)
    plant.apply(np.zeros(7), 0.001)
    assert plant.contact_force()[2] > 1.0
    plant.reset(q, Pose(tool.position - [0.0, 0.0, 0.0002], IDENTITY))
    plant.apply(np.zeros(7), 0.001)
    assert plant.contact_force()[2] == 0.0
