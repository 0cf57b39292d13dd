"""A sprung latch at a lip: force to snap in and to pull off, by the wedge's statics."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail.envs.registered import find_cell
from dovetail.poses import rotation_error
from dovetail.tasks.rail_clip.din_rail import (
    OVERLAP,
    SHEET,
    SLOPE_IN,
    SLOPE_OUT,
    WIDTH,
    latch,
)
from dovetail.workcell.parts import Part, Primitive
from plants.conftest import HOLE, TOOL_DOWN, start_above
from wedge import snap_force

PERIOD = 0.005
SPEED = 0.008  # m/s


def snapping():
    """Return a cell with two latches, whose side forces cancel, over a sheet."""
    sheet = Primitive(
        "sheet",
        "box",
        (0.03, WIDTH / 2, SHEET / 2),
        np.array([0.0, 0.0, -SHEET / 2]),
    )
    body = Primitive(
        "body", "box", (0.015, 0.012, 0.03), np.array([0.0, 0.0, -0.036]), mass=0.05
    )
    held = Part("two latches", (body,), (latch("left", 1.0), latch("right", -1.0)))
    fixture = Part("sheet", (sheet,))
    return replace(find_cell(), held=held, make_fixture=lambda _: fixture)


def move(plant, start, begin, end):
    """Lead the tool by a spring along z from one height to another [m].

    Returns:
        Upward contact force [N] and positions of both latches, of each period.
    """
    chain = plant.robot.chain()
    found = []
    steps = int(abs(end - begin) / SPEED / PERIOD)
    for i in range(steps):
        wanted = start.position + np.array(
            [0.0, 0.0, begin + (end - begin) * i / steps]
        )
        q, dq = plant.read()
        J, pose = chain.jacobian(q), plant.robot.tool_pose(q)
        pull = np.array([4000.0, 4000.0, 5000.0]) * (wanted - pose.position)
        turn = 80.0 * rotation_error(TOOL_DOWN, pose.quat_wxyz)
        damping = np.array([150.0] * 3 + [4.0] * 3) * (J @ dq)
        wrench = np.concatenate([pull, turn]) - damping
        plant.apply(J.T @ wrench - 0.5 * dq, PERIOD)
        found.append([plant.contact_force()[2], *plant.part_positions()])
    return np.array(found)


def largest(moves, sign):
    """Return the largest force until the latches are out of the way [N].

    Corners that pass each other then hit for one step: no force that holds.
    """
    way = np.maximum.accumulate(moves[:, 1:].max(axis=1))
    return float((sign * moves[way < 0.95 * OVERLAP, 0]).max())


def test_a_latch_snaps_in_and_out_at_the_force_of_its_spring_and_slopes(make, engine):
    friction = 0.3
    # Drake's tool is compliant: the nose sinks in, and its pressure has a width.
    tolerance = 0.35 if engine == "drake" else 0.10
    plant = make(snapping(), contact_friction=friction)
    q = start_above(plant.robot, z=HOLE.position[2] + 0.009)
    plant.reset(q, HOLE)
    start = plant.robot.tool_pose(q)
    pushed = move(plant, start, 0.0, -0.0145)
    expected = 2.0 * snap_force(friction, SLOPE_IN)
    assert largest(pushed, 1.0) == pytest.approx(expected, rel=tolerance)
    np.testing.assert_allclose(pushed[-1, 1:], 0.0, atol=2e-4)  # both are behind it
    pulled = move(plant, start, -0.0145, 0.020)
    expected = 2.0 * snap_force(friction, SLOPE_OUT)
    assert largest(pulled, -1.0) == pytest.approx(expected, rel=tolerance)
    assert plant.tool_pose().position[2] > start.position[2]  # it came off


def test_the_force_of_a_latch_is_that_of_a_wedge():
    assert snap_force(0.0, np.pi / 4) == pytest.approx(8.0)
    assert snap_force(0.3, SLOPE_OUT) > 20.0  # what a mounted component must bear
    assert snap_force(0.6, SLOPE_OUT) == np.inf
