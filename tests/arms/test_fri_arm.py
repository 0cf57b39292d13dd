"""An arm over FRI moves as one in this process."""

import numpy as np
import pytest
from encoder_plant import EncoderPlant

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.find import make_plant
from dovetail.plants.plant import COLUMN, PLANTS, DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, quat_multiply
from extras import need

from .loopback import CabinetArm

TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
TASK = "XYZ:force A:pose BC:hold"
PERIOD = 0.005
SAME = 1e-6  # rad


def settings(cell, period=PERIOD):
    osc = OscConfig.for_period(period, force_damping=[16.0] * 3 + [0.0] * 3)
    return osc, LimitConfig.for_period(cell.loaded_robot(), period)


def targets(seed, count):
    """A policy that presses, pushes sideways and turns."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        down = -1.0 if i > 20 else -2.0
        f_star = np.array([*rng.uniform(-1.5, 1.5, 2), down, 0.0, 0.0, 0.0])
        quat = quat_multiply(quat_about_z(rng.uniform(-0.2, 0.2)), TOOL_DOWN)
        yield _core.Target(f_star=f_star, quat_wxyz_d=quat)


def make(name, cell):
    if name in PLANTS:
        return make_plant(name, cell, DynamicsConfig())
    plant = make_twin(load_twin(name), cell)
    plant.seed(7)
    return plant


@pytest.mark.parametrize(
    "engine",
    [
        "mujoco",
        pytest.param("bullet", marks=pytest.mark.bullet),
        pytest.param("medium", marks=pytest.mark.bullet),  # a twin: delay and noise
    ],
)
def test_same_episode_same_targets_same_motion_as_a_local_arm(engine):
    if engine != "mujoco":
        need("pybullet")
    cell = find_cell()
    osc, limits = settings(cell)
    start = cell.loaded_robot().inverse_kinematics(
        Pose(np.array([0.60, 0.0, 0.16]), TOOL_DOWN), Q_SEED
    )
    plant = EncoderPlant(make(engine, cell), PERIOD)
    local = LocalArm(plant, cell.loaded_robot(), osc, limits, TASK, PERIOD)
    local.reset(start, HOLE)
    mine = [local.step(target) for target in targets(1, 200)]
    local.close()

    plant = make(engine, cell)
    arm = CabinetArm(plant, osc, limits, TASK, PERIOD)
    arm.seed(7)
    arm.reset(start, HOLE)
    theirs = [arm.step(target) for target in targets(1, 200)]
    arm.close()

    logs = [np.concatenate([s.log for s in states]) for states in (mine, theirs)]
    assert logs[0].shape == logs[1].shape == (2000, len(COLUMN))
    for name, tolerance in (("q", SAME), ("dq", 1e-4), ("tau", 1e-2)):
        columns = slice(COLUMN[f"{name}1"], COLUMN[f"{name}7"] + 1)
        difference = np.abs(logs[0][:, columns] - logs[1][:, columns]).max()
        assert difference <= tolerance, name
    np.testing.assert_allclose(logs[0][:, 0], logs[1][:, 0], atol=1e-9)
    np.testing.assert_array_equal(
        logs[0][:, COLUMN["flags"]], logs[1][:, COLUMN["flags"]]
    )
    moved = np.ptp(logs[0][:, COLUMN["x"]])
    assert moved > 0.02
    assert np.isnan(logs[1][:, COLUMN["fx"]]).all()
    assert theirs[-1].stamp == pytest.approx(mine[-1].stamp) == pytest.approx(10.0)
    np.testing.assert_allclose(theirs[-1].q, mine[-1].q, atol=SAME)
