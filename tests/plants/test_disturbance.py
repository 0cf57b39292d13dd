"""Pushes and moved holes: the same on every plant, and through a twin."""

import numpy as np
import pytest
from encoder_plant import EncoderPlant

from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose

from .conftest import HOLE, Q_BENT, start_above

DT = 0.005


def shifted(x=0.0, y=0.0):
    return HOLE._replace(position=HOLE.position + np.array([x, y, 0.0]))


@pytest.mark.parametrize("force", [[20.0, 0, 0], [0, -20.0, 0], [3.0, -4.0, 12.0]])
def test_the_torque_that_holds_a_push_is_that_of_the_force_at_the_tcp(make, force):
    plant = make(damping=(0.0,) * 7)
    plant.reset(Q_BENT, HOLE)
    torque = plant.robot.chain().jacobian(Q_BENT)[:3].T @ force
    plant.push(np.array(force))
    plant.apply(-torque, 0.1)
    q, dq = plant.read()
    np.testing.assert_allclose(q, Q_BENT, atol=1e-6)
    np.testing.assert_allclose(dq, np.zeros(7), atol=1e-5)


def test_a_push_accelerates_as_its_torque_does(make):
    plant = make(damping=(0.0,) * 7)
    force = np.array([5.0, 10.0, -15.0])
    speeds = []
    for by_push in (True, False):
        plant.reset(Q_BENT, HOLE)
        plant.push(force * by_push)
        torque = plant.robot.chain().jacobian(Q_BENT)[:3].T @ force
        plant.apply(torque * (not by_push), 0.0025)
        speeds.append(plant.read()[1])
    assert np.abs(speeds[0]).max() > 1e-3
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=1e-3, atol=1e-6)


def test_a_push_lasts_until_the_next_and_reset_ends_it(make):
    plant = make()
    still = []
    for ending in ("push", "reset"):
        plant.reset(Q_BENT, HOLE)
        plant.push(np.array([0.0, 30.0, 0.0]))
        if ending == "push":
            plant.push(np.zeros(3))
        else:
            plant.reset(Q_BENT, HOLE)
        plant.apply(np.zeros(7), 0.05)
        still.append(np.abs(plant.read()[0] - Q_BENT).max())
    assert max(still) < 1e-6


def test_a_push_is_no_contact(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    plant.push(np.array([0.0, 30.0, 0.0]))
    plant.apply(np.zeros(7), 0.05)
    np.testing.assert_array_equal(plant.contact_force(), np.zeros(3))


def test_a_moved_hole_is_where_it_was_moved_to(make):
    plant = make()
    q = start_above(plant.robot, z=0.09)
    plant.reset(q, HOLE)  # 10 mm inside the hole, aligned: touches nothing
    plant.apply(np.zeros(7), 0.001)
    np.testing.assert_array_equal(plant.contact_force(), np.zeros(3))
    moved = shifted(x=0.001)
    plant.move_fixture(moved)
    plant.apply(np.zeros(7), 0.001)
    assert plant.contact_force()[0] > 1.0  # the wall at -x now pushes towards +x
    plant.reset(q, HOLE)
    plant.apply(np.zeros(7), 0.001)
    np.testing.assert_array_equal(plant.contact_force(), np.zeros(3))


def test_a_hole_that_moves_takes_the_peg_along(make):
    plant = make()
    q = start_above(plant.robot, z=0.09)
    plant.reset(q, HOLE)
    chain = plant.robot.chain()
    for i in range(400):  # 20 mm in one second, at the twentieth part of a millimetre
        hole = shifted(y=0.02 * i / 400)
        plant.move_fixture(hole)
        q_m, dq_m = plant.read()
        up = 0.09 - plant.tool_pose().position[2]
        wrench = np.array([0.0, 0.0, 1000.0 * up, 0.0, 0.0, 0.0])
        plant.apply(chain.jacobian(q_m).T @ wrench - 8.0 * dq_m, 0.0025)
    assert plant.tool_pose().position[1] == pytest.approx(0.02, abs=0.002)
    assert np.isfinite(plant.read()[0]).all()


def test_a_hole_out_of_reach_is_refused_and_stays(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    with pytest.raises(ConfigError, match="too far"):
        plant.move_fixture(HOLE._replace(position=np.array([3.0, 0.0, 0.1])))


@pytest.mark.parametrize("wrap", ["twin", "encoder"])
def test_wrappers_pass_pushes_and_holes_on(wrap, make):
    inner = make()
    if wrap == "twin":
        plant = make_twin(load_twin("easy"), find_cell(), engine="mujoco")
        plant.plant = inner
    else:
        plant = EncoderPlant(inner, DT)
    plant.reset(Q_BENT, HOLE)
    plant.push(np.array([0.0, 30.0, 0.0]))
    plant.move_fixture(Pose(np.array([0.61, 0.0, 0.1]), HOLE.quat_wxyz))
    plant.apply(np.zeros(7), 0.05)
    assert np.abs(inner.read()[0] - Q_BENT).max() > 1e-4
    assert inner.dynamics == DynamicsConfig()
