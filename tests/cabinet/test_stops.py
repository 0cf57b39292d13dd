"""Every end of a motion brings the arm to rest, and brakes hold it there."""

import numpy as np
import pytest

from dovetail.cabinet.body import ArmBody
from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.protocol import Quality, SafetyState, SessionState
from dovetail.cabinet.stops import DECELERATION, Ramp, StopCategory
from dovetail.envs.registered import find_cell
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from extras import need

from .conftest import FIXTURE, Q_START, LightPlant
from .test_wire import Direct, push_with

ACTIVE = SessionState.COMMANDING_ACTIVE
SPEED = 0.25  # m/s, of the TCP along y
CROOKED = DynamicsConfig(gravity_residual=(-0.2, 0.3, -0.4))
TWINS = ["easy", "medium", "hard"]


def build(name):
    if name == "crooked":
        plant = make_plant("mujoco", find_cell(), CROOKED)
    elif name == "bullet":
        need("pybullet")
        plant = make_plant("bullet", find_cell(), DynamicsConfig())
    else:
        plant = make_twin(load_twin(name), find_cell())
    plant.reset(Q_START, FIXTURE)
    return plant


def moving(plant, period):
    """A body whose TCP moves along y at SPEED."""
    body = ArmBody(plant, CabinetConfig(period=period))
    body.release()
    chain, last = plant.robot.chain(), plant.tool_pose().position
    for i in range(round(2.0 / period)):
        J = chain.jacobian(body.q)[:3]
        wanted = np.array([0.0, SPEED * min(1.0, i * period / 0.5), 0.0])
        tau = J.T @ (150.0 * (wanted - J @ body.dq)) - 1.5 * body.dq
        body.drive(body.q.tolist(), tau.tolist())
        now = plant.tool_pose().position
        if np.linalg.norm(now - last) / period > 0.95 * SPEED:
            return body
        last = now
    raise AssertionError("the arm never reached its speed")


@pytest.mark.parametrize("category", StopCategory)
@pytest.mark.parametrize("period", [0.001, 0.005])
@pytest.mark.parametrize(
    "name", [*TWINS, "crooked", pytest.param("bullet", marks=pytest.mark.bullet)]
)
def test_a_moving_arm_rests_within_a_tenth_of_a_second_and_5_mm(name, period, category):
    plant = build(name)
    body = moving(plant, period)
    start = plant.tool_pose().position
    body.stop(category)
    periods = 0
    while not body.is_braked:
        body.hold()
        periods += 1
        assert periods * period <= 0.1
    rest = plant.tool_pose().position
    assert np.linalg.norm(rest - start) < 0.005
    for _ in range(round(0.5 / period)):
        body.hold()
    np.testing.assert_array_equal(plant.tool_pose().position, rest)
    plant.close()


@pytest.mark.parametrize("name", ["easy", "hard"])
def test_an_arm_that_has_braked_can_move_again(name):
    plant = build(name)
    body = moving(plant, 0.005)
    body.stop(StopCategory.BRAKES)
    body.come_to_rest()
    before = body.q[0]
    body.release()
    for _ in range(20):
        body.drive(body.q.tolist(), [6.0, *[0.0] * 6])
    assert body.q[0] - before > 0.01


def test_a_ramp_leads_every_joint_along_a_straight_way_to_rest():
    q, dq = Q_START, np.array([0.6, -0.3, 0.0, 0.15, 0.0, 0.0, 0.0])
    ramp = Ramp(q, dq)
    last_q, last_dq, step = q, dq, 1e-4
    while not ramp.is_over:
        q_cmd, dq_cmd, _ = ramp.advance(step)
        np.testing.assert_allclose(
            q_cmd - last_q, 0.5 * step * (dq_cmd + last_dq), atol=1e-6
        )
        np.testing.assert_allclose(dq_cmd[0] * dq, dq[0] * dq_cmd, atol=1e-12)
        last_q, last_dq = q_cmd, dq_cmd
    assert not last_dq.any()
    assert ramp.time == pytest.approx(0.6 / DECELERATION, abs=2e-4)


def active(plant=None, **changes):
    direct = Direct(plant, restart_delay=None, **changes)
    direct.run_until(ACTIVE)
    direct.pass_period(push_with([1.0] * 7))
    return direct


def end_by(direct, cause):
    """End the motion as the cause does; a period later the arm is being stopped."""
    controller, answer = direct.controller, push_with([1.0] * 7)
    if cause == "speed":
        direct.controller.body.plant.dq[:] = 2.5
    elif cause == "torque":
        answer = push_with([400.0] * 7)
    elif cause.startswith("STOP"):
        controller.stop_safely(SafetyState[cause], 1.0)
    elif cause == "quality":
        controller.quality.forced = Quality.FAIR
    elif cause == "paused":
        controller.pause()
        direct.pass_period(answer)
    if cause == "silence":
        for _ in range(10):
            direct.pass_period(lambda message: None)
    else:
        direct.pass_period(answer)


@pytest.mark.parametrize(
    ("cause", "category"),
    [
        ("speed", 0),
        ("STOP_0", 0),
        ("STOP_1", 1),
        ("STOP_2", 2),
        ("torque", 1),
        ("silence", 1),
        ("quality", 1),
        ("paused", 1),
    ],
)
def test_each_cause_has_its_stop_category(cause, category):
    direct = active()
    end_by(direct, cause)
    assert direct.controller.body.category == category
    for _ in range(20):  # 0.1 s
        direct.pass_period()
    status = direct.controller.status()
    assert status["braked"]
    assert status["category"] == category
    assert status["stop_reason"]


def test_a_stop_at_once_overtakes_a_ramp():
    body = active(LightPlant()).controller.body
    body.stop()
    body.hold()
    body.stop(StopCategory.BRAKES)
    assert body.category is StopCategory.BRAKES
    assert body.plant.is_braked


@pytest.mark.parametrize("mode", ["torque", "wrench"])
def test_a_client_that_comes_back_in_time_goes_on(mode):
    plant = LightPlant()
    direct = Direct(plant, mode=mode)

    def answer(message):
        command = push_with([1.0] * 7)(message)
        command.wrench = [0.0] * 6
        return command

    direct.run_until(ACTIVE, answer)
    plant.dq[:] = 0.3
    for _ in range(9):
        direct.pass_period(lambda message: None)
    assert np.abs(plant.dq).max() < 0.2  # nearly all of the ramp
    plant.applied.clear()
    direct.pass_period(answer)
    assert direct.controller.application.has_motion
    if mode == "torque":
        assert plant.applied[0][0].tolist() == [1.0] * 7


@pytest.mark.parametrize(
    ("period", "held", "stop"),
    [(0.001, 3, 10), (0.002, 2, 10), (0.005, 1, 10), (0.01, 1, 5), (0.1, 1, 2)],
)
def test_missing_commands_count_by_number_and_by_time(period, held, stop):
    config = CabinetConfig(period=period)
    assert (config.held_misses, config.stop_misses) == (held, stop)
    given = CabinetConfig(period=period, hold_slots=7, stop_slots=70)
    assert (given.held_misses, given.stop_misses) == (7, 70)


def test_a_session_that_is_disposed_of_in_motion_leaves_the_arm_at_rest(make, client):
    client.answer = push_with([3.0, *[0.0] * 6])
    client.start()
    plant = LightPlant()
    with make(plant) as cabinet:
        client.wait_for(ACTIVE)
        while plant.q[0] == Q_START[0]:
            pass
        assert cabinet.request({"do": "stop"})["ok"]
        client.wait_for(SessionState.IDLE)
        assert cabinet.status()["braked"]
        assert not plant.dq.any()
