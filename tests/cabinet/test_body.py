"""Torque law, brakes, wire signs and sensors, on the simulated arm."""

from types import SimpleNamespace

import numpy as np
import pytest

from dovetail.cabinet.body import ArmBody
from dovetail.cabinet.command_policy import CommandPolicy
from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.late_path import LatePath
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError, PlantError
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose

from .conftest import FIXTURE, Q_START, LightPlant

PERIOD = 0.005
STILL = DynamicsConfig(damping=(0.0,) * 7)


@pytest.fixture
def plant():
    plant = MujocoPlant(find_cell(), STILL)
    plant.reset(Q_START, FIXTURE)
    return plant


def released(plant, **changes):
    body = ArmBody(plant, CabinetConfig(**changes))
    body.release()
    return body


def test_without_stiffness_the_clients_torque_alone_reaches_the_arm():
    plant = LightPlant()
    body = released(plant)
    body.drive([9.0] * 7, [0.1 * i for i in range(7)])
    (tau, dt), *rest = plant.applied
    assert not rest
    assert dt == PERIOD
    np.testing.assert_array_equal(tau, [0.1 * i for i in range(7)])


def test_gravity_is_compensated_so_that_zero_torque_stays(plant):
    body = released(plant)
    for _ in range(100):
        body.drive(Q_START.tolist(), [0.0] * 7)
    np.testing.assert_allclose(body.q, Q_START, atol=1e-6)


def test_the_impedance_pulls_to_the_commanded_position(plant):
    body = released(plant, stiffness=(200.0,) * 7, damping=(0.7,) * 7)
    target = Q_START + 0.05
    for _ in range(400):
        body.drive(target.tolist(), [0.0] * 7)
    np.testing.assert_allclose(body.q, target, atol=2e-3)


def test_the_impedance_yields_by_torque_over_stiffness(plant):
    body = released(plant, stiffness=(200.0,) * 7, damping=(1.0,) * 7)
    tau = [0.0, 4.0, 0.0, -2.0, 0.0, 0.0, 0.0]
    for _ in range(600):
        body.drive(Q_START.tolist(), tau)
    np.testing.assert_allclose(body.q - Q_START, np.array(tau) / 200.0, atol=1e-3)


def test_damping_is_a_share_of_critical_damping(plant):
    def overshoot(ratio):
        plant.reset(Q_START, FIXTURE)
        body = released(plant, stiffness=(200.0,) * 7, damping=(ratio,) * 7)
        target = Q_START + 0.03 * np.eye(7)[0]
        highest = 0.0
        for _ in range(400):
            body.drive(target.tolist(), [0.0] * 7)
            highest = max(highest, body.q[0] - target[0])
        return highest / 0.03

    assert overshoot(0.1) > 0.5
    assert 0.1 < overshoot(0.4) < 0.4
    assert overshoot(1.0) < 0.02


def test_behind_closed_brakes_nothing_moves():
    plant = LightPlant()
    body = ArmBody(plant, CabinetConfig())
    for _ in range(10):
        body.hold()
    assert plant.applied == []
    assert body.is_braked


@pytest.mark.parametrize("joint", range(7))
def test_the_brakes_stop_a_moving_arm(plant, joint):
    body = released(plant)
    while abs(body.dq[joint]) < 0.5:
        body.drive(body.q.tolist(), (10.0 * np.eye(7)[joint]).tolist())
    body.stop()
    periods = 0
    while not body.is_braked:
        body.hold()
        periods += 1
    assert np.abs(body.dq).max() < 0.005
    assert periods * PERIOD < 0.5


def test_the_arm_on_the_wire_leans_as_the_real_one_does(plant):
    """A2 > 0 leans forward: measured torque reads positive there, gravity included."""
    body = ArmBody(plant, CabinetConfig())
    body.hold()
    assert Q_START[1] > 0.0
    assert body.gravity[1] < -10.0  # the motor holds with a negative torque
    np.testing.assert_allclose(body.sensors.joint, body.gravity)


@pytest.mark.parametrize("state", ["braked", "held"])
def test_an_external_push_is_seen_in_its_own_direction(plant, state):
    body = ArmBody(plant, CabinetConfig(stiffness=(2000.0,) * 7, damping=(1.0,) * 7))
    force = np.array([0.0, 20.0, 0.0])
    wanted = plant.robot.chain().jacobian(Q_START)[:3].T @ force
    body.push(force, 10.0)
    if state == "braked":
        body.hold()
    else:
        body.release()
        for _ in range(300):
            body.drive(Q_START.tolist(), [0.0] * 7)
    np.testing.assert_allclose(body.sensors.external, wanted, atol=0.3)
    # static: what the drives hold against is gravity minus the push
    np.testing.assert_allclose(body.sensors.joint, body.gravity - wanted, atol=0.6)


def test_a_push_ends_after_its_duration():
    plant = LightPlant()
    body = released(plant)
    body.push(np.array([0.0, 10.0, 0.0]), 0.02)
    for _ in range(10):
        body.drive(Q_START.tolist(), [0.0] * 7)
    assert [bool(tau.any()) for tau, _ in plant.applied] == [True] * 4 + [False] * 6


def test_free_motion_is_no_external_torque(plant):
    body = released(plant, external_filter=0.02)
    largest = 0.0
    for i in range(200):
        tau = 3.0 * np.sin(0.05 * i) * np.eye(7)[i // 50]
        body.drive(body.q.tolist(), tau.tolist())
        largest = max(largest, float(np.abs(body.sensors.external).max()))
    assert largest < 0.2  # of 3 Nm commanded


def test_a_twins_noise_stays_small_in_the_external_torque():
    plant = make_twin(load_twin("medium"), find_cell())
    plant.reset(Q_START, FIXTURE)
    body = released(plant, stiffness=(500.0,) * 7, damping=(1.0,) * 7)
    readings = []
    for _ in range(400):
        body.drive(Q_START.tolist(), [0.0] * 7)
        readings.append(body.sensors.external)
    assert np.std(readings[200:], axis=0).max() < 2.0


def test_contact_is_remembered_until_it_is_asked_for():
    body = released(LightPlant())
    for _ in range(3):
        body.drive(Q_START.tolist(), [0.0] * 7)
    assert body.take_contact_peak() == (0.0, 0.0, 3.0)
    assert body.take_contact_peak() == (0.0, 0.0, 0.0)


def test_a_diverged_plant_stands_until_it_is_placed():
    plant = LightPlant()
    body = released(plant)

    def fail(tau, dt, drive=None):
        raise PlantError("diverged")

    works, plant.apply = plant.apply, fail
    body.drive(Q_START.tolist(), [0.0] * 7)
    assert "place the arm again" in body.failure
    plant.apply = works
    body.drive(Q_START.tolist(), [0.0] * 7)
    assert plant.applied == []
    body.place(Q_START, FIXTURE)
    body.release()
    body.drive(Q_START.tolist(), [0.0] * 7)
    assert len(plant.applied) == 1


def test_the_fixture_moves_during_a_motion(plant):
    body = released(plant)
    body.drive(Q_START.tolist(), [0.0] * 7)
    body.move_fixture(Pose(np.array([0.62, 0.01, 0.11]), FIXTURE.quat_wxyz))
    np.testing.assert_allclose(plant.data.mocap_pos[0], [0.62, 0.01, 0.11])
    with pytest.raises(ConfigError, match="too far"):
        body.move_fixture(Pose(np.array([3.0, 0.0, 0.1]), FIXTURE.quat_wxyz))


def test_a_fixture_with_a_velocity_moves_on_while_the_arm_does():
    plant = LightPlant()
    body = ArmBody(plant, CabinetConfig())
    there = Pose(np.array([0.62, 0.0, 0.1]), FIXTURE.quat_wxyz)
    velocity = np.array([0.0, 0.02, 0.0])
    body.move_fixture(there, velocity)
    body.hold()
    assert plant.fixture is there  # behind brakes no time passes
    body.release()
    for _ in range(10):
        body.drive(Q_START.tolist(), [0.0] * 7)
    moved = 10 * body.period * velocity
    np.testing.assert_allclose(plant.fixture.position, there.position + moved)
    body.move_fixture(there)
    body.drive(Q_START.tolist(), [0.0] * 7)
    assert plant.fixture is there
    body.move_fixture(there, velocity)
    body.place(Q_START, FIXTURE)
    body.release()
    body.drive(Q_START.tolist(), [0.0] * 7)
    assert plant.fixture is FIXTURE


def test_a_moving_fixture_stops_at_the_end_of_the_reach_and_the_cabinet_goes_on():
    plant = LightPlant()
    body = ArmBody(plant, CabinetConfig())
    body.release()
    body.move_fixture(FIXTURE, np.array([100.0, 0.0, 0.0]))
    body.drive(Q_START.tolist(), [0.0] * 7)
    body.drive(Q_START.tolist(), [0.0] * 7)
    assert not body.failure
    assert plant.fixture.position[0] < 1.2


def test_position_mode_follows_the_commanded_position(plant):
    body = released(plant, mode="position")
    for i in range(200):
        q_cmd = Q_START + 0.05 * np.sin(0.03 * i)
        body.drive(q_cmd.tolist(), [0.0] * 7)
    np.testing.assert_allclose(body.q, q_cmd, atol=2e-3)


def test_wrench_mode_pushes_the_tool_in_the_wrenchs_direction(plant):
    body = released(plant, mode="wrench", stiffness=(50.0,) * 7, damping=(1.0,) * 7)
    before = plant.tool_pose().position
    for _ in range(60):
        body.drive(Q_START.tolist(), [0.0] * 7, [0.0, 8.0, 0.0, 0.0, 0.0, 0.0])
    moved = plant.tool_pose().position - before
    assert moved[1] > 0.01
    assert abs(moved[0]) < 0.3 * moved[1]


def test_the_commanded_torque_of_a_motion_is_the_clients_without_impedance(plant):
    body = released(plant, stiffness=(200.0,) * 7, damping=(0.7,) * 7)
    far = (Q_START + 0.05).tolist()
    body.drive(far, [1.5] * 7)
    np.testing.assert_array_equal(body.overlay, [1.5] * 7)
    assert np.abs(body.tau - body.overlay).max() > 5.0


@pytest.mark.parametrize("twin", ["easy", "medium", "hard"])
@pytest.mark.parametrize("period", [0.001, 0.005])
@pytest.mark.parametrize("amplitude", [0.04, 0.3])  # rad; 0.04 is KUKA's own sample
def test_every_twin_follows_a_joint_sine_as_late_as_its_wire_is(
    twin, period, amplitude
):
    plant = make_twin(load_twin(twin), find_cell())
    plant.reset(Q_START, FIXTURE)
    config = CabinetConfig(mode="position", period=period)
    body = released(plant, mode="position", period=period)
    policy = CommandPolicy(config, plant.robot)
    policy.begin(Q_START.tolist())

    def sine(time):
        return Q_START + amplitude * np.sin(0.5 * np.pi * max(time, 0.0)) * np.eye(7)[3]

    for i in range(round(2.0 / period)):
        time = i * period
        command = SimpleNamespace(q=sine(time).tolist(), tau=None, wrench=None)
        stop = policy.act(command, body.q.tolist(), body.gravity.tolist())
        body.drive(policy.q, policy.tau, policy.wrench)
        stop = stop or policy.check_joints(body.q.tolist(), body.dq.tolist())
        assert not stop, time
        late = sine(time - plant.command_delay)
        np.testing.assert_allclose(body.q, late, atol=3e-3)


def test_a_late_path_is_the_commanded_one_so_much_later():
    path, points = LatePath(0.005, 0.012), []
    for i in range(8):
        points.append(np.full(7, float(i * i)))
        path.add(points[-1])
    # In the period that leads from point 6 to point 7, from 0 to 5 ms:
    position, velocity = path.passed(0.005)  # 12 ms before point 7
    np.testing.assert_allclose(position, points[4] + 0.6 * (points[5] - points[4]))
    np.testing.assert_allclose(velocity, (points[5] - points[4]) / 0.005)
    assert path.held(0.001)[0] == points[4][0]
    assert path.held(0.003)[0] == points[5][0]


def test_a_twins_delay_is_on_the_wire_and_not_inside_the_drives():
    plant = make_twin(load_twin("hard"), find_cell())
    plant.reset(Q_START, FIXTURE)
    zero, pull = np.zeros(7), np.array([20.0, *[0.0] * 6])
    plant.apply(zero, 0.005, pull)
    assert plant.read()[1][0] > 0.01
    plant.reset(Q_START, FIXTURE)
    plant.apply(pull, 0.005)
    assert abs(plant.read()[1][0]) < 0.03  # the noise's
    plant.drop_commands()
    for _ in range(4):
        plant.apply(zero, 0.005)
    assert abs(plant.read()[1][0]) < 0.03
