"""Geometry of peg, hole and tool, from one set of numbers."""

import numpy as np
import pytest

from dovetail.errors import ConfigError
from dovetail.plants.mjcf import build_mjcf
from dovetail.poses import matrix_from_quat
from dovetail.scene import PEG_SHAPES, SceneConfig


def solid_at(scene, point):
    """Say whether a point in the hole frame [m] lies inside a part of the block."""
    for part in scene.block_primitives():
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
    scene = SceneConfig(peg=peg, clearance=clearance)
    edge = scene.inner_radius + clearance
    # 36 flats stand for the circle: their corners are 0.4 % further out.
    beyond = 1.006 if peg == "round" else 1.001
    for z in (-0.001, -0.015, -0.0299):
        for x, y in outline(peg, edge):
            assert not solid_at(scene, np.array([0.999 * x, 0.999 * y, z]))
            assert solid_at(scene, np.array([beyond * x, beyond * y, z]))


def test_hole_goes_through_unless_it_is_given_a_floor():
    assert not solid_at(SceneConfig(), np.array([0.0, 0.0, -0.031]))
    assert solid_at(SceneConfig(floor_thickness=0.01), np.array([0.0, 0.0, -0.031]))


def test_hole_has_no_lid():
    scene = SceneConfig(floor_thickness=0.01)
    assert not solid_at(scene, np.array([0.0, 0.0, -0.029]))
    assert not solid_at(scene, np.array([0.03, 0.0, 0.0005]))


@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_chamfer_widens_the_mouth_by_45_degrees_and_nothing_below(peg):
    scene = SceneConfig(peg=peg, chamfer=0.002)
    edge = scene.inner_radius + scene.clearance
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
    scene = SceneConfig()
    peg = 2700.0 * 0.030**2 * 0.070
    payload = scene.payload()
    assert payload.mass == pytest.approx(1.2 + peg)
    assert 0.03 < payload.com[2] < 0.10
    np.testing.assert_allclose(payload.com[:2], 0.0, atol=1e-12)


def test_tool_frame_is_the_pegs_end():
    scene = SceneConfig()
    robot = scene.robot()
    peg = scene.peg_primitive()
    end = peg.position[2] + peg.size[-1]
    assert end == pytest.approx(robot.tool_position[2])
    tool = robot.tool_pose(np.zeros(7))
    assert tool.position[2] == pytest.approx(1.306 + 0.180)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("peg", "star", "square, triangle, round"),
        ("clearance", -0.0001, "clearance is -0.0001 m, allowed is 0 to 0.01 m"),
        ("peg_width", 0.2, "allowed is 0.005 to 0.06 m"),
        ("success_depth", 0.031, "allowed is 0.001 to 0.03"),
        ("clearance", float("nan"), "clearance is nan"),
        ("gripper_mass", 9.0, "gripper_mass is 9 kg, allowed is 0.2 to 5 kg"),
        ("clearance", "x", "clearance is 'x'; give a number from 0 to 0.01 m"),
    ],
)
def test_wrong_number_is_refused_with_the_allowed_range(field, value, words):
    with pytest.raises(ConfigError, match=words):
        SceneConfig(**{field: value})


def test_bullet_refuses_the_triangle_and_says_what_works():
    from dovetail.plants.bullet_plant import BulletPlant

    with pytest.raises(ConfigError, match="use plant 'mujoco', or peg 'square'"):
        BulletPlant(SceneConfig(peg="triangle"))


@pytest.mark.parametrize("visual_meshes", [False, True])
@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_only_the_tool_collides_and_only_with_block_and_table(peg, visual_meshes):
    import mujoco

    scene = SceneConfig(peg=peg)
    text = build_mjcf(scene.robot(), scene, visual_meshes=visual_meshes)
    model = mujoco.MjModel.from_xml_string(text)
    tool = {"gripper", "finger_left", "finger_right", "peg"}
    for i in range(model.ngeom):
        geom = model.geom(i)
        world = geom.name.startswith(("table", "floor", "wall"))
        assert geom.contype[0] == (geom.name in tool)
        assert geom.conaffinity[0] == world
