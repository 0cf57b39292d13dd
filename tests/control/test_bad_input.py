"""Bad input is refused by name where it is set, and survived inside the cycle.

Doors are enumerated: a new field of a Target, a law or a limit without a guard fails.
"""

import re
from dataclasses import fields

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.task_spec import TaskSpec
from dovetail.errors import ConfigError
from dovetail.settings import Range, ranges_of, values_of

TASKS = ("XYZ:force A:pose BC:hold", "XYZABC:hold")
TASK = TASKS[0]
PERIOD = 1e-3
NO_NUMBERS = (np.nan, np.inf, -np.inf)
NO_INPUT = (*NO_NUMBERS, 1e300)
LONGEST = 10.0  # s: an arm that was not controlled for as long starts anew
UNBOUNDED = {n for n, r in ranges_of(LimitConfig).items() if np.isinf(r.high)}
"""Limits whose infinity says that there is none."""
NOWHERE = ("near_plane", 3, -np.inf)  # the one infinity with a meaning


def names_of(struct):
    """The public attributes of a bound struct."""
    return [n for n in dir(struct) if not n.startswith("_")]


def spoilt(value, numbers):
    """Copies of a number or an array with one element replaced."""
    array = np.array(value, dtype=float)
    for index in np.ndindex(array.shape):
        for number in numbers:
            copy = array.copy()
            copy[index] = number
            yield index, number, copy if array.ndim else float(copy)


def wrong_for(name):
    return [bad for bad in NO_NUMBERS if bad != np.inf or name not in UNBOUNDED]


def is_number(value):
    return isinstance(value, (float, np.ndarray))


@pytest.fixture(params=["qp", "paper"])
def limits(robot, request):
    return LimitConfig.for_period(robot, PERIOD, scheme=request.param)


@pytest.fixture
def pose(robot, q_home):
    return robot.tool_pose(q_home)


@pytest.fixture
def make_target(q_home, pose):
    """Return a function that makes a Target that moves nothing, whatever the mode."""
    return lambda: _core.Target(
        position_d=pose.position, quat_wxyz_d=pose.quat_wxyz, q_d=q_home
    )


@pytest.fixture
def target(make_target):
    return make_target()


@pytest.fixture(params=TASKS)
def controller(robot, limits, q_home, pose, request):
    controller = make_controller(robot, OscConfig(), limits, request.param, PERIOD)
    controller.reset(q_home, pose.position, pose.quat_wxyz)
    return controller


@pytest.fixture
def require_one_hold(robot, limits, controller, q_home, make_target):
    """Require that a cycle with this input is a hold, and the next as if it was not."""
    gravity, target = robot.chain().gravity(q_home), make_target()

    def require(*inputs, where):
        result = controller.step(*inputs)
        assert result.flags.bad_input, where
        assert (np.abs(result.tau + gravity) <= limits.tau_max).all(), where
        assert np.isfinite([*result.a, *result.a0, result.flags.displaced]).all()
        good = controller.step(q_home, np.zeros(7), target)
        assert good.flags.packed == 0, where
        assert np.abs(good.tau).max() < 1e-6, where

    return require


def test_every_number_of_a_target_is_guarded(require_one_hold, q_home, target):
    names = [n for n in names_of(target) if is_number(getattr(target, n))]
    switches = {"joint_mode", "stay"}
    assert set(names) == set(names_of(target)) - switches
    for name in names:
        good = np.array(getattr(target, name))
        for index, number, bad in spoilt(good, NO_INPUT):
            if (name, *index, number) == NOWHERE:
                continue
            for target.joint_mode in (False, True):
                setattr(target, name, bad)
                require_one_hold(
                    q_home, np.zeros(7), target, where=(name, index, number)
                )
                setattr(target, name, good)
            target.joint_mode = False


def test_every_measured_number_is_guarded(require_one_hold, q_home, target):
    inputs = {"q": q_home, "dq": np.zeros(7)}
    for name in inputs:
        for index, number, bad in spoilt(inputs[name], NO_INPUT):
            state = {**inputs, name: bad}
            require_one_hold(*state.values(), target, where=(name, index, number))
    for number in (*NO_INPUT, LONGEST, -1.0, -1e-9):  # time does not run backwards
        where = ("elapsed", number)
        require_one_hold(q_home, np.zeros(7), target, number, where=where)


@pytest.mark.parametrize("length", [0.0, 0.9, 1.1])
def test_a_direction_that_is_not_of_unit_length_is_guarded(
    require_one_hold, controller, q_home, pose, target, length
):
    target.quat_wxyz_d = length * pose.quat_wxyz
    require_one_hold(q_home, np.zeros(7), target, where="quat_wxyz_d")
    target.quat_wxyz_d = pose.quat_wxyz
    target.near_plane = np.array([0.0, 0.0, length, 0.1])
    require_one_hold(q_home, np.zeros(7), target, where="near_plane")
    with pytest.raises(ValueError, match=r"quat_hold \(length\) is .*; allowed: 1"):
        controller.hold_at(pose.position, length * pose.quat_wxyz)


def test_reset_and_hold_at_refuse_by_element_and_change_nothing(
    controller, q_home, pose, target
):
    good = {
        "q": q_home,
        "position_hold": pose.position,
        "quat_hold": pose.quat_wxyz,
    }
    for name, value in good.items():
        for index, number, bad in spoilt(value, NO_INPUT):
            arguments = {**good, name: bad}
            says = rf"^{name}\[{index[0]}\] is {re.escape(f'{number:g}')}.*; allowed: "
            if number == 1e300 and name == "quat_hold":
                says = r"^quat_hold \(length\) is"
            with pytest.raises(ValueError, match=says):
                controller.reset(**arguments)
            if arguments.pop("q") is q_home:
                with pytest.raises(ValueError, match=says):
                    controller.hold_at(**arguments)
    result = controller.step(q_home, np.zeros(7), target)
    assert result.flags.packed == 0
    assert np.abs(result.tau).max() < 1e-6


def test_osc_terms_refuses_by_element(controller, q_home, target):
    dq = np.zeros(7)
    for i, name in enumerate(("q", "dq")):
        state = [q_home.copy(), dq.copy()]
        state[i][4] = np.nan
        with pytest.raises(ValueError, match=rf"^{name}\[4\] is nan rad.*; allowed"):
            controller.osc_terms(*state, target)
    for name in names_of(target):
        good = np.array(getattr(target, name))
        if good.dtype != float:
            continue
        element, where = (1, r"\[1\]") if good.ndim else ((), "")
        bad = good.copy()
        bad[element] = np.nan
        setattr(target, name, bad)
        with pytest.raises(ValueError, match=rf"^{name}{where} is nan"):
            controller.osc_terms(q_home, dq, target)
        setattr(target, name, good)


def test_the_arm_comes_to_rest_while_the_measurement_is_gone(
    robot, limits, controller, q_home
):
    plant = _core.RigidPlant(
        robot.chain(),
        damping=limits.damping,
        armature=limits.armature,
    )
    plant.reset(q_home, np.array([0.4, -0.3, 0.4, 0.3, -0.5, 0.5, 0.5]))
    q, dq = plant.read()
    pose = robot.tool_pose(q)
    controller.reset(q, pose.position, pose.quat_wxyz, dq=dq)
    plant.apply(controller.step(q, dq, _core.Target()).tau, PERIOD)
    for _ in range(500):
        result = controller.step(np.full(7, np.nan), dq, _core.Target())
        plant.apply(result.tau, PERIOD)
    assert np.abs(plant.read()[1]).max() < 0.05


def test_the_disturbance_estimate_outlives_bad_cycles(
    robot, limits, controller, q_home, target
):
    plant = _core.RigidPlant(
        robot.chain(),
        damping=limits.damping,
        armature=limits.armature,
    )
    plant.reset(q_home, np.zeros(7))
    push = np.array([8.0, -5.0, 6.0])
    plant.set_external_force(push)
    for cycle in range(200):
        q, dq = plant.read()
        if cycle in (20, 30, 31):
            dq = np.full(7, np.nan)
        plant.apply(controller.step(q, dq, target).tau, PERIOD)
        assert np.isfinite(controller.disturbance).all()
    expected = robot.chain().jacobian(plant.read()[0])[:3].T @ push
    np.testing.assert_allclose(
        controller.disturbance, expected, atol=0.05 * np.abs(expected).max()
    )


def build(robot, osc, limits, period=PERIOD):
    modes = list(TaskSpec.parse(TASK).modes)
    return _core.Controller(robot.chain(), osc, limits, modes, period)


@pytest.mark.parametrize("kind", ["osc", "limits"])
def test_cpp_refuses_every_setting_that_is_no_number_and_names_it(robot, limits, kind):
    def fresh():
        return {"osc": OscConfig().params(), "limits": limits.params()}

    struct = fresh()[kind]
    numbers = [n for n in names_of(struct) if is_number(getattr(struct, n))]
    assert len(numbers) > 10
    for name in numbers:
        for index, number, bad in spoilt(getattr(struct, name), wrong_for(name)):
            structs = fresh()
            setattr(structs[kind], name, bad)
            element = name + "".join(f"[{i}]" for i in index)
            says = rf"^{re.escape(element)} is {number:g}.*; allowed: "
            with pytest.raises(ValueError, match=says):
                build(robot, **structs)


@pytest.mark.parametrize("config", [OscConfig, LimitConfig])
def test_every_setting_is_refused_by_name_in_python_too(robot, config):
    good = config.for_period(*([robot] if config is LimitConfig else []), PERIOD)
    values = values_of(good)
    for field in fields(config):
        name = field.name
        if isinstance(values[name], (bool, str)):
            continue
        notes = getattr(field.type, "__metadata__", ())
        ranges = [note for note in notes if isinstance(note, Range)]
        assert ranges, f"{config.__name__}.{name} has no Range"
        for index, number, bad in spoilt(values[name], wrong_for(name)):
            element = name + "".join(rf"\[{ranges[0].labels[i]}\]" for i in index)
            says = rf"{element} is {number:g}.*allowed"
            with pytest.raises(ConfigError, match=says):
                config(**{**values, name: bad})


def test_cpp_refuses_limits_that_were_never_set(robot):
    with pytest.raises(ValueError, match=r"q_min\[0\]"):
        build(robot, OscConfig().params(), _core.LimitParams())


@pytest.mark.parametrize("modes", [[0, 1, 2, 3, 4, 0], [0, -1, 0, 0, 0, 0]])
def test_cpp_refuses_an_unknown_mode(robot, limits, modes):
    osc = OscConfig().params()
    with pytest.raises(ValueError, match=r"task\[[14]\].*0 free, 1 force"):
        _core.Controller(robot.chain(), osc, limits.params(), modes, PERIOD)


@pytest.mark.parametrize("period", [0.0, -1e-3, *NO_NUMBERS, 1.0])
def test_cpp_refuses_a_period_out_of_range(robot, limits, period):
    with pytest.raises(ValueError, match="period"):
        build(robot, OscConfig().params(), limits.params(), period)


def test_wrong_shapes_are_type_errors(controller, q_home):
    for q, dq in ((q_home[:6], np.zeros(7)), (q_home, np.zeros((7, 2)))):
        with pytest.raises(TypeError):
            controller.step(q, dq, _core.Target())
    with pytest.raises(TypeError):
        _core.Target(f_star=np.zeros(5))


def test_a_chain_with_a_spoilt_fact_is_refused_by_name(robot):
    names = ("origin_position", "origin_rotation", "mass", "com", "inertia")
    facts = {name: np.array(robot.arrays()[name]) for name in names}
    facts |= {"tool_position": np.zeros(3), "tool_rotation": np.eye(3)}
    facts["gravity"] = np.array([0.0, 0.0, -9.81])
    _core.Chain(**facts)
    negative = np.where(np.arange(7) == 2, -1.0, facts["mass"])
    with pytest.raises(ValueError, match=r"mass\[2\] is -1"):
        _core.Chain(**{**facts, "mass": negative})
    for name, good in facts.items():
        for index, number, bad in spoilt(good, NO_NUMBERS):
            element = name + "".join(f"[{i}]" for i in index)
            says = rf"^{re.escape(element)} is {number:g}"
            with pytest.raises(ValueError, match=says):
                _core.Chain(**{**facts, name: bad})
