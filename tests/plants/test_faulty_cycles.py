"""Lost, repeated and late cycles in the loop over MuJoCo."""

import numpy as np
import pytest

from dovetail import _bench, _core
from dovetail.control.build import make_controller
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.envs.registered import find_cell
from dovetail.plants.mujoco_plant import MujocoPlant
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS, DynamicsConfig

from .conftest import HOLE, Q_SEED

TASK = "XYZ:force A:pose BC:hold"
PERIOD, STEPS = 0.002, 2
TAU = slice(COLUMN["tau1"], COLUMN["tau7"] + 1)
Q = slice(COLUMN["q1"], COLUMN["q7"] + 1)
DQ = slice(COLUMN["dq1"], COLUMN["dq7"] + 1)


class Rig:
    """A plant, its loop and a controller at the start."""

    def __init__(self):
        self.plant = MujocoPlant(find_cell(), DynamicsConfig(physics_dt=1e-3))
        self.robot = self.plant.robot
        self.controller = self.make_controller()
        self.plant.reset(Q_SEED, HOLE)
        self.plant.model.opt.timestep = PERIOD / STEPS
        self.target = _core.Target(f_star=np.array([1.0, -2.0, 0.5, 0.0, 0.0, 0.0]))
        self.target.quat_wxyz_d = self.robot.tool_pose(Q_SEED).quat_wxyz

    def make_controller(self):
        controller = make_controller(
            self.robot,
            OscConfig.for_period(PERIOD),
            LimitConfig.for_period(self.robot, PERIOD),
            TASK,
            PERIOD,
        )
        controller.reset(Q_SEED, *self.robot.tool_pose(Q_SEED))
        return controller

    def run(self, faults):
        log = np.empty((len(faults), len(CYCLE_COLUMNS)))
        codes = np.array(faults, dtype=np.int8)
        self.plant._loop.run_faulty(self.controller, self.target, STEPS, codes, log)
        return log

    def answers(self, log, calls):
        """Return the torques of a controller of its own, called as `calls` says.

        The time since its last cycle is in its estimate alone, so that is compared.
        """
        controller = self.make_controller()
        tau = {}
        for cycle, seen, elapsed in calls:
            row = log[seen]
            tau[cycle] = controller.step(
                row[Q], row[DQ], self.target, elapsed * PERIOD
            ).tau
        np.testing.assert_array_equal(
            self.controller.disturbance, controller.disturbance
        )
        return tau


@pytest.fixture
def rig():
    return Rig()


def test_without_faults_it_is_the_loop_itself(rig):
    log = rig.run([0] * 30)
    other = Rig()
    plain = np.empty_like(log)
    other.plant._loop.run(other.controller, other.target, STEPS, plain)
    np.testing.assert_array_equal(log, plain)


@pytest.mark.parametrize(("code", "told"), [(-1, 4), (-2, 1)])
def test_lost_cycles_hold_the_last_torque_and_tell_the_time_if_they_can(
    rig, code, told
):
    log = rig.run([0, 0, code, code, code, 0])
    np.testing.assert_array_equal(log[2:5, TAU], np.tile(log[1, TAU], (3, 1)))
    expected = rig.answers(log, [(0, 0, 1), (1, 1, 1), (5, 5, told)])
    np.testing.assert_array_equal(log[5, TAU], expected[5])
    assert np.abs(log[5, TAU] - log[1, TAU]).max() > 1e-6


def test_a_late_cycle_sees_an_old_state(rig):
    log = rig.run([0, 0, 0, 2, 3])
    calls = [(0, 0, 1), (1, 1, 1), (2, 2, 1), (3, 1, 1), (4, 1, 1)]
    expected = rig.answers(log, calls)
    np.testing.assert_array_equal(log[3, TAU], expected[3])
    np.testing.assert_array_equal(log[4, TAU], expected[4])


def test_the_judge_looks_at_each_physics_step_and_pushes(rig):
    judge = _bench.ContactJudge(rig.robot.chain(), rig.controller.limits)
    rig.plant._loop.attach_probe(judge, rig.plant._pushed)
    judge.set_push(np.array([0.0, 40.0, 0.0]))
    pushed = rig.run([0] * 50)
    assert judge.looks == 50 * STEPS
    gravity = [rig.robot.chain().gravity(q) for q in pushed[:, Q]]
    motor = np.abs(pushed[:, TAU] + gravity) / rig.controller.limits.tau_max
    assert judge.torque.value == pytest.approx(motor.max())
    free = Rig().run([0] * 50)
    y = COLUMN["y"]
    assert pushed[-1, y] > free[-1, y] + 1e-3
    rig.plant._loop.attach_probe(None, 0)
    rig.run([0])
    assert judge.looks == 50 * STEPS
