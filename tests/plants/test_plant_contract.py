"""What every physics engine must do alike; one file for all of them."""

import re
import sys

import numpy as np
import pytest

from dovetail.control.period import PERIODS
from dovetail.envs.registered import find_cell
from dovetail.errors import (
    ConfigError,
    MissingDependencyError,
    PlantError,
    install_command,
)
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig, physics_steps
from dovetail.poses import Pose, quat_about_z, rotation_error
from plants.conftest import HOLE, Q_BENT, TOOL_DOWN, start_above

ZERO = (0.0,) * 7
NO_FRICTION = {"damping": ZERO, "armature": ZERO}
DT = 0.005


def test_free_fall_starts_with_the_acceleration_of_the_model(make):
    plant = make(gravity_compensation=False, **NO_FRICTION)
    chain = plant.robot.chain()
    plant.reset(Q_BENT, HOLE)
    plant.apply(np.zeros(7), 0.001)
    _, dq = plant.read()
    expected = np.linalg.solve(chain.inertia_matrix(Q_BENT), -chain.gravity(Q_BENT))
    np.testing.assert_allclose(dq / 0.001, expected, rtol=1e-6, atol=1e-6)


def test_free_fall_keeps_its_energy(make):
    plant = make(gravity_compensation=False, physics_dt=2e-4, **NO_FRICTION)
    chain = plant.robot.chain()
    plant.reset(Q_BENT, HOLE)
    work = 0.0  # of gravity [J], trapezoidal
    q, dq = plant.read()
    power = -chain.gravity(q) @ dq
    for _ in range(150):
        plant.apply(np.zeros(7), 0.001)
        q, dq = plant.read()
        last, power = power, -chain.gravity(q) @ dq
        work += 0.0005 * (last + power)
    kinetic = 0.5 * dq @ chain.inertia_matrix(q) @ dq
    assert work > 1.0
    assert kinetic == pytest.approx(work, rel=0.01)


def test_pendulum_has_the_period_of_its_inertia(make):
    # Gravity along +x, the arm along +x: A1 swings, the other joints are stuck fast.
    stuck = (0.0, *(50.0,) * 6)
    plant = make(
        gravity_compensation=False,
        gravity_residual=(9.81, 0.0, 9.81),
        damping=ZERO,
        armature=(0.1, *(10.0,) * 6),
        coulomb=stuck,
        physics_dt=0.001,
    )
    chain = plant.robot.chain(gravity=(9.81, 0.0, 0.0))
    q_rest = np.array([0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    step = np.eye(7)[0] * 1e-4
    slope = (chain.gravity(q_rest + step) - chain.gravity(q_rest - step))[0] / 2e-4
    inertia = chain.inertia_matrix(q_rest)[0, 0] + 0.1
    expected = 2.0 * np.pi * np.sqrt(inertia / slope)
    plant.reset(q_rest + 500.0 * step, HOLE)
    crossings, last = [], 0.05
    for i in range(int(2.6 * expected / 0.001)):
        plant.apply(np.zeros(7), 0.001)
        now = plant.read()[0][0]
        if last < 0.0 <= now:
            crossings.append((i + last / (last - now)) * 0.001)
        last = now
    assert crossings[1] - crossings[0] == pytest.approx(expected, rel=3e-3)


def test_gravity_torque_of_the_model_holds_the_arm_still(make):
    plant = make(gravity_compensation=False)
    tau = plant.robot.chain().gravity(Q_BENT)
    plant.reset(Q_BENT, HOLE)
    for _ in range(100):
        plant.apply(tau, DT)
    np.testing.assert_allclose(plant.read()[0], Q_BENT, atol=1e-6)


def test_compensated_arm_without_torque_stays(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    for _ in range(100):
        plant.apply(np.zeros(7), DT)
    np.testing.assert_allclose(plant.read()[0], Q_BENT, atol=1e-6)


@pytest.mark.parametrize("name", ["drake", "pybullet", "lbr"])
def test_inertia_matrix_agrees_with_the_model(make, name):
    plant = make(inertia=name)
    chain = plant.cell.loaded_robot(name).chain()
    rng = np.random.default_rng(3)
    h = 0.001
    gravity = plant.robot.chain().gravity  # what is compensated: the nominal one
    for _ in range(3):
        q = Q_BENT + rng.uniform(-0.3, 0.3, 7)
        M = chain.inertia_matrix(q) + np.diag([0.1 + h * 0.5] * 7)
        for tau in 5.0 * np.eye(7):
            plant.reset(q, HOLE)
            plant.apply(tau, h)
            ddq = plant.read()[1] / h
            expected = tau + gravity(q) - chain.gravity(q)
            np.testing.assert_allclose(M @ ddq, expected, atol=1e-5)


def test_tool_pose_agrees_with_the_model(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    expected = plant.robot.tool_pose(Q_BENT)
    pose = plant.tool_pose()
    np.testing.assert_allclose(pose.position, expected.position, atol=1e-7)
    error = rotation_error(pose.quat_wxyz, expected.quat_wxyz)
    np.testing.assert_allclose(error, np.zeros(3), atol=1e-6)


@pytest.mark.parametrize("force", [5.0, 30.0])
def test_static_press_on_the_block_is_felt_in_full(make, force):
    plant = make()
    chain = plant.robot.chain()
    q = start_above(plant.robot, x=0.635, z=0.102)
    plant.reset(q, HOLE)
    start = plant.robot.tool_pose(q)
    for _ in range(300):
        q, dq = plant.read()
        pose = plant.robot.tool_pose(q)
        J = chain.jacobian(q)
        spring = 2000.0 * (start.position - pose.position)
        turn = 30.0 * rotation_error(TOOL_DOWN, pose.quat_wxyz)
        wrench = np.array([spring[0], spring[1], -force, *turn])
        plant.apply(J.T @ wrench - 3.0 * dq, DT)
    measured = plant.contact_force()
    assert np.abs(dq).max() < 1e-3
    assert measured[2] == pytest.approx(force, rel=0.02)
    assert np.linalg.norm(plant.contact_force_peak()) >= 0.99 * np.linalg.norm(measured)


def test_no_contact_no_force(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    plant.apply(np.zeros(7), DT)
    np.testing.assert_array_equal(plant.contact_force(), np.zeros(3))


def play(plant, hole, steps=60):
    """Press and drag over the block with seeded torques; return all states."""
    rng = np.random.default_rng(5)
    chain = plant.robot.chain()
    q = start_above(plant.robot, x=0.63, z=0.103)
    plant.reset(q, hole)
    states = []
    for _ in range(steps):
        wrench = np.array([*rng.uniform(-15.0, 15.0, 2), -20.0, 0.0, 0.0, 0.0])
        plant.apply(chain.jacobian(q).T @ wrench, DT)
        states.append(np.concatenate([*plant.read(), plant.contact_force()]))
    return np.array(states)


def test_reset_forgets_everything(make):
    plant = make()
    first = play(plant, HOLE)
    assert np.abs(first[:, 14:]).max() > 1.0  # it did touch
    play(plant, Pose(np.array([0.55, 0.05, 0.12]), quat_about_z(0.3)))
    np.testing.assert_array_equal(play(plant, HOLE), first)


def test_two_plants_of_one_configuration_move_alike(make):
    np.testing.assert_array_equal(play(make(), HOLE), play(make(), HOLE))


def test_configure_equals_a_new_plant(make):
    changed = {"mass_scale": (1.2,) * 7, "coulomb": (0.3,) * 7, "inertia": "lbr"}
    plant = make()
    play(plant, HOLE)
    other = make(**changed)
    plant.configure(other.dynamics)
    np.testing.assert_array_equal(play(plant, HOLE), play(other, HOLE))


def test_the_hole_turns_and_moves_with_its_pose(make):
    plant = make()
    pose = Pose(np.array([0.55, 0.08, 0.13]), quat_about_z(0.4))
    q = start_above(plant.robot, 0.55, 0.08, 0.11, theta=0.4)
    plant.reset(q, pose)  # 20 mm inside the hole, aligned: touches nothing
    plant.apply(np.zeros(7), 0.001)
    np.testing.assert_array_equal(plant.contact_force(), np.zeros(3))
    plant.reset(q, pose._replace(quat_wxyz=quat_about_z(0.46)))
    plant.apply(np.zeros(7), 0.001)
    assert np.linalg.norm(plant.contact_force()) > 1.0


def test_torque_before_reset_is_refused(make):
    with pytest.raises(PlantError, match="not reset"):
        make().apply(np.zeros(7), DT)


def test_hole_out_of_reach_is_refused_with_the_distance(make):
    plant = make()
    with pytest.raises(ConfigError, match=r"too far by 0\.\d+ m"):
        plant.reset(Q_BENT, HOLE._replace(position=np.array([1.1, 0.0, 0.1])))
    with pytest.raises(ConfigError, match=r"inside the table"):
        plant.reset(Q_BENT, HOLE._replace(position=np.array([0.6, 0.0, 0.02])))


def test_without_pybullet_its_plant_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(
        MissingDependencyError, match=re.escape(install_command("bullet"))
    ):
        make_plant("bullet", find_cell(), DynamicsConfig())


def test_configuration_with_nan_is_refused_by_joint(make):
    q = Q_BENT.copy()
    q[4] = np.nan
    with pytest.raises(ConfigError, match="A5"):
        make().reset(q, HOLE)


def push(plant, tau, steps):
    for _ in range(steps):
        plant.apply(tau, DT)


def test_divergence_is_an_error_and_reset_recovers(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    with pytest.raises(PlantError, match="diverged"):
        push(plant, np.full(7, 1e5), 200)
    plant.reset(Q_BENT, HOLE)
    plant.apply(np.zeros(7), DT)
    np.testing.assert_allclose(plant.read()[0], Q_BENT, atol=1e-6)


@pytest.mark.parametrize(
    ("period", "physics_dt", "steps"),
    [(0.005, 0.0025, 2), (0.001, 0.0025, 1), (0.005, 0.005, 1), (0.005, 0.002, 3)],
)
def test_period_is_split_into_equal_steps(period, physics_dt, steps):
    assert physics_steps(period, physics_dt) == steps


@pytest.mark.parametrize("contact_time", [0.002, 0.005, 0.02])
def test_a_contact_is_as_stiff_at_every_period(contact_time):
    """The peg is pushed on the block by 30 N from 2 mm above it."""
    cell, peaks = find_cell(), []
    for period in PERIODS:
        dynamics = DynamicsConfig(contact_time=contact_time)
        plant = make_plant("mujoco", cell, dynamics)
        above = Pose(HOLE.position + np.array([0.035, 0.0, 0.002]), TOOL_DOWN)
        plant.reset(plant.robot.inverse_kinematics(above, Q_BENT), HOLE)
        plant.push(np.array([0.0, 0.0, -30.0]))
        forces = []
        for _ in range(round(0.15 / period)):
            plant.apply(np.zeros(7), period)
            forces.append(np.linalg.norm(plant.contact_force_peak()))
        peaks.append(max(forces))
    assert min(peaks) > 50.0
    assert max(peaks) < 1.3 * min(peaks)  # the step hits the block in another phase


def test_closed_brakes_stop_the_arm_and_hold_it_under_a_wrong_gravity(make):
    plant = make(gravity_residual=(2.0, -2.0, 3.0))
    brakes = plant.robot.limits.tau_max
    plant.reset(Q_BENT, HOLE)
    for _ in range(40):
        plant.apply(np.zeros(7), DT)
    assert np.abs(plant.read()[1]).max() > 0.5
    plant.close_brakes(brakes)
    for _ in range(20):
        plant.apply(np.zeros(7), 0.001)
    held, dq = plant.read()
    assert np.abs(dq).max() < 5e-3
    for _ in range(200):
        plant.apply(np.zeros(7), DT)
    np.testing.assert_allclose(plant.read()[0], held, atol=5e-4)
    plant.open_brakes()
    for _ in range(40):
        plant.apply(np.zeros(7), DT)
    assert np.abs(plant.read()[0] - held).max() > 1e-3


def test_a_reset_opens_the_brakes(make):
    plant = make()
    plant.reset(Q_BENT, HOLE)
    plant.close_brakes(plant.robot.limits.tau_max)
    plant.reset(Q_BENT, HOLE)
    plant.apply(np.full(7, 5.0), DT)
    assert np.abs(plant.read()[1]).max() > 0.01
