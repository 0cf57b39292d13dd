"""The speed limit near contact: where it holds, and where it is said not to."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from dovetail.control.config import LimitConfig
from dovetail.envs.unwrapped import require_contact_env
from dovetail.plants.plant import COLUMN
from dovetail.tasks.shipped import DEFAULT_ENV

PERIOD = 1e-3
FORCE = "XYZ:force ABC:hold"
SLOW = 0.02  # m/s
REAL = 2e-3  # m/s: the motion against the command
EVERYWHERE = [0.0, 0.0, 1.0, 9.0]  # z below 9 m is near contact
WIDE = {"x_min": -2.0, "x_max": 2.0, "dx_max": 5.0}


@pytest.fixture(scope="module")
def limits(robot):
    slow = {"near_speed": SLOW, **WIDE}
    return LimitConfig.for_period(robot, PERIOD, hardware=False, **slow)


def speed_along_x(robot, q, speed):
    """Joint speed [rad/s] that moves the tool along x at a speed [m/s]."""
    return np.linalg.pinv(robot.chain().jacobian(q)) @ (speed * np.eye(6)[0])


def test_near_plane_slows_the_tool_before_it_is_crossed(
    run_loop, robot, limits, q_home
):
    start = robot.tool_pose(q_home).position
    plane = [0.0, 0.0, 1.0, start[2] - 0.05]
    down = -2.0 * np.eye(6)[2]
    run = run_loop(limits, lambda q: down, FORCE, cycles=1500, near_plane=plane)
    below = run.position[:, 2] < plane[3]
    assert run.speed[:, 2].min() < -0.1
    assert 100 < below.sum() < 1500
    assert np.abs(run.speed[below]).max() < 0.04  # at the plane itself
    deeper = run.position[:, 2] < plane[3] - 0.005
    assert np.abs(run.speed[deeper]).max() < SLOW + REAL


@pytest.mark.parametrize("scheme", ["qp", "paper"])
@pytest.mark.parametrize("mode", ["force", "pose", "hold"])
def test_it_holds_for_every_axis_that_is_driven(
    run_loop, robot, limits, q_home, mode, scheme
):
    goal = robot.tool_pose(q_home).position + 0.2 * np.eye(3)[0]
    push = {"force": 2.0, "pose": 0.0, "hold": 60.0}[mode]  # m/s2; hold gives way
    run = run_loop(
        replace(limits, scheme=scheme),
        lambda q: push * np.eye(6)[0],
        f"XYZ:{mode} ABC:hold",
        dq=speed_along_x(robot, q_home, 0.1),
        near_plane=EVERYWHERE,
        aim={"position_d": goal},
        cycles=400,
    )
    assert run.bits("wall_velocity") & 1
    settled = np.abs(run.speed[300:])  # it is to take 0.05 s
    assert 0.5 * SLOW < settled.max() < SLOW + REAL


@pytest.mark.parametrize("where", ["free axis", "joint target", "walls off"])
def test_it_does_not_hold_where_the_docstring_says_so(
    run_loop, robot, limits, q_home, where
):
    is_free, is_joint = where == "free axis", where == "joint target"
    goal = {"joint_mode": True, "q_d": q_home + 0.5 * np.eye(7)[0]}
    run = run_loop(
        replace(limits, walls=where != "walls off"),
        lambda q: np.zeros(6),
        "YZ:force ABC:hold" if is_free else FORCE,
        cycles=100,
        dq=speed_along_x(robot, q_home, 0.1),
        near_plane=EVERYWHERE,
        aim=goal if is_joint else None,
    )
    assert run.bits("wall_velocity") == 0
    assert np.abs(run.speed[-1]).max() > 1.5 * SLOW


@pytest.mark.parametrize(("period", "most"), [(1e-3, 0.036), (5e-3, 0.045)])
def test_a_late_arm_does_not_swing_on_its_way_down(period, most):
    """Corrected within 40 ms, its fall came back by up to 43 and 62 mm/s."""
    env = gymnasium.make(DEFAULT_ENV, twin="hard", period=period, tare=True)
    core, down = require_contact_env(env), np.array([0.0, 0.0, -1.0, 0.0], np.float32)
    for seed in range(6):
        env.reset(seed=seed)
        down[0] = -1.0 if seed % 2 else 0.5
        logs = []
        for _ in range(40):
            env.step(down)
            logs.append(core.state.log)
        log = np.vstack(logs)
        force = np.linalg.norm(log[:, COLUMN["fx"] : COLUMN["fz"] + 1], axis=1)
        fall = log[: np.argmax(force > 0.0) or None, COLUMN["vz"]]
        braked = fall[np.argmin(fall) :]
        again = np.maximum.accumulate(braked) - braked  # m/s
        assert again.max() < most
    env.close()
