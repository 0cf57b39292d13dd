"""What every arm must do alike; one file for all of them.

A Franka, behind franka-sim, has a clock of its own and no fixture.
"""

import numpy as np
import pytest
from beside_franka_sim import PORT, PYTHON, franka_in_step, is_listening

from dovetail import _core
from dovetail.arms.address import parse_address
from dovetail.arms.arm import is_simulated
from dovetail.arms.franka.arm import FrankaArm
from dovetail.arms.local_arm import LocalArm
from dovetail.arms.remote_arm import RemoteArm
from dovetail.arms.reset_motion import ARRIVED
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.plants.find import make_plant
from dovetail.plants.plant import (
    COLUMN,
    CYCLE_COLUMNS,
    FLAG_MASK,
    DynamicsConfig,
)
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z, quat_multiply, rotation_error
from extras import NEEDS_FRANKA_SIM, need, need_franka_sim_alone

TASK = "XYZ:force A:pose BC:hold"
TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
ARMS = ["mujoco", pytest.param("bullet", marks=pytest.mark.bullet), "twin"]
ARMS += ["remote", "fri", pytest.param("franka", marks=pytest.mark.slow)]


def build(kind, task=TASK, period=0.005):
    """Build a local arm over an engine or the easy twin."""
    if kind == "bullet":
        need("pybullet")
    if kind == "franka":
        return build_franka(task)
    cell = find_cell()
    robot = cell.loaded_robot()
    if kind == "twin":
        plant = make_twin(load_twin("easy"), cell)
    else:
        engine = "mujoco" if kind in ("remote", "fri") else kind
        plant = make_plant(engine, cell, DynamicsConfig())
    osc = OscConfig(force_damping=[16.0, 16.0, 16.0, 0.0, 0.0, 0.0])
    limits = LimitConfig.for_period(robot, period)
    if kind == "remote":
        from .served_arm import ServedArm

        return ServedArm(plant, robot, osc, limits, task, period)
    if kind == "fri":
        from .loopback import CabinetArm

        return CabinetArm(plant, osc, limits, task, period)
    return LocalArm(plant, robot, osc, limits, task, period)


def build_franka(task):
    """Connect to franka-sim."""
    cell = find_cell(robot="fr3")
    damping = [16.0, 16.0, 16.0, 0.0, 0.0, 0.0]
    settings = ControllerSettings(
        osc=OscConfig.for_period(1e-3, force_damping=damping),
        limits=LimitConfig.for_period(cell.loaded_robot(), 1e-3),
        task=TaskSpec.parse(task),
        period=1e-3,
    )
    address = parse_address("franka://127.0.0.1?approach=yes&recover=yes")
    return address.build(cell, settings)


@pytest.fixture(scope="module")
def franka_sim():
    """Run franka-sim until the last test is over."""
    if not PYTHON.is_file():
        pytest.skip(NEEDS_FRANKA_SIM)
    need_franka_sim_alone()
    if is_listening():
        pytest.skip(
            f"FCI has one port, {PORT}, and another process listens there: end it "
            "(pgrep -f franka-sim), then run again"
        )
    with franka_in_step():
        yield


@pytest.fixture(params=ARMS)
def connect(request):
    """Return a function that connects to the arm, with a task."""
    if request.param == "franka":
        request.getfixturevalue("franka_sim")
    arms = []

    def make(task=TASK):
        arms.append(build(request.param, task))
        return arms[-1]

    yield make
    for arm in arms:
        arm.close()


@pytest.fixture
def arm(connect):
    return connect()


def has_own_clock(arm):
    return arm.facts.traits.is_real_time


def start(arm, z=0.16):
    robot = arm.facts.robot
    seed = robot.posture("down") if robot.name == "fr3" else Q_SEED
    return robot.inverse_kinematics(Pose(np.array([0.60, 0.0, z]), TOOL_DOWN), seed)


def push(f_star, theta=0.0):
    quat = quat_multiply(quat_about_z(theta), TOOL_DOWN)
    return _core.Target(f_star=np.array([*f_star, 0.0, 0.0, 0.0]), quat_wxyz_d=quat)


def test_reset_gives_the_start_at_rest(arm):
    q = start(arm)
    state = arm.reset(q, HOLE)
    assert state.stamp == 0.0
    near = ARRIVED if has_own_clock(arm) else 1e-3  # [rad]: it is driven there
    np.testing.assert_allclose(state.q, q, atol=near)
    there = arm.facts.robot.tool_pose(state.q).position
    np.testing.assert_allclose(state.tool.position, there, atol=1e-3)
    np.testing.assert_allclose(state.tool.velocity, np.zeros(6), atol=0.02)
    assert state.log.shape == (0, len(CYCLE_COLUMNS))


def test_step_logs_every_control_cycle(arm):
    arm.reset(start(arm), HOLE)
    first = arm.step(push([0.0, 0.0, 0.0]))
    second = arm.step(push([0.0, 0.0, 0.0]), duration=0.02)
    if has_own_clock(arm):
        times = np.concatenate([first.log[:, 0], second.log[:, 0]])
        cycles = np.diff(times) / arm.facts.period
        np.testing.assert_allclose(cycles, np.round(cycles), atol=1e-6)
        assert (np.round(cycles) >= 1.0).all()
        assert round(second.stamp / arm.facts.period) >= 70
        return
    assert first.log.shape == (10, len(CYCLE_COLUMNS))
    assert second.log.shape == (4, len(CYCLE_COLUMNS))
    assert second.stamp == pytest.approx(0.07)
    times = np.concatenate([first.log[:, 0], second.log[:, 0]])
    np.testing.assert_allclose(times, 0.005 * np.arange(14), atol=1e-9)


def test_without_a_command_the_arm_stays(arm):
    before = arm.reset(start(arm), HOLE)
    for _ in range(20):
        state = arm.step(push([0.0, 0.0, 0.0]))
    # The easy twin's gravity residual of 0.08 m/s2 pushes against D = 16 1/s.
    np.testing.assert_allclose(state.tool.position, before.tool.position, atol=0.02)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_force_axis_moves_the_tool_along_it(connect, axis):
    others = "XYZ".replace("XYZ"[axis], "")
    arm = connect(f"{'XYZ'[axis]}:force {others}:pose A:pose BC:hold")
    before = arm.reset(start(arm, z=0.20), HOLE)
    target = push(2.0 * np.eye(3)[axis])
    target.position_d = before.tool.position
    for _ in range(6):
        state = arm.step(target)
    moved = state.tool.position - before.tool.position
    assert moved[axis] > 0.015
    assert np.abs(np.delete(moved, axis)).max() < 0.2 * moved[axis]


def test_pose_axis_follows_theta_while_the_rest_is_held(arm):
    arm.reset(start(arm), HOLE)
    for _ in range(30):
        state = arm.step(push([0.0, 0.0, 0.0], theta=0.15))
    wanted = quat_multiply(quat_about_z(0.15), TOOL_DOWN)
    error = rotation_error(wanted, state.tool.quat_wxyz)
    np.testing.assert_allclose(error, np.zeros(3), atol=0.03)


def contact_force(arm, state):
    """Largest contact force of the last step [N]."""
    logged = state.log[:, COLUMN["fx"] : COLUMN["fz"] + 1]
    if hasattr(arm, "cabinet"):  # FRI sends no contact force; the cabinet knows it
        assert np.isnan(state.contact_force).all()
        assert np.isnan(logged).all()
        return np.linalg.norm(
            arm.ask("truth")["contact_force_peak"]
        )  # since last asked
    force = np.linalg.norm(state.contact_force)
    assert force == pytest.approx(np.linalg.norm(logged, axis=1).max())
    return force


def test_contact_is_felt_and_limited_by_the_command(arm):
    if has_own_clock(arm):
        pytest.skip(
            "franka-sim has no fixture to touch; contact on an FR3 is tried on twins: "
            "dovetail evaluate POLICY --twin medium with a policy for fr3"
        )
    arm.reset(start(arm, z=0.108), HOLE)
    for _ in range(20):
        force = contact_force(arm, arm.step(push([0.4, 0.0, -1.5])))
    assert 1.0 < force < 60.0


def test_speed_limit_raises_its_flag(arm):
    arm.reset(start(arm), HOLE)
    flags = 0
    for _ in range(10):
        flags |= arm.step(push([0.0, 12.0, 0.0])).flags
    walls = ("wall_position", "wall_velocity", "wall_acceleration")
    assert flags & sum(FLAG_MASK[name] for name in walls)


def test_reset_begins_an_equal_trial(arm):
    if has_own_clock(arm):
        pytest.skip(
            "franka-sim runs by the clock and has no seed: no two trials are equal; "
            "the simulated arms of this test are"
        )
    logs = []
    for _ in range(2):
        (arm if hasattr(arm, "seed") else arm.plant).seed(3)
        arm.reset(start(arm), HOLE)
        logs.append([arm.step(push([1.0, -0.5, -2.0])).log for _ in range(15)])
    np.testing.assert_array_equal(np.array(logs[0]), np.array(logs[1]))


@pytest.mark.parametrize("periods", [0.0, 0.6, 2.52, -10.0])
def test_duration_that_is_no_whole_number_of_periods_is_refused(arm, periods):
    arm.reset(start(arm), HOLE)
    duration = periods * arm.facts.period
    with pytest.raises(ConfigError, match="not a whole number of control periods"):
        arm.step(push([0.0, 0.0, 0.0]), duration=duration)


def test_engines_move_alike_in_free_air():
    logs = []
    for kind in ("mujoco", "bullet"):
        arm = build(kind)
        arm.reset(start(arm, z=0.25), HOLE)
        for i in range(20):
            f_star = 3.0 * np.array([np.sin(0.4 * i), np.cos(0.4 * i), 0.2])
            state = arm.step(push(f_star, theta=0.1))
        logs.append(state.tool.position)
        arm.close()
    np.testing.assert_allclose(logs[0], logs[1], atol=1e-4)


def test_facts_say_what_the_arm_was_built_with(arm):
    facts = arm.facts
    assert str(facts.task) == TASK
    assert facts.period == (0.001 if has_own_clock(arm) else 0.005)
    assert facts.osc.force_damping[0] == 16.0
    assert facts.limits.dq_max.shape == facts.robot.limits.dq_max.shape


def test_facts_say_whether_the_arm_can_be_disturbed_and_what_it_measures(arm):
    state = arm.reset(start(arm, z=0.115), HOLE)
    if is_simulated(arm):
        arm.move_fixture(HOLE, np.array([0.0, 0.0, 0.0]))
        arm.push(np.array([30.0, 0.0, 0.0]), 0.1)
        moved = arm.step(_core.Target(), 0.1)
        assert moved.tool.position[0] > state.tool.position[0] + 1e-3
    else:
        assert isinstance(arm, RemoteArm | FrankaArm)
    assert has_own_clock(arm) == isinstance(arm, FrankaArm)
    assert np.isnan(state.contact_force).all() == (
        not arm.facts.traits.measures_contact
    )


def test_stop_clear_and_seed_are_taken_and_the_arm_follows_again(arm):
    arm.reset(start(arm), HOLE)
    arm.seed(3)
    arm.stop()
    arm.clear()
    arm.reset(start(arm), HOLE)
    cycles = len(arm.step(_core.Target()).log)
    assert cycles > 0 if has_own_clock(arm) else cycles == 10
    assert isinstance(arm.statistics()["notes"], list)
