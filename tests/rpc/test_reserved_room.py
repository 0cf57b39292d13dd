"""Calls that last have room of their own: a stop, a clear, a question find theirs."""

import queue
import threading
import time

import grpc
import numpy as np
import pytest

from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.arm_service import LOGS_MAX, MOTIONS_MAX, STREAMS_MAX
from dovetail.rpc.version import own_version

from .conftest import HOLE, push, refused

MANY = 40
FULL = grpc.StatusCode.RESOURCE_EXHAUSTED
AT_ONCE = 2.0  # s, a call's deadline


@pytest.fixture
def silent(open_stub):
    """Open streams and say nothing; a client's, without a lease."""
    opened, ends = [], []

    def make(server, count):
        stub = open_stub(server)
        for _ in range(count):
            ends.append(queue.SimpleQueue())
            opened.append(stub.control(iter(ends[-1].get, None), timeout=60))
        return opened[-count:]

    yield make
    for call, end in zip(opened, ends, strict=True):
        call.cancel()
        end.put(None)


def wait_until(is_true):
    deadline = time.monotonic() + 10.0
    while not is_true() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert is_true()


def thread_names():
    return [thread.name for thread in threading.enumerate()]


def ended(calls):
    return [call for call in calls if call.done()]


def test_silent_streams_leave_room_for_stop_clear_and_info(
    server, stub, lease, silent, monkeypatch
):
    monkeypatch.setattr("dovetail.rpc.first_message.FIRST_MESSAGE_MAX", 60.0)
    calls = silent(server, MANY)
    wait_until(lambda: len(ended(calls)) == MANY - STREAMS_MAX)
    assert server.service.streams.taken == STREAMS_MAX
    stub.stop(pb.StopRequest(reason="hand in the cell"), timeout=AT_ONCE)
    info = stub.get_info(pb.InfoRequest(version=own_version()), timeout=AT_ONCE)
    assert info.stopped.startswith("hand in the cell")
    stub.clear(pb.Holder(lease=lease), timeout=AT_ONCE)
    info = stub.get_info(pb.InfoRequest(version=own_version()), timeout=AT_ONCE)
    assert info.stopped == ""
    for call in ended(calls):
        assert call.code() == FULL
        assert f"{STREAMS_MAX} control streams are open" in call.details()
        assert "close the others" in call.details()


def test_a_silent_stream_ends_by_itself_and_its_room_is_free(
    server, silent, start, connect, monkeypatch
):
    monkeypatch.setattr("dovetail.rpc.first_message.FIRST_MESSAGE_MAX", 0.2)
    calls = silent(server, STREAMS_MAX)
    wait_until(lambda: len(ended(calls)) == STREAMS_MAX)
    for call in calls:
        assert call.code() == grpc.StatusCode.DEADLINE_EXCEEDED
        assert "silent for 0.2 s" in call.details()
    wait_until(lambda: server.service.streams.taken == 0)
    wait_until(lambda: "dovetail-first-message" not in thread_names())
    arm = connect(server)
    arm.reset(start, HOLE)
    assert arm.step(push(0.0)).stamp == 0.05


def test_a_learner_that_thinks_is_no_silent_stream(
    server, silent, start, connect, monkeypatch
):
    monkeypatch.setattr("dovetail.rpc.first_message.FIRST_MESSAGE_MAX", 0.2)
    arm = connect(server)
    calls = silent(server, MANY)
    wait_until(lambda: len(ended(calls)) == MANY)
    time.sleep(0.4)
    arm.reset(start, HOLE)
    assert arm.step(push(0.0)).stamp == 0.05


def test_streams_that_have_ended_give_their_room_back(server, silent):
    for call in silent(server, STREAMS_MAX):
        call.cancel()
    wait_until(lambda: server.service.streams.taken == 0)


def test_short_calls_whose_request_never_comes_leave_room_too(server, stub, silent):
    end = queue.SimpleQueue()
    with grpc.insecure_channel(server.address) as channel:
        stop = channel.stream_stream("/dovetail.Arm/Stop")
        calls = [stop(iter(end.get, None), timeout=60) for _ in range(MANY)]
        streams = silent(server, MANY)
        wait_until(lambda: len(ended(streams)) >= MANY - STREAMS_MAX)
        stub.stop(pb.StopRequest(), timeout=AT_ONCE)
        assert ended(calls) == []
        for call in calls:
            call.cancel()
            end.put(None)


def test_logs_that_are_read_slowly_leave_room_for_a_stop(server, stub, monkeypatch):
    go_on = threading.Event()
    monkeypatch.setattr(server._host, "cycles", lambda: go_on.wait(30.0) and [])
    request = pb.LogRequest(version=own_version())
    calls = [stub.get_log(request, timeout=60) for _ in range(MANY)]
    wait_until(lambda: len(ended(calls)) == MANY - LOGS_MAX)
    stub.stop(pb.StopRequest(), timeout=AT_ONCE)
    assert {call.code() for call in ended(calls)} == {FULL}
    problem = refused(stub.get_log, request, code=FULL)
    assert f"{LOGS_MAX} logs are being read" in problem.text
    go_on.set()
    wait_until(lambda: server.service.logs.taken == 0)


def test_a_log_that_nobody_goes_on_reading_gives_its_room_back(
    server, stub, monkeypatch
):
    monkeypatch.setattr("dovetail.rpc.arm_service.LOG_TIME_MAX", 0.3)
    block = np.zeros((2000, len(CYCLE_COLUMNS)))  # 90 are more than the road holds
    monkeypatch.setattr(server._host, "cycles", lambda: [(i, block) for i in range(90)])
    request = pb.LogRequest(version=own_version())
    calls = [stub.get_log(request, timeout=60) for _ in range(LOGS_MAX)]
    for call in calls:
        next(call)
    assert server.service.logs.taken == LOGS_MAX
    wait_until(lambda: server.service.logs.taken == 0)
    for call in calls:
        with pytest.raises(grpc.RpcError, match="CANCELLED"):
            list(call)


def test_steps_that_wait_leave_room_for_a_stop(server, stub, start, connect):
    arm = connect(server)
    arm.reset(start, HOLE)
    target = pb.Target(
        f_star=[0.0] * 6, position_d=[0.0] * 3, quat_wxyz_d=[0.0, 1.0, 0.0, 0.0]
    )
    request = pb.StepRequest(lease=arm._lease, target=target, duration=5.0)
    steps = [stub.step.future(request, timeout=60) for _ in range(MANY)]
    wait_until(lambda: len(ended(steps)) == MANY - MOTIONS_MAX)
    assert {step.code() for step in ended(steps)} == {FULL}
    stub.stop(pb.StopRequest(), timeout=AT_ONCE)
    wait_until(lambda: len(ended(steps)) == MANY)
    assert sum(step.code() == grpc.StatusCode.OK for step in steps) == 1
