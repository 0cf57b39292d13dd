"""Bad input is refused by name where it is set, and survived inside the cycle."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec

TASK = "XYZ:force A:pose BC:hold"
PERIOD = 1e-3


@pytest.fixture
def limits(robot):
    return LimitConfig.for_period(robot, PERIOD)


@pytest.fixture
def controller(robot, limits, q_home):
    controller = make_controller(robot, OscConfig(), limits, TASK, PERIOD)
    pose = robot.tool_pose(q_home)
    controller.reset(q_home, pose.position, pose.quat_wxyz)
    return controller


def bad_inputs(q):
    """The input of a cycle with one number spoilt."""
    for value in (np.nan, np.inf, -np.inf):
        for field in ("q", "dq", "f_star", "position_d", "quat_wxyz_d", "q_d"):
            inputs = {
                "q": q.copy(),
                "dq": np.zeros(7),
                "f_star": np.zeros(6),
                "position_d": np.zeros(3),
                "quat_wxyz_d": np.array([1.0, 0.0, 0.0, 0.0]),
                "q_d": q.copy(),
            }
            inputs[field][1] = value
            state = inputs.pop("q"), inputs.pop("dq")
            yield *state, _core.Target(**inputs, joint_mode=field == "q_d")
    for i, value in ((0, np.nan), (2, np.inf), (3, np.nan), (3, np.inf)):
        target = _core.Target()
        plane = target.near_plane
        plane[i] = value
        target.near_plane = plane
        yield q, np.zeros(7), target


def test_a_spoilt_number_becomes_a_flag_and_a_finite_torque(
    robot, limits, controller, q_home
):
    gravity = robot.chain().gravity(q_home)
    for q, dq, target in bad_inputs(q_home):
        result = controller.step(q, dq, target)
        assert result.flags.bad_input
        assert (np.abs(result.tau + gravity) <= limits.tau_max).all()
        good = controller.step(q_home, np.zeros(7), _core.Target())
        assert not good.flags.bad_input
        assert np.isfinite(good.tau).all()


def test_the_arm_comes_to_rest_while_the_measurement_is_gone(
    robot, limits, controller, q_home
):
    plant = _core.RigidPlant(
        robot.chain(), damping=limits.damping, armature=limits.armature
    )
    plant.reset(q_home, np.array([0.4, -0.3, 0.4, 0.3, -0.5, 0.5, 0.5]))
    q, dq = plant.read()
    plant.apply(controller.step(q, dq, _core.Target()).tau, PERIOD)
    for _ in range(500):
        result = controller.step(np.full(7, np.nan), dq, _core.Target())
        plant.apply(result.tau, PERIOD)
    assert np.abs(plant.read()[1]).max() < 0.05


@pytest.mark.parametrize("name", ["q_min", "dq_max", "tau_max", "ddq_max", "damping"])
def test_cpp_refuses_a_limit_that_is_no_number_and_names_it(robot, limits, name):
    params = limits.params()
    value = np.array(getattr(params, name))
    value[4] = np.nan
    setattr(params, name, value)
    modes = list(TaskSpec.parse(TASK).modes)
    with pytest.raises(ValueError, match=rf"{name}\[4\] is nan"):
        _core.Controller(robot.chain(), OscConfig().params(), params, modes, PERIOD)


def test_cpp_refuses_limits_that_were_never_set(robot):
    modes = list(TaskSpec.parse(TASK).modes)
    unset = _core.LimitParams()
    with pytest.raises(ValueError, match=r"q_min\[0\]"):
        _core.Controller(robot.chain(), OscConfig().params(), unset, modes, PERIOD)


@pytest.mark.parametrize("modes", [[0, 1, 2, 3, 4, 0], [0, -1, 0, 0, 0, 0]])
def test_cpp_refuses_an_unknown_mode(robot, limits, modes):
    osc = OscConfig().params()
    with pytest.raises(ValueError, match=r"task\[[14]\].*0 free, 1 force"):
        _core.Controller(robot.chain(), osc, limits.params(), modes, PERIOD)


@pytest.mark.parametrize("period", [0.0, -1e-3, np.nan, 1.0])
def test_cpp_refuses_a_period_out_of_range(robot, limits, period):
    modes, osc = list(TaskSpec.parse(TASK).modes), OscConfig().params()
    with pytest.raises(ValueError, match="period"):
        _core.Controller(robot.chain(), osc, limits.params(), modes, period)


def test_wrong_shapes_are_type_errors(controller, q_home):
    for q, dq in ((q_home[:6], np.zeros(7)), (q_home, np.zeros((7, 2)))):
        with pytest.raises(TypeError):
            controller.step(q, dq, _core.Target())
    with pytest.raises(TypeError):
        _core.Target(f_star=np.zeros(5))


def test_a_chain_with_a_spoilt_fact_is_refused_by_name(robot):
    facts = {
        name: np.array(getattr(robot, name))
        for name in ("origin_position", "origin_rotation", "mass", "com", "inertia")
    }
    facts["mass"][2] = -1.0
    tool = {"tool_position": np.zeros(3), "tool_rotation": np.eye(3)}
    with pytest.raises(ValueError, match=r"mass\[2\] is -1"):
        _core.Chain(**facts, **tool, gravity=np.zeros(3))
