"""Load data that explain a gravity error are those that made it."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.missed_load import explain_by_load, load_torques
from dovetail.robots.robot import Payload

Q = np.array([0.2, 0.6, -0.1, -1.5, 0.3, 1.0, 0.4])
TURN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def loaded(mass, com):
    payload = Payload(mass=mass, com=np.array(com), inertia=0.01 * np.eye(3))
    robot = iiwa14()
    turned = replace(robot.geometry, flange_rotation=TURN)
    robot = replace(robot, geometry=turned)
    return robot.with_tool(payload, np.array([0.01, 0.02, 0.15]))


def gravity(robot):
    return np.asarray(robot.chain().gravity(Q))


def test_the_torque_of_a_load_is_the_chains():
    mass, com = 1.7, np.array([0.03, -0.02, 0.11])
    change = gravity(loaded(1.0 + mass, com)) - gravity(loaded(1.0, com))
    terms = load_torques(loaded(1.0, com), Q)
    np.testing.assert_allclose(terms @ [mass, *(mass * com)], change, atol=1e-9)


def test_a_mass_that_was_not_declared_is_found():
    declared, true = loaded(1.0, [0.0, 0.0, 0.05]), loaded(1.8, [0.01, 0.0, 0.08])
    error = gravity(true) - gravity(declared)
    load = explain_by_load(declared, Q, error, np.full(7, 0.05))
    assert load.explained > 0.999
    assert load.mass == pytest.approx(0.8, abs=0.03)
    # gravity does not tell where along itself the load hangs: its torques are the same
    again = load_torques(declared, Q) @ [load.mass, *load.moment]
    np.testing.assert_allclose(again, error, atol=0.05)


def test_without_an_error_nothing_is_missed():
    load = explain_by_load(loaded(1.0, [0, 0, 0.1]), Q, np.zeros(7), np.full(7, 0.1))
    assert load.mass == 0.0
    whole, com = load.total(1.0, np.array([0.0, 0.0, 0.1]))
    assert whole == 1.0
    np.testing.assert_allclose(com, [0.0, 0.0, 0.1])


def test_an_error_that_no_load_makes_is_not_explained():
    error = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0])
    error -= (
        load_torques(loaded(1.0, [0, 0, 0.1]), Q)
        @ np.linalg.lstsq(load_torques(loaded(1.0, [0, 0, 0.1]), Q), error, rcond=None)[
            0
        ]
    )
    load = explain_by_load(loaded(1.0, [0, 0, 0.1]), Q, error, np.full(7, 0.1))
    assert load.explained < 0.05
