"""A learner that dies, or falls silent: the arm is held and the next one takes over."""

import queue
import signal
import time
from functools import partial

import pytest

from dovetail.errors import ArmError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.version import own_version

from .conftest import HOLE, push


@pytest.fixture
def spawn(server, spawn_learner):
    """Start learners of the recording arm."""
    return partial(spawn_learner, server)


def wait_until(is_true, seconds):
    deadline = time.monotonic() + seconds
    while not is_true() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert is_true()


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
        wait_until(lambda arm=arm: arm.stopped_at is not None, 10.0)
        assert arm.stopped_at - killed_at < 3.0  # milliseconds on an idle machine
        assert arm.calls.count("stop") >= 1
        wait_until(lambda: server.service.leases.holder is None, 5.0)
        assert "its connection has ended; the arm is held" in news[-1]
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


@pytest.mark.slow
def test_a_frozen_learner_is_noticed_by_the_keepalive(server, builder, spawn):
    learner = spawn("0.05")
    builder.arm.stopped_at = None
    learner.send_signal(signal.SIGSTOP)
    wait_until(lambda: builder.arm.stopped_at is not None, 30.0)
    wait_until(lambda: server.service.leases.holder is None, 5.0)


def test_a_cancelled_stream_ends_the_lease(server, builder, stub, lease):
    stream = stub.control(iter([pb.StepRequest(lease=lease)]), timeout=30)
    next(stream)
    stream.cancel()
    wait_until(lambda: server.service.leases.holder is None, 10.0)


def test_a_lease_without_a_stream_expires(server, news, stub, connect):
    request = pb.LeaseRequest(version=own_version(), client="quiet", timeout=0.3)
    stub.acquire_lease(request)
    with pytest.raises(ArmError, match="held by quiet"):
        connect(server)
    wait_until(lambda: server.service.leases.holder is None, 10.0)
    assert "quiet" in news[-1]
    assert "nothing was heard of it for 0.3 s" in news[-1]
    connect(server)


def test_the_stream_of_a_learner_that_hangs_ends_with_its_lease(server, stub):
    for _ in range(2):
        request = pb.LeaseRequest(version=own_version(), client="hung", timeout=0.2)
        lease = stub.acquire_lease(request).lease
        says_no_more = queue.SimpleQueue()
        says_no_more.put(pb.StepRequest(lease=lease))
        stream = stub.control(iter(says_no_more.get, None), timeout=30)
        next(stream)
        wait_until(lambda: server.service.streams.taken == 0, 10.0)
        wait_until(stream.done, 10.0)
        says_no_more.put(None)


def test_a_learner_that_thinks_keeps_the_arm(server, start, connect):
    arm = connect(server, lease_timeout=1.5)
    arm.reset(start, HOLE)
    time.sleep(3.5)
    assert arm.step(push(0.0)).stamp == 0.05


def test_a_learner_that_lost_the_lease_is_told_why(server, start, connect):
    arm = connect(server)
    arm.reset(start, HOLE)
    leases = server.service.leases
    leases.end(leases.holder, "for this test")
    with pytest.raises(ArmError, match=r"has ended \(for this test\)"):
        arm.step(push(0.0))
