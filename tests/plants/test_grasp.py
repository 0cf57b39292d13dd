"""A held part that is displaced in the fingers meets things where it really is."""

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.poses import UNMOVED, Pose, quat_from_vector
from plants.conftest import HOLE, start_above


def force_at(plant, height, grasp):
    plant.grasp(grasp)
    q = start_above(plant.robot, x=0.57, y=0.03, z=height)  # over the block's wall
    plant.reset(q, HOLE)
    plant.apply(np.zeros(7), 0.001)
    plant.apply(np.zeros(7), 0.001)
    return float(np.linalg.norm(plant.contact_force_peak()))


@pytest.mark.parametrize("peg", ["square", "triangle"])
def test_a_part_that_stands_out_further_touches_sooner(make, engine, peg):
    if engine == "bullet" and peg == "triangle":
        pytest.skip("PyBullet takes no prism")
    plant = make(find_cell(peg=peg))
    out = UNMOVED._replace(position=np.array([0.0, 0.0, 0.002]))
    back = UNMOVED._replace(position=np.array([0.0, 0.0, -0.002]))
    assert force_at(plant, 0.101, UNMOVED) == 0.0
    assert force_at(plant, 0.101, out) > 1.0
    assert force_at(plant, 0.101, UNMOVED) == 0.0
    assert force_at(plant, 0.0995, UNMOVED) > 1.0
    assert force_at(plant, 0.0995, back) == 0.0


def test_a_turned_part_touches_with_its_corner(make):
    plant = make()
    turn = Pose(np.zeros(3), quat_from_vector(np.array([0.1, 0.0, 0.0])))
    lower = 0.015 * np.sin(0.1)  # of an edge of the square peg [m]
    assert force_at(plant, 0.1 + lower + 0.0003, turn) == 0.0
    assert force_at(plant, 0.1 + lower - 0.0007, turn) > 1.0


def test_the_tool_frame_and_the_payload_stay(make):
    plant = make()
    q = start_above(plant.robot, z=0.2)
    plant.reset(q, HOLE)
    before, still = plant.tool_pose(), plant.cell.payload()
    plant.grasp(UNMOVED._replace(position=np.array([0.002, 0.0, 0.0])))
    plant.reset(q, HOLE)
    np.testing.assert_allclose(plant.tool_pose().position, before.position, atol=1e-12)
    assert plant.cell.payload().mass == still.mass
