"""A controller whose torque limits cannot hold the arm is not built, by any road."""

import ast
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dovetail
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.control.available import largest_gravity
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.control.torque_limits import check_torque
from dovetail.errors import ConfigError, TorqueError, UnprovenWarning

TASK = "XYZ:force ABC:hold"
PERIOD = 1e-3


def gravity_of(robot):
    span = (robot.limits.q_min, robot.limits.q_max, robot.limits.dq_max)
    return largest_gravity(robot, *(tuple(v.tolist()) for v in span))


def with_torque(robot, joint, torque):
    tau_max = np.array(robot.limits.tau_max)
    tau_max[joint] = torque
    return replace(LimitConfig.for_period(robot, PERIOD), tau_max=tau_max)


def test_the_largest_gravity_is_not_missed(robot, rng):
    largest, chain = gravity_of(robot), robot.chain()
    q = rng.uniform(robot.limits.q_min, robot.limits.q_max, (20_000, 7))
    seen = np.abs([chain.gravity(row) for row in q]).max(axis=0)
    assert (seen <= largest + 1e-9).all()
    np.testing.assert_allclose(seen, largest, rtol=0.05, atol=1e-9)


@pytest.mark.parametrize("joint", [1, 2, 3, 4, 5])
def test_less_torque_than_gravity_takes_is_refused_with_the_joint(robot, joint):
    gravity = gravity_of(robot)[joint]
    limits = with_torque(robot, joint, 0.99 * gravity)
    with pytest.raises(TorqueError) as refused:
        make_controller(robot, OscConfig(), limits, TASK, PERIOD)
    assert isinstance(refused.value, ConfigError)
    assert (refused.value.joint, refused.value.cause) == (f"A{joint + 1}", "gravity")
    assert refused.value.shares["gravity"] == pytest.approx(gravity)


@pytest.mark.parametrize("share", [1.01, 1.19])
def test_a_little_more_than_gravity_is_warned_of(robot, share):
    limits = with_torque(robot, 1, share * gravity_of(robot)[1])
    with pytest.warns(UnprovenWarning, match=r"tau_max\[A2\].* times that"):
        make_controller(robot, OscConfig(), limits, TASK, PERIOD)


def test_less_than_braking_takes_is_warned_of(robot):
    limits = with_torque(robot, 1, 1.25 * gravity_of(robot)[1])
    with pytest.warns(UnprovenWarning, match=r"tau_max\[A2\].*to brake"):
        make_controller(robot, OscConfig(), limits, TASK, PERIOD)


def test_the_usual_limits_are_neither(robot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_torque(robot, LimitConfig.for_period(robot, PERIOD))


def test_a_range_in_which_gravity_is_less_is_enough(robot):
    """Only what the limits admit counts."""
    limits = with_torque(robot, 1, 0.8 * gravity_of(robot)[1])
    upright = {"q_min": np.full(7, -0.2), "q_max": np.full(7, 0.2)}
    slow = {"dq_max": np.full(7, 0.1), "ddq_max": np.full(7, 1.0)}
    check_torque(robot, replace(limits, **upright, **slow))
    with pytest.raises(TorqueError):
        check_torque(robot, replace(limits, **slow))


def test_an_arm_over_fri_is_refused_too(robot):
    settings = ControllerSettings(
        osc=OscConfig(),
        limits=with_torque(robot, 3, 5.0),
        task=TaskSpec.parse(TASK),
        period=PERIOD,
    )
    address = FriAddress.parse("fri://127.0.0.1:39217?clock=lockstep")
    with pytest.raises(TorqueError):
        FriArm(address, robot, settings)


def test_every_module_that_gives_limits_to_the_core_checks_them():
    for file in Path(dovetail.__file__).parent.rglob("*.py"):
        calls = [
            ast.unparse(node)
            for node in ast.walk(ast.parse(file.read_text()))
            if isinstance(node, ast.Call)
        ]
        if any(call.endswith("limits.params()") for call in calls):
            assert any(call.startswith("check_torque(") for call in calls), file
