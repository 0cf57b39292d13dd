"""Geometry of peg, hole and tool, from one set of numbers."""

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.mjcf import build_mjcf
from dovetail.poses import matrix_from_quat
from dovetail.tasks.peg_in_hole.geometry import PEG_SHAPES, HoleBlock, Peg
from dovetail.tasks.peg_in_hole.task import PegInHole

FLOOR = PegInHole(block=HoleBlock(floor_thickness=0.01))


def solid_at(scene, point):
    """Say whether a point in the hole frame [m] lies inside a part of the block."""
    for part in scene.fixture(0.0).primitives:
        local = matrix_from_quat(part.quat_wxyz).T @ (point - part.position)
        if np.all(np.abs(local) <= np.array(part.size)):
            return True
    return False


def outline(peg, radius):
    """Return points of the circle-, square- or triangle-shaped outline [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False) + 0.01
    if peg == "round":
        distance = np.full_like(angles, radius)
    else:
        count = 4 if peg == "square" else 3
        normals = 2.0 * np.pi * (np.arange(count) + 0.5 * (count == 3)) / count
        reach = np.cos(angles[:, None] - normals).max(axis=1)
        distance = radius / reach
    return np.stack([distance * np.cos(angles), distance * np.sin(angles)], axis=1)


@pytest.mark.parametrize("peg", PEG_SHAPES)
@pytest.mark.parametrize("clearance", [0.0, 0.0001, 0.0005, 0.004])
def test_hole_has_the_pegs_outline_plus_the_clearance(peg, clearance):
    scene = PegInHole(peg=peg, clearance=clearance)
    edge = Peg(shape=peg).inner_radius + clearance
    # 36 flats stand for the circle: their corners are 0.4 % further out.
    beyond = 1.006 if peg == "round" else 1.001
    for z in (-0.001, -0.015, -0.0299):
        for x, y in outline(peg, edge):
            assert not solid_at(scene, np.array([0.999 * x, 0.999 * y, z]))
            assert solid_at(scene, np.array([beyond * x, beyond * y, z]))


def test_hole_goes_through_unless_it_is_given_a_floor():
    assert not solid_at(PegInHole(), np.array([0.0, 0.0, -0.031]))
    assert solid_at(FLOOR, np.array([0.0, 0.0, -0.031]))


def test_hole_has_no_lid():
    scene = FLOOR
    assert not solid_at(scene, np.array([0.0, 0.0, -0.029]))
    assert not solid_at(scene, np.array([0.03, 0.0, 0.0005]))


@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_chamfer_widens_the_mouth_by_45_degrees_and_nothing_below(peg):
    scene = PegInHole(peg=peg, block=HoleBlock(chamfer=0.002))
    edge = Peg(shape=peg).inner_radius + scene.clearance
    angle = np.pi / 3 if peg == "triangle" else 0.0
    normal = np.array([np.cos(angle), np.sin(angle), 0.0])
    for depth in (0.0002, 0.0010, 0.0018):
        slope = edge + 0.002 - depth
        height = np.array([0.0, 0.0, -depth])
        assert not solid_at(scene, (slope - 1e-4) * normal + height)
        assert solid_at(scene, (slope + 1e-4) * normal + height)
    below = np.array([0.0, 0.0, -0.010])
    assert not solid_at(scene, (edge - 1e-5) * normal + below)
    assert solid_at(scene, (edge + 1e-5) * normal + below)


def test_payload_weighs_gripper_and_peg():
    peg = 2700.0 * 0.030**2 * 0.070
    payload = find_cell().payload()
    assert payload.mass == pytest.approx(1.2 + peg)
    assert 0.03 < payload.com[2] < 0.10
    np.testing.assert_allclose(payload.com[:2], 0.0, atol=1e-12)


def test_tool_frame_is_the_pegs_end():
    cell = find_cell()
    robot = cell.loaded_robot()
    peg = cell.tool_primitives()[-1]
    end = peg.position[2] + peg.size[-1]
    assert end == pytest.approx(robot.geometry.tool_position[2])
    tool = robot.tool_pose(np.zeros(7))
    assert tool.position[2] == pytest.approx(1.306 + 0.180)


@pytest.mark.parametrize(
    ("kind", "field", "value", "words"),
    [
        (PegInHole, "peg", "star", "square, triangle, round"),
        (PegInHole, "clearance", -0.0001, "is -0.0001 m; allowed: 0 to 0.01 m"),
        (Peg, "width", 0.2, "allowed: 0.005 to 0.06 m"),
        (HoleBlock, "success_depth", 0.031, "allowed: at most 0.03 m"),
        (HoleBlock, "chamfer", 0.016, "allowed: at most 0.015 m"),
        (PegInHole, "clearance", float("nan"), "clearance is nan"),
        (PegInHole, "clearance", "x", "clearance is .x., which is no number"),
    ],
)
def test_wrong_number_is_refused_with_the_allowed_range(kind, field, value, words):
    with pytest.raises(ConfigError, match=words):
        kind(**{field: value})


def test_bullet_refuses_the_triangle_and_says_what_works():
    from dovetail.plants.bullet_plant import BulletPlant

    with pytest.raises(ConfigError, match=r"prism 'peg' .* use plant 'mujoco', or"):
        BulletPlant(find_cell(peg="triangle"))


@pytest.mark.parametrize("visual_meshes", [False, True])
@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_only_the_tool_collides_and_only_with_block_and_table(peg, visual_meshes):
    import mujoco

    cell = find_cell(peg=peg)
    text = build_mjcf(cell.loaded_robot(), cell, visual_meshes=visual_meshes)
    model = mujoco.MjModel.from_xml_string(text)
    tool = {"gripper", "finger_left", "finger_right", "peg"}
    for i in range(model.ngeom):
        geom = model.geom(i)
        world = geom.name.startswith(("table", "floor", "wall"))
        assert geom.contype[0] == (geom.name in tool)
        assert geom.conaffinity[0] == world
