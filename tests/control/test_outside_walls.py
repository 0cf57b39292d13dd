"""A start outside a wall: the wall takes the tool back in, slowly."""

from dataclasses import replace

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.local_arm import LocalArm
from dovetail.control.period import PERIODS
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.arm_setup import build_local_arm
from dovetail.envs.config import EnvConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import COLUMN
from dovetail.poses import Pose, quat_about_z, tool_down

TASK = "XYZ:force ABC:hold"
LOW, HIGH = np.array([0.53, -0.1, 0.14]), np.array([0.65, 0.1, 0.20])
HOLE = Pose(np.array([0.75, 0.2, 0.03]), quat_about_z(0.0))
INSIDE = np.array([0.58, 0.0, 0.17])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
SPEED = 0.05  # m/s, of the wall
SETTLE = 0.3  # s
OUTWARD = 8.0  # m/s2, what a policy may ask for
ENDED = 1 << 46  # of pack_flags in types.hpp
MOTOR_SHARE = 0.35  # of tau_max; gravity alone takes 0.25 here


def make_arm(period, twin=None):
    return build_local_arm(
        replace(find_cell(), walls=(tuple(LOW), tuple(HIGH))),
        TaskSpec.parse(TASK),
        EnvConfig(twin=twin, period=period, force_damping=16.0, near_speed=0.05),
    )


def come_back(arm: LocalArm, out, axis, side, asked):
    """Way out of the wall [m] at each cycle, from `out` on, and the motors' share."""
    q_inside = arm.facts.robot.inverse_kinematics(Pose(INSIDE, tool_down(0.0)), Q_SEED)
    wall = (HIGH if side > 0 else LOW)[axis]
    p = INSIDE.copy()
    p[axis] = wall + side * out
    arm.reset(
        arm.facts.robot.inverse_kinematics(Pose(p, tool_down(0.0)), q_inside), HOLE
    )
    f = np.zeros(6)
    f[axis] = side * asked
    steps = round((out / SPEED + 1.0) / 0.05)
    target = _core.Target(f_star=f)
    log = np.vstack([arm.step(target, 0.05).log for _ in range(steps)])
    q = log[:, COLUMN["q1"] : COLUMN["q7"] + 1]
    gravity = np.array([arm.facts.robot.chain().gravity(row) for row in q[::5]])
    tau = log[::5, COLUMN["tau1"] : COLUMN["tau7"] + 1]
    share = np.abs(tau + gravity) / arm.facts.robot.limits.tau_max
    flags = np.bitwise_or.reduce(log[:, COLUMN["flags"]].astype(np.int64))
    assert not flags & ENDED
    return side * (log[:, COLUMN["xyz"[axis]]] - wall), float(share.max())


def speed_in(beyond, period):
    """Largest speed inwards over 50 ms [m/s]: an encoder's noise is none."""
    cycles = round(0.05 / period)
    return float((beyond[:-cycles] - beyond[cycles:]).max()) / 0.05


@pytest.mark.parametrize("asked", [0.0, OUTWARD])
@pytest.mark.parametrize("out", [0.005, 0.03, 0.1])
@pytest.mark.parametrize("period", PERIODS)
def test_it_comes_back_inside_slowly(period, out, asked):
    arm = make_arm(period)
    for axis, side in ((0, -1), (0, 1), (1, 1), (2, 1), (2, -1)):
        beyond, share = come_back(arm, out, axis, side, asked)
        assert beyond[0] == pytest.approx(out, abs=1e-3)
        assert speed_in(beyond, period) < 1.1 * SPEED
        assert share < MOTOR_SHARE
        late = beyond[round((out / SPEED + SETTLE) / period) :]
        assert late.max() < 0.0  # inside, and there it stays
    arm.close()


@pytest.mark.parametrize("twin", ["medium", "hard"])
@pytest.mark.parametrize("period", [0.001, 0.005])
def test_an_arm_unlike_its_model_comes_back_as_slowly(twin, period):
    """Pushed outwards: left alone, weight that nobody tared drives it on."""
    arm = make_arm(period, twin)
    for axis, side in ((0, 1), (1, 1), (2, 1)):
        beyond, share = come_back(arm, 0.03, axis, side, OUTWARD)
        assert speed_in(beyond, period) < 1.5 * SPEED
        assert share < MOTOR_SHARE
        assert beyond[round((0.03 / SPEED + SETTLE) / period) :].max() < 0.0
    arm.close()


@pytest.mark.parametrize("twin", ["medium", "hard"])
@pytest.mark.parametrize("period", [0.001, 0.005])
def test_weight_against_a_wall_rests_there(twin, period):
    """It swung there until the last line ended the motion, 1 s after the reset."""
    arm = make_arm(period, twin)
    pose = Pose(INSIDE, tool_down(0.0))
    arm.reset(arm.facts.robot.inverse_kinematics(pose, Q_SEED), HOLE)
    log = np.vstack([arm.step(_core.Target(), 0.05).log for _ in range(60)])
    assert not (log[:, COLUMN["flags"]].astype(np.int64) & ENDED).any()
    last = log[-round(0.5 / period) :]
    assert last[:, COLUMN["x"]].min() > HIGH[0] - arm.facts.limits.delta_x - 1e-3
    assert last[:, COLUMN["dq4"]].std() < 0.015  # rad/s; 0.07 before
    arm.close()
