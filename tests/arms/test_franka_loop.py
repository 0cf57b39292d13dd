"""The loop of a Franka: orders in, torques out, and what it does without orders."""

import multiprocessing
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from dovetail import _core
from dovetail.arms.franka import loop as loop_module
from dovetail.arms.franka.loop import (
    COLUMNS,
    ROWS,
    Clear,
    End,
    Latch,
    Loop,
    Order,
    Seen,
    Stop,
)
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.robots.fr3 import fr3

ROBOT = fr3()
START = ROBOT.posture("down")


class Control:
    """A Franka's motion: the exact arm, with the interface of libfranka."""

    def __init__(self) -> None:
        motors = ROBOT.motors
        self.plant = _core.RigidPlant(
            ROBOT.chain(), damping=motors.damping, armature=motors.armature
        )
        self.plant.reset(START, np.zeros(7))
        self.tau = np.zeros(7)
        self.duration = 1e-3
        self.is_finished = False
        self.rates: list[float] = []

    def readOnce(self) -> tuple[SimpleNamespace, SimpleNamespace]:  # noqa: N802
        q, dq = self.plant.read()
        state = SimpleNamespace(
            q=q.tolist(),
            dq=dq.tolist(),
            tau_J_d=self.tau.tolist(),
            tau_ext_hat_filtered=[0.0] * 7,
            control_command_success_rate=1.0,
        )
        return state, SimpleNamespace(to_sec=lambda: self.duration)

    def writeOnce(self, command: SimpleNamespace) -> None:  # noqa: N802
        tau = np.array(command.tau)
        self.rates.append(float(np.abs(tau - self.tau).max()) / 1e-3)
        self.tau = tau
        self.plant.apply(tau, self.duration)
        self.is_finished = getattr(command, "motion_finished", False)


class Bench:
    """A loop, its arm and the learner's end of the pipe."""

    def __init__(self, rows: int = ROWS) -> None:
        self.pipe, theirs = multiprocessing.Pipe()
        settings = ControllerSettings(
            osc=OscConfig.for_period(1e-3),
            limits=LimitConfig.for_period(ROBOT, 1e-3, walls=False),
            task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
            period=1e-3,
        )
        self.control = Control()
        self.log = np.zeros((rows, len(COLUMNS)))
        self.loop = Loop(theirs, ROBOT, settings, self.log)
        self.loop.begin(START)
        self.running = self.loop.cycles(
            self.control, lambda tau: SimpleNamespace(tau=tau)
        )

    def run(self, cycles: int) -> None:
        """Run so many cycles, or to the end."""
        for _ in range(cycles):
            if next(self.running, None) is None:
                return

    def seen(self) -> Seen:
        """Return the last state that was sent."""
        found = None
        while self.pipe.poll(1.0 if found is None else 0.0):
            found = self.pipe.recv()
        assert isinstance(found, Seen)
        return found

    def speed(self) -> float:
        """Return the fastest joint's speed [rad/s]."""
        return float(np.abs(self.control.plant.read()[1]).max())


def push_forward(f_star: float = 2.0) -> _core.Target:
    target = _core.Target()
    target.f_star = np.array([f_star, 0.0, 0.0, 0.0, 0.0, 0.0])
    target.quat_wxyz_d = ROBOT.tool_pose(START).quat_wxyz
    return target


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.pipe.close()
    made.running.close()


def test_without_an_order_the_arm_stays_where_it_is(bench: Bench) -> None:
    bench.run(500)
    assert np.abs(bench.control.plant.read()[0] - START).max() < 1e-3
    assert bench.loop.counts.held == 500


def test_an_order_is_followed_for_its_cycles_and_answered_with_their_rows(
    bench: Bench,
) -> None:
    bench.pipe.send(Order.of(push_forward(), 50, 150))
    bench.run(51)
    seen = bench.seen()
    assert seen.tick == 50
    assert seen.first == 0
    assert bench.log[49, 0] == pytest.approx(0.049)
    assert not bench.log[51:].any()
    moved = ROBOT.tool_pose(seen.q).position - ROBOT.tool_pose(START).position
    assert moved[0] > 1e-4


def test_a_late_learner_leaves_the_arm_held_and_goes_on_when_it_comes(
    bench: Bench,
) -> None:
    bench.pipe.send(Order.of(push_forward(), 50, 150))
    bench.run(50 + 150 + 600)
    assert bench.speed() < 5e-3
    assert bench.loop.counts.held >= 599
    bench.pipe.send(Order.of(push_forward(), 50, 150))
    bench.run(60)
    assert bench.speed() > 1e-2


def test_a_stop_holds_until_it_is_cleared(bench: Bench) -> None:
    bench.pipe.send(Order.of(push_forward(), 200, 150))
    bench.run(100)
    bench.pipe.send(Stop())
    bench.run(1)
    assert bench.seen().problem
    bench.run(600)
    assert bench.speed() < 5e-3
    bench.pipe.send(Order.of(push_forward(), 200, 150))
    bench.run(100)
    assert bench.speed() < 5e-3
    bench.pipe.send(Clear())
    bench.pipe.send(Order.of(push_forward(), 200, 150))
    bench.run(100)
    assert bench.speed() > 1e-2


def test_after_a_stop_only_a_new_order_moves_the_arm(bench: Bench) -> None:
    bench.pipe.send(Order.of(push_forward(), 2000, 150))
    bench.run(300)
    bench.pipe.send(Stop())
    bench.run(600)
    assert bench.speed() < 5e-3
    bench.pipe.send(Clear())
    bench.run(200)
    assert bench.speed() < 5e-3
    begin = bench.seen().tick
    bench.pipe.send(Order.of(push_forward(), 50, 150))
    bench.run(60)
    assert bench.seen().tick - begin < 900
    assert bench.speed() > 1e-2


@pytest.mark.parametrize("how", ["told", "gone", "stopped"])
def test_a_fast_arm_is_at_rest_within_a_fifth_of_a_second(
    bench: Bench, how: str
) -> None:
    bench.pipe.send(Order.of(push_forward(), 1000, 150))
    bench.run(400)
    assert bench.speed() > 0.5
    if how == "gone":
        bench.pipe.close()  # as where the learner was killed
    else:
        bench.pipe.send(End() if how == "told" else Stop())
    bench.run(200)
    assert bench.speed() < 0.02
    assert bench.control.is_finished == (how != "stopped")


def test_lost_messages_do_not_make_an_order_longer(bench: Bench) -> None:
    bench.control.duration = 15e-3
    bench.pipe.send(Order.of(push_forward(0.5), 50, 150))
    bench.run(4)
    assert not bench.pipe.poll()
    bench.run(1)
    seen = bench.seen()
    assert (seen.tick, seen.time) == (4, pytest.approx(0.060))
    bench.run(14 - 5)
    assert bench.loop.counts.held == 0
    bench.run(1)  # 210 ms
    assert bench.loop.counts.held == 1


def test_a_target_ages_by_the_arms_clock(bench: Bench) -> None:
    bench.control.duration = 5e-3
    bench.pipe.send(Order.of(push_forward(0.5), 50, 150))
    bench.run(5)
    assert bench.loop._target is not None
    assert bench.loop._target.age == pytest.approx(1e-3 + 4 * 5e-3)


def test_a_motion_that_does_not_come_to_rest_ends_by_the_arms_clock(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_module, "_REST_SPEED", 0.0)
    bench.run(10)
    bench.control.duration = 5e-3
    bench.pipe.send(End())
    bench.run(99)
    assert not bench.control.is_finished
    bench.run(3)
    assert bench.control.is_finished


def test_the_torque_is_written_before_the_answer(bench: Bench) -> None:
    answered: list[bool] = []
    write = bench.control.writeOnce

    def look_and_write(command: SimpleNamespace) -> None:
        answered.append(bench.pipe.poll())
        write(command)

    bench.control.writeOnce = look_and_write  # type: ignore[method-assign]
    bench.pipe.send(Order.of(push_forward(), 50, 150))
    bench.run(51)
    assert not any(answered)
    assert bench.pipe.poll()


def test_rows_that_the_learner_was_told_of_are_not_written_over_meanwhile() -> None:
    bench = Bench(rows=100)
    bench.run(250)
    seen = bench.loop.seen()
    rows = np.arange(seen.first, seen.tick) % 100
    assert len(rows) > 0
    before = bench.log[rows].copy()
    bench.run(50)
    np.testing.assert_array_equal(bench.log[rows], before)


def test_torques_change_slowly_whatever_is_ordered(bench: Bench) -> None:
    rng = np.random.default_rng(0)
    for _ in range(40):
        bench.pipe.send(Order.of(push_forward(float(rng.choice([-30, 30]))), 50, 0))
        bench.run(60)
    assert 500.0 < max(bench.control.rates) < 1000.0


def test_lost_messages_count_and_the_next_torque_starts_from_what_arrived(
    bench: Bench,
) -> None:
    bench.pipe.send(Order.of(push_forward(30.0), 1000, 150))
    bench.run(100)
    bench.control.duration = 5e-3
    bench.run(3)
    assert bench.loop.counts.lost == 3 * 4
    assert max(bench.control.rates) < 1000.0


def test_a_latched_pose_is_held(bench: Bench) -> None:
    pose = ROBOT.tool_pose(START)
    bench.pipe.send(Latch(pose.position, pose.quat_wxyz))
    bench.pipe.send(Order.of(push_forward(0.0), 300, 0))
    bench.run(300)
    seen_pose = ROBOT.tool_pose(bench.control.plant.read()[0])
    assert np.abs(seen_pose.position - pose.position).max() < 1e-3
