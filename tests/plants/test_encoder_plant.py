"""A plant that measures positions only gives the velocity that FRI clients observe."""

import numpy as np
import pytest
from encoder_plant import EncoderPlant

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.period import PERIODS
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.plants.twin import load_twin, make_twin
from plants.conftest import HOLE, Q_BENT

PERIOD = 0.005


def test_velocity_is_the_difference_moved_to_the_end_of_the_period(make):
    plant = EncoderPlant(make(), PERIOD)
    plant.reset(Q_BENT, HOLE)
    q_last, dq = plant.read()
    np.testing.assert_array_equal(dq, np.zeros(7))
    a = np.linspace(-2.0, 2.0, 7)
    tau = plant.robot.chain().inertia_matrix(Q_BENT) @ a
    for _ in range(5):
        plant.apply_commanded(tau, a, PERIOD)
        q, dq = plant.read()
        expected = (q - q_last) / PERIOD + 0.5 * PERIOD * a
        np.testing.assert_allclose(dq, expected, atol=1e-12)
        q_last = q


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_the_observed_velocity_is_close_to_the_true_one_in_motion(make, gain):
    inner = make()
    plant = EncoderPlant(inner, PERIOD, gain)
    robot = plant.robot
    limits = LimitConfig.for_period(robot, PERIOD)
    osc = OscConfig.for_period(PERIOD, force_damping=[10.0] * 6)
    controller = make_controller(robot, osc, limits, "XYZ:force ABC:hold", PERIOD)
    plant.reset(Q_BENT, HOLE)
    hold = robot.tool_pose(Q_BENT)
    controller.reset(Q_BENT, hold.position, hold.quat_wxyz)
    target = _core.Target(f_star=np.array([1.0, -1.0, 0.5, 0, 0, 0]))
    log, q, dq = plant.run_cycles(controller, target, 60, PERIOD)
    assert log.shape == (60, len(CYCLE_COLUMNS))
    np.testing.assert_allclose(log[:, 0], PERIOD * np.arange(60), atol=1e-12)
    true_q, true_dq = inner.read()
    np.testing.assert_array_equal(q, true_q)
    np.testing.assert_allclose(dq, true_dq, atol=0.01)
    assert np.abs(log[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]).max() > 0.05


@pytest.mark.parametrize("period", PERIODS)
def test_the_observed_velocity_is_as_quiet_at_every_period(make, period):
    """A difference over 1 ms has five times the noise of one over 5 ms."""
    deviation = 3e-5  # rad, of twin hard
    plant = EncoderPlant(make(), period)
    plant.attach_channel(_core.Channel(position_noise=deviation, seed=1))
    plant.reset(Q_BENT, HOLE)
    speeds = []
    for _ in range(400):
        plant.apply_commanded(np.zeros(7), np.zeros(7), period)
        speeds.append(plant.read()[1])
    assert np.std(speeds[50:]) < 1.05 * np.sqrt(2.0) * deviation / 0.005


@pytest.mark.parametrize("period", PERIODS)
def test_twin_hard_is_held_still_from_positions_alone(period):
    """With the noise of one difference it swung by 20 mm at 1 ms."""
    cell = find_cell()
    robot = cell.loaded_robot()
    plant = EncoderPlant(make_twin(load_twin("hard"), cell), period)
    limits = LimitConfig.for_period(robot, period, walls=False)
    osc, task = OscConfig.for_period(period), "XYZABC:hold"
    arm = LocalArm(plant, robot, osc, limits, task, period)
    arm.reset(Q_BENT, HOLE)
    target = _core.Target(joint_mode=True, q_d=Q_BENT)
    places = [arm.step(target).tool.position for _ in range(30)]
    assert np.linalg.norm(np.ptp(places[20:], axis=0)) < 2e-3
