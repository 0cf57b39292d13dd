"""The Franka Emika Panda: a Research 3 in shape, with limits and masses of its own."""

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.robots.fr3 import fr3
from dovetail.robots.panda import panda
from dovetail.workcell.tool import FRANKA_HAND

ROBOT = panda()


def test_its_shape_is_that_of_a_research_3():
    mine, other = ROBOT.geometry, fr3().geometry
    for name in mine.shapes:
        np.testing.assert_array_equal(vars(mine)[name], vars(other)[name])


def test_its_speed_limit_does_not_fall_but_its_torque_may_not_jump():
    assert np.isinf(ROBOT.limits.taper_brake).all()
    np.testing.assert_array_equal(ROBOT.limits.dtau_max, 1000.0)


def test_it_carries_the_franka_hand():
    assert find_cell(robot="panda").tool.name == FRANKA_HAND.name


def test_it_weighs_what_was_identified():
    assert ROBOT.links.mass.sum() + 0.629769 == pytest.approx(16.69, abs=0.01)
