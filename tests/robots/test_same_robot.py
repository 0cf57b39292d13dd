"""Two robots are the same by their arrays, and what differs is named."""

from dataclasses import replace

import numpy as np

from dovetail.robots.fr3 import fr3
from dovetail.robots.iiwa14 import iiwa14
from dovetail.robots.robot_text import read_robot_text, write_robot_text
from dovetail.robots.same_robot import difference


def test_a_robot_is_the_same_after_its_way_through_a_text():
    for robot in (iiwa14(), fr3()):
        again = read_robot_text(write_robot_text(robot))
        assert difference(robot, again) == difference(again, robot) == ""


def test_names_and_rounding_make_no_other_robot():
    robot = iiwa14()
    speed = robot.limits.dq_max * (1.0 + 1e-12)
    other = replace(robot, name="other", limits=replace(robot.limits, dq_max=speed))
    assert difference(robot, other) == ""


def test_what_differs_is_named_with_both_values():
    robot = iiwa14()
    mass = np.array(robot.links.mass)
    mass[3] += 0.5
    other = replace(robot, links=replace(robot.links, mass=mass))
    here, there = robot.links.mass[3], mass[3]
    said = f"mass differ, for example mass[3] is {there:.6g} there and {here:.6g} here"
    assert difference(robot, other) == said
