"""Narrow holes in MuJoCo: walls that hold, and pegs that go in."""

import mujoco
import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.poses import Pose, quat_about_z, rotation_error
from dovetail.tasks.peg_in_hole.geometry import PEG_SHAPES
from plants.conftest import HOLE, TOOL_DOWN, start_above

PERIODS = [0.005, 0.001]


def hold_and_push(plant, force, seconds, period):
    """Push at the tip [N], the other directions held by springs; return the offset."""
    chain = plant.robot.chain()
    start = plant.tool_pose().position
    held = np.where(force == 0.0, 3000.0, 0.0)
    for _ in range(round(seconds / period)):
        q, dq = plant.read()
        pose = plant.robot.tool_pose(q)
        pull = held * (start - pose.position)
        turn = 60.0 * rotation_error(TOOL_DOWN, pose.quat_wxyz)
        J = chain.jacobian(q)
        plant.apply(J.T @ np.array([*(force + pull), *turn]) - 10.0 * dq, period)
    return plant.tool_pose().position - HOLE.position


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("clearance", [0.00006, 0.0001, 0.0005, 0.004])
@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_wall_gives_less_than_the_clearance_under_30_newton(peg, clearance, period):
    plant = MujocoPlant(find_cell(peg=peg, clearance=clearance))
    # The +x side: a flat of square and round, the corner of the triangle.
    direction = np.array([-1.0 if peg == "triangle" else 1.0, 0.0, 0.0])
    plant.reset(start_above(plant.robot, z=0.085), HOLE)
    offset = hold_and_push(plant, 30.0 * direction, 1.0, period)
    deepest = -min(plant.data.contact.dist)
    assert deepest < min(10e-6, clearance)
    assert offset @ direction == pytest.approx(clearance, abs=1.2e-4 + 0.02 * clearance)
    assert -plant.contact_force() @ direction == pytest.approx(30.0, rel=0.05)


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("clearance", [0.00006, 0.0001, 0.0005, 0.004])
@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_peg_in_the_mouth_slides_through(peg, clearance, period):
    cell = find_cell(peg=peg, clearance=clearance)
    plant = MujocoPlant(cell)
    plant.reset(start_above(plant.robot, z=0.098), HOLE)
    offset = hold_and_push(plant, np.array([0.0, 0.0, -10.0]), 2.5, period)
    assert offset[2] < -0.028


@pytest.mark.parametrize("peg", PEG_SHAPES)
def test_peg_beside_the_hole_stays_outside(peg):
    plant = MujocoPlant(find_cell(peg=peg))
    plant.reset(start_above(plant.robot, x=0.603, z=0.102), HOLE)
    offset = hold_and_push(plant, np.array([0.0, 0.0, -30.0]), 0.5, 0.005)
    assert offset[2] > -0.003  # it may tilt into the mouth, no further


@pytest.mark.parametrize(
    "q",
    [
        "-.013018190238119863 .8148020342181752 .1286822056932067 "
        "-1.4962223170006386 -.11742544613845785 .8363924871545163 .04792525407900662",
        "-.012988047226513198 .8148605870926208 .1286515263289391 "
        "-1.496060960228245 -.11728021301249318 .836487982249839 .04804871189574627",
        "-.012874116246565545 .8147314011999303 .12854863722190416 "
        "-1.4961995279451141 -.11711536055003655 .8363009694513951 .04799201094764076",
    ],
)
def test_a_round_peg_that_touches_is_not_told_to_be_deep_in_the_wall(q):
    """MuJoCo's native collisions say 34.6 mm here: the arm was thrown."""
    plant = MujocoPlant(find_cell(peg="round"))
    q = np.array([float(angle) for angle in q.split()])
    plant.reset(q, Pose(np.array([0.6, 0.045, 0.1]), quat_about_z(0.1)))
    mujoco.mj_fwdPosition(plant.model, plant.data)
    assert -1e-3 < min(plant.data.contact.dist) < 0.0
    plant.model.opt.disableflags ^= int(mujoco.mjtDisableBit.mjDSBL_NATIVECCD)
    mujoco.mj_fwdPosition(plant.model, plant.data)
    assert min(plant.data.contact.dist) < -0.03  # else this test has lost its meaning
