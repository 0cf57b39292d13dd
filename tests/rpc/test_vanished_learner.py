"""A learner that dies, or falls silent: the arm is held and the next one takes over."""

import signal
import threading
import time
from functools import partial

import grpc
import pytest

from dovetail.errors import ArmError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.messages import write_pose

from .conftest import HOLE, push, wait_until


@pytest.fixture
def spawn(server, spawn_learner):
    """Start learners of the recording arm."""
    return partial(spawn_learner, server)


@pytest.mark.parametrize("duration", ["0.05", "5.0"])
def test_killed_in_mid_motion_the_arm_is_held_and_the_next_learner_takes_over(
    server, builder, news, spawn, connect, start, duration
):
    for _ in range(2):
        learner = spawn(duration)
        arm = builder.arm
        time.sleep(0.1)
        arm.stopped_at = None
        killed_at = time.monotonic()
        learner.send_signal(signal.SIGKILL)
        wait_until(lambda arm=arm: arm.stopped_at is not None, 1.0)
        wait_until(lambda: server.service.leases.holder is None, 1.0)
        assert time.monotonic() - killed_at < 1.0  # milliseconds on an idle machine
        assert arm.calls.count("stop") >= 1
        wait_until(lambda: "its connection has ended; the arm is held" in news[-1])
    steps = arm.calls.count("step")
    time.sleep(0.2)
    assert arm.calls.count("step") == steps
    successor = connect(server)
    successor.reset(start, HOLE)
    assert successor.step(push(0.0)).stamp == 0.05


def test_a_learner_that_forgets_to_close_ends_and_leaves_the_arm_held(
    server, builder, spawn
):
    learner = spawn("leave")
    assert learner.wait(timeout=30) == 0
    wait_until(lambda: server.service.leases.holder is None, 10.0)
    assert builder.arm.calls[-1] == "stop"


def test_an_owner_that_is_killed_before_its_first_step_frees_the_lease_at_once(
    server, spawn
):
    learner = spawn("acquire")
    assert server.service.leases.holder is not None
    learner.send_signal(signal.SIGKILL)
    wait_until(lambda: server.service.leases.holder is None, 1.0)


@pytest.mark.slow
def test_a_frozen_learner_is_noticed_by_the_keepalive(server, builder, spawn):
    learner = spawn("0.05")
    builder.arm.stopped_at = None
    learner.send_signal(signal.SIGSTOP)
    wait_until(lambda: builder.arm.stopped_at is not None, 30.0)
    wait_until(lambda: server.service.leases.holder is None, 5.0)


def test_a_cancelled_stream_ends_the_lease(server, stub, acquire):
    stream, _ = acquire(stub)
    stream.cancel()
    wait_until(lambda: server.service.leases.holder is None, 1.0)


def test_a_learner_that_lost_the_lease_is_told_why(server, start, connect):
    arm = connect(server)
    arm.reset(start, HOLE)
    arm._stub.release_lease(pb.Holder(lease=arm._lease))
    with pytest.raises(ArmError, match=r"has ended \(released\)"):
        arm.step(push(0.0))


def test_a_reset_that_waits_moves_nothing_after_its_learner_has_gone(
    server, builder, start, connect, open_stub
):
    arm = connect(server)
    arm.reset(start, HOLE)
    stepping = threading.Thread(target=arm.step, args=(push(0.0), 5.0))
    request = pb.ResetRequest(lease=arm._lease, q=start.tolist())
    write_pose(HOLE, request.fixture)
    stop = builder.arm.stop
    builder.arm.stop = lambda: None  # the step goes on after the lease has ended
    stepping.start()
    wait_until(lambda: builder.arm.calls[-1] == "step")
    stub = open_stub(server)
    waits = stub.reset.func.future(request, **stub.reset.keywords)
    time.sleep(0.1)
    stub.release_lease(pb.Holder(lease=arm._lease))
    stop()
    assert waits.code() == grpc.StatusCode.FAILED_PRECONDITION
    stepping.join(10)
    assert builder.arm.calls == ["reset", "step", "stop"]
    assert "released" in server.service.status
