"""The arm that a service owns: a stop is never lost, whatever happens meanwhile."""

import contextlib
import threading
from dataclasses import replace
from types import SimpleNamespace

import pytest

from dovetail.arms.address import parse_address
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.errors import ArmError, ConfigError
from dovetail.rpc.arm_host import ArmHost
from dovetail.rpc.offered_arm import OfferedArm

from .conftest import HOLE, push
from .recording_arm import RecordingArm


@pytest.fixture
def host(builder, settings):
    osc, limits, task, period = settings
    host = ArmHost(builder)
    task = TaskSpec.parse(task)
    host.configure(
        ControllerSettings(osc=osc, limits=limits, task=task, period=period), b"1"
    )
    yield host
    host.close()


def test_a_stop_while_another_thread_rebuilds_the_arm_is_no_error(builder):
    class Rebuilt(ArmHost):
        """The arm is there when it is looked for, and gone at the next look."""

        @property
        def _arm(self):
            return self.__dict__.pop("arm", None)

        @_arm.setter
        def _arm(self, arm):
            self.arm = arm

    for use in (lambda host: host.stop("now", is_ordered=False), ArmHost.notes):
        host = Rebuilt(builder)
        host.arm = SimpleNamespace(stop=int, statistics=lambda: {"notes": ["slow"]})
        assert use(host) in (None, ["slow"])
        assert "arm" not in vars(host)


@pytest.mark.parametrize("is_ordered", [False, True])
def test_a_stop_during_a_step_bars_the_next(host, builder, start, is_ordered):
    host.reset(start, HOLE, None)
    step = builder.arm.step

    def stopped_meanwhile(target, duration):
        host.stop("for this test", is_ordered=is_ordered)
        return step(target, duration)

    builder.arm.step = stopped_meanwhile
    host.step(push(0.0), 0.05)
    with pytest.raises(ArmError, match="for this test"):
        host.step(push(0.0), 0.05)


@pytest.mark.parametrize("is_ordered", [False, True])
def test_a_stop_during_a_reset_outlives_it(host, builder, start, is_ordered):
    host.stop("before", is_ordered=False)
    reset = builder.arm.reset

    def stopped_meanwhile(q, hole):
        host.stop("during", is_ordered=is_ordered)
        return reset(q, hole)

    builder.arm.reset = stopped_meanwhile
    host.reset(start, HOLE, None)
    assert host.stop_reason == "during"
    with pytest.raises(ArmError, match="during"):
        host.step(push(0.0), 0.05)


def test_stops_from_many_threads_are_not_lost(host, start):
    host.reset(start, HOLE, None)
    for _ in range(50):
        threads = [
            threading.Thread(
                target=host.stop, args=("now",), kwargs={"is_ordered": True}
            )
            for _ in range(2)
        ]
        for thread in threads:
            thread.start()
        with contextlib.suppress(ArmError):
            host.step(push(0.0), 0.005)
        for thread in threads:
            thread.join()
        assert host.stop_reason == "now"
        host.clear()
        assert host.stop_reason == ""


def test_an_order_to_stop_is_stronger_than_a_learner_that_left(host):
    host.stop("left", is_ordered=False)
    host.stop("hand in the cell", is_ordered=True)
    host.stop("left again", is_ordered=False)
    assert host.stop_reason == "hand in the cell"


def test_settings_do_not_change_during_a_step(host, builder, start):
    host.reset(start, HOLE, None)
    step = builder.arm.step

    def configured_meanwhile(target, duration):
        with pytest.raises(ArmError, match="a step or reset is under way"):
            host.configure(host.settings, b"2")
        return step(target, duration)

    builder.arm.step = configured_meanwhile
    host.step(push(0.0), 0.05)
    assert len(builder.built) == 1


@pytest.mark.parametrize("is_ordered", [False, True])
def test_a_stop_that_the_arm_forgets_as_its_reset_begins_is_said_again(
    host, builder, start, is_ordered
):
    host.stop("before", is_ordered=False)

    def reset(q, hole):
        builder.arm.clear()
        host.hold_if_stopped()  # of the stop that this reset ends: nothing
        assert not builder.arm._stop.is_set()
        host.stop("during", is_ordered=is_ordered)
        builder.arm.clear()
        host.hold_if_stopped()
        assert builder.arm._stop.is_set()
        return RecordingArm.reset(builder.arm, q, hole)

    builder.arm.reset = reset
    host.reset(start, HOLE, None)
    assert host.stop_reason == "during"


def test_a_reset_that_the_arm_refuses_leaves_it_stopped(host, builder, start):
    host.stop("left", is_ordered=False)

    def refuse(q, hole):
        raise ArmError("too far", "far")

    builder.arm.reset = refuse
    with pytest.raises(ArmError, match="too far"):
        host.reset(start, HOLE, None)
    assert builder.arm._stop.is_set()
    assert host.stop_reason == "left"


def test_a_stop_that_the_arm_forgets_as_it_is_cleared_is_said_again(
    host, builder, start
):
    host.reset(start, HOLE, None)
    host.stop("before", is_ordered=True)
    clear = builder.arm.clear

    def stopped_meanwhile():
        host.stop("during", is_ordered=True)
        clear()

    builder.arm.clear = stopped_meanwhile
    host.clear()
    assert host.stop_reason == "during"
    assert builder.arm._stop.is_set()


def test_a_reset_of_a_learner_that_has_left_meanwhile_does_not_end_that_stop(
    host, builder, start
):
    host.stop("left", is_ordered=False)

    def lost():
        raise ArmError("no longer its owner")

    for use in (lambda: host.reset(start, HOLE, None, lost), lambda: host.clear(lost)):
        with pytest.raises(ArmError, match="no longer its owner"):
            use()
    assert host.stop_reason == "left"
    assert builder.arm.calls == ["stop"]


@pytest.mark.parametrize(
    "change",
    [
        {"period": 0.003},
        {"weak": True},
    ],
    ids=["a period that no arm has", "too little torque"],
)
def test_settings_that_do_not_fit_leave_the_arm_as_it_is(settings, change):
    osc, limits, task, period = settings
    fine = ControllerSettings(
        osc=osc, limits=limits, task=TaskSpec.parse(task), period=period
    )
    offered = OfferedArm(parse_address("twin:easy"), find_cell())
    host = ArmHost(offered)
    host.configure(fine, b"1")
    before = offered.arm
    weak = replace(limits, tau_max=[1.0] * 7)
    wrong = replace(fine, limits=weak) if "weak" in change else replace(fine, **change)
    with pytest.raises(ConfigError):
        host.configure(wrong, b"2")
    assert offered.arm is before
    host.close()
