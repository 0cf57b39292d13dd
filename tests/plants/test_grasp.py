"""A held part that is displaced in the fingers meets things where it really is."""

from dataclasses import replace

import numpy as np

from dovetail.envs.registered import find_cell
from dovetail.poses import UNMOVED, Pose, quat_from_vector
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, Primitive
from plants.conftest import HOLE, start_above


def force_at(plant, height, grasp):
    plant.grasp(grasp)
    q = start_above(plant.robot, x=0.57, y=0.03, z=height)  # over the block's wall
    plant.reset(q, HOLE)
    forces = []
    for _ in range(2):
        plant.apply(np.zeros(7), 0.001)
        forces.append(float(np.linalg.norm(plant.contact_force_peak())))
    return max(forces)


def test_a_part_that_stands_out_further_touches_sooner(make, engine):
    out = UNMOVED._replace(position=np.array([0.0, 0.0, 0.002]))
    back = UNMOVED._replace(position=np.array([0.0, 0.0, -0.002]))
    # A triangular peg is a mesh, which PyBullet refuses (test_plant_contract.py).
    for peg in ("square",) if engine == "bullet" else ("square", "triangle"):
        plant = make(find_cell(peg=peg))
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


def test_what_moves_on_the_part_is_displaced_with_it(make):
    nose = Primitive("nose", "box", (0.01, 0.01, 0.005), np.array([0.0, 0.0, 0.005]))
    joint = Joint(name="nose", kind="slide", axis=[0, 0, 1.0], range=(-0.001, 0.001))
    cell = find_cell()
    moving = (Moving(joint, (nose._replace(mass=0.02),)),)
    plant = make(replace(cell, held=replace(cell.held, moving=moving)))
    out = UNMOVED._replace(position=np.array([0.0, 0.0, 0.002]))
    for height, grasp in ((0.112, out), (0.110, UNMOVED)):  # the nose is 10 mm long
        assert force_at(plant, height + 0.0005, grasp) == 0.0
        assert force_at(plant, height - 0.0010, grasp) > 0.0
