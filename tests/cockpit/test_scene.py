"""Edges and faces that the page draws of a fixture."""

import mujoco
import numpy as np
import pytest

from dovetail.cockpit.scene import feature_edges, triangles
from dovetail.tasks.peg_in_hole.geometry import HoleBlock, Peg
from dovetail.workcell.parts import Part, Primitive
from extras import need

CLEARANCE = 0.0005


def length(edges):
    return np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum()


def test_a_box_has_its_twelve_edges():
    box = Part("box", (Primitive("box", "box", (0.01, 0.02, 0.03), np.zeros(3)),))
    edges, is_inner = feature_edges(box)
    assert length(edges) == pytest.approx(8 * (0.01 + 0.02 + 0.03))
    assert not is_inner.any()


def test_boxes_side_by_side_have_no_seam():
    halves = Part(
        "halves",
        tuple(
            Primitive(f"half{x}", "box", (0.01, 0.02, 0.03), np.array([x, 0.0, 0.0]))
            for x in (-0.01, 0.01)
        ),
    )
    edges, _ = feature_edges(halves)
    assert length(edges) == pytest.approx(8 * (0.02 + 0.02 + 0.03))


def test_a_square_hole_has_edges_outside_and_a_mouth():
    peg, block = Peg(shape="square"), HoleBlock()
    edges, is_inner = feature_edges(block.part(peg, CLEARANCE))
    side, outer = peg.width + 2 * CLEARANCE, block.width
    assert length(edges[is_inner]) == pytest.approx(8 * side + 4 * block.depth, rel=0.1)
    assert length(edges[~is_inner]) == pytest.approx(8 * outer + 4 * block.depth)
    mouth = np.abs(edges[is_inner][:, :, :2]).max(axis=2)
    np.testing.assert_allclose(mouth, side / 2.0, atol=outer / 32)


@pytest.mark.parametrize("shape", ["triangle", "round"])
def test_an_opening_of_another_shape_has_a_mouth_all_round(shape):
    peg = Peg(shape=shape)
    edges, is_inner = feature_edges(HoleBlock().part(peg, CLEARANCE))
    at_top = edges[is_inner & (edges[:, :, 2] > -1e-9).all(axis=1)].mean(axis=1)
    angle = np.sort(np.arctan2(at_top[:, 1], at_top[:, 0]))
    gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
    assert gaps.max() < 0.4
    assert (np.hypot(at_top[:, 0], at_top[:, 1]) > peg.inner_radius).all()


def test_faces_of_a_box_share_no_vertex():
    need("trimesh")
    xml = '<mujoco><worldbody><geom type="box" size="1 2 3"/></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    vertices, faces, is_smooth = triangles(mujoco, model, 0)
    assert len(vertices) == 3 * len(faces) == 36
    assert not is_smooth
