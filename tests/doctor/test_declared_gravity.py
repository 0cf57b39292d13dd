"""The gravity error that is allowed is the largest inside the declared range."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.control.proven import DECLARED
from dovetail.doctor.gravity_error import allowed_gravity_error, check_missed
from dovetail.envs.registered import find_cell
from dovetail.robots.missed_load import load_torques
from dovetail.robots.robot import Payload

GRAVITY = np.array([0.0, 0.0, -9.81])
FLOOR = 0.05  # of the motor's torque


def missed(robot, q, *, mass, payload, residual):
    """What such an arm takes more than its model [Nm]."""
    scale = 1.0 + np.array(mass)
    scale[6] += payload / robot.links.mass[6]
    true = replace(robot, links=replace(robot.links, mass=robot.links.mass * scale))
    taken = true.chain(GRAVITY + residual).gravity(q)
    return np.asarray(taken) - np.asarray(robot.chain().gravity(q))


def configurations(robot, rng, count):
    for _ in range(count):
        yield rng.uniform(robot.limits.q_min, robot.limits.q_max)


def test_no_arm_inside_the_declared_range_misses_more(rng):
    robot = find_cell().loaded_robot()
    for q in configurations(robot, rng, 20):
        allowed = allowed_gravity_error(robot, q, DECLARED)
        for _ in range(100):
            error = missed(
                robot,
                q,
                mass=rng.choice([-0.2, 0.2], 7),
                payload=rng.uniform(-1.0, 1.0),
                residual=rng.choice([-1.0, 1.0], 3),
            )
            assert (np.abs(error) <= allowed + 1e-9).all()


@pytest.mark.parametrize(("joint", "side"), [(1, 1.0), (3, -1.0)])
def test_an_arm_with_every_error_at_its_largest_misses_as_much(joint, side):
    robot = find_cell().loaded_robot()
    q = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0])
    heavy = missed(
        robot, q, mass=(0.2,) * 7, payload=1.0, residual=np.array([side, 1.0, -1.0])
    )
    allowed = allowed_gravity_error(robot, q, DECLARED)
    assert abs(heavy[joint]) > 0.999 * allowed[joint]


def test_a_narrower_declaration_allows_less():
    robot = find_cell().loaded_robot()
    q = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.0, 0.0])
    usual = allowed_gravity_error(robot, q, DECLARED)
    exact = allowed_gravity_error(robot, q, DECLARED | {"payload_error": 0.0})
    assert exact[1] < usual[1] - 5.0  # 1 kg, 0.6 m from A2
    floor = FLOOR * np.asarray(robot.limits.tau_max)
    np.testing.assert_allclose(exact[4:], floor[4:])
    assert (usual >= floor).all()


@pytest.mark.parametrize(
    ("declared", "there", "status"),
    [
        (2.0, 0.4, "broken"),
        (2.0, 1.3, "ok"),
        (2.0, 2.0, "ok"),
        (2.0, 0.0, "ok"),  # light links may look so, too: said, and no more
        (5.0, 0.0, "broken"),  # no links within what is declared are as light
    ],
)
def test_a_declared_tool_that_is_not_there_is_found(declared, there, status, rng):
    com = np.array([0.0, 0.0, 0.08])
    tool = Payload(mass=declared, com=com, inertia=0.01 * np.eye(3))
    robot = replace(find_cell().robot, payload=tool)
    q = robot.posture("down")
    error = (there - tool.mass) * load_torques(robot, q) @ np.array([1.0, *com])
    error += rng.normal(0.0, 0.1, 7)
    found = check_missed(robot, q, error, np.full(7, 0.05), DECLARED)
    assert found.status == status
    assert ("bare flange" in found.detail) == (there == 0.0)
