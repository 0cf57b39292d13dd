"""What a policy step takes from a log of cycles: equal to the same in NumPy."""

import ctypes

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from plants.conftest import HOLE, start_above

FORCE = slice(COLUMN["fx"], COLUMN["fz"] + 1)
WRENCH = slice(COLUMN["wrench_fx"], COLUMN["wrench_mz"] + 1)


@pytest.fixture(scope="module")
def robot():
    return find_cell().loaded_robot()


def random_log(rng, rows):
    log = rng.normal(size=(rows, len(CYCLE_COLUMNS)))
    log[:, COLUMN["flags"]] = 2.0 ** rng.integers(0, 45, rows)
    return log


@pytest.mark.parametrize("rows", [0, 1, 10])
def test_summary_is_the_tool_the_largest_force_and_all_flags(robot, rng, rows):
    chain = robot.chain()
    q, dq = rng.uniform(-1.0, 1.0, (2, 7))
    log = random_log(rng, rows)
    position, quat, twist, force, wrench, flags = _core.summarize(chain, q, dq, log)
    pose = robot.tool_pose(q)
    np.testing.assert_array_equal(position, pose.position)
    np.testing.assert_allclose(quat, pose.quat_wxyz, atol=1e-14)
    np.testing.assert_allclose(twist, chain.jacobian(q) @ dq, atol=1e-14)
    expected = max(log[:, FORCE], key=np.linalg.norm, default=np.zeros(3))
    np.testing.assert_array_equal(force, expected)
    np.testing.assert_array_equal(wrench, log[-1, WRENCH] if rows else np.zeros(6))
    assert flags == np.bitwise_or.reduce(log[:, COLUMN["flags"]].astype(np.int64))


def test_a_force_that_cannot_be_measured_stays_not_a_number(robot, rng):
    log = random_log(rng, 4)
    log[:, FORCE] = np.nan
    force = _core.summarize(robot.chain(), np.zeros(7), np.zeros(7), log)[3]
    assert np.isnan(force).all()


def test_rows_outside_are_counted_once_and_nan_is_not_outside(rng):
    low = np.full(len(CYCLE_COLUMNS), -1.0)
    log = np.clip(random_log(rng, 10), -1.0, 1.0)
    assert _core.count_outside(log, low, -low) == 0
    log[2, [0, 3]] = -1.1
    log[7, -1] = 1.1
    log[9, 5] = np.nan
    assert _core.count_outside(log, low, -low) == 2
    assert _core.count_outside(log[:0], low, -low) == 0


def test_a_cycle_whose_target_is_refused_still_logs_where_the_tool_is(robot):
    plant = MujocoPlant(find_cell())
    limits = LimitConfig.for_period(robot, 0.005)
    task = "XYZ:force A:pose BC:hold"
    controller = make_controller(robot, OscConfig(), limits, task, 0.005)
    q = start_above(robot, z=0.2)
    plant.reset(q, HOLE)
    controller.reset(q, *robot.tool_pose(q))
    target = _core.Target(f_star=np.full(6, np.nan))
    log, _, _ = plant.run_cycles(controller, target, 3, 0.005)
    assert (log[:, COLUMN["flags"]] == 2**40).all()  # bad_input
    for row in log:
        pose = robot.tool_pose(row[COLUMN["q1"] : COLUMN["q7"] + 1])
        np.testing.assert_array_equal(row[COLUMN["x"] : COLUMN["z"] + 1], pose.position)


def test_mujoco_does_not_read_the_clock_for_its_statistics():
    plant = MujocoPlant(find_cell())
    clock = ctypes.c_void_p.in_dll(ctypes.CDLL(plant._library), "mjcb_time")
    assert clock.value is None
