"""Calls that are begun and never completed: a stop comes through at once."""

import contextlib
import os
import queue
import selectors
import socket
import threading
import time

import grpc
import numpy as np
import pytest

from dovetail.arms.remote_arm import GrpcAddress
from dovetail.errors import ArmError
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.arm_service import READERS_MAX
from dovetail.rpc.problems import problem_in
from dovetail.rpc.version import own_version

from .conftest import HOLE, push, refused, wait_until
from .half_open import SLOW_DATA, HalfOpen

MANY, STOPS = 500, 60
AT_ONCE = 0.1  # s, 95 % of the stops
DEADLINE = 10.0  # s, any call
METHODS = ("Stop", "GetInfo", "Step", "Reset", "Clear", "Control", "State", "GetLog")


@pytest.fixture
def attack(server):
    """Open half-open calls; returns the attacker."""
    attacks = []

    def make(calls, connections, token=None, data=b""):
        attack = HalfOpen(server.address)
        attacks.append(attack)
        for _ in range(connections):
            connection = attack.connect()
            for i in range(calls // connections):
                attack.call(connection, METHODS[i % len(METHODS)], token, data)
        return attack

    yield make
    for attack in attacks:
        attack.close()


@pytest.fixture
def stepping(server, start, connect):
    """A learner in mid-episode: clears each stop, and steps on until it is stopped."""
    arm = connect(server)
    arm.reset(start, HOLE)
    ends = threading.Event()
    steps = []

    def go_on():
        while not ends.is_set():
            try:
                arm.step(push(0.0), 0.005)
                steps.append(time.monotonic())
            except ArmError:
                arm.clear()

    thread = threading.Thread(target=go_on)
    thread.start()
    yield steps
    ends.set()
    thread.join(20)


def stop_times(stub):
    times = []
    for _ in range(STOPS):
        begin = time.monotonic()
        stub.stop(pb.StopRequest(reason="hand in the cell"), timeout=DEADLINE)
        times.append(time.monotonic() - begin)
    return times


@pytest.mark.parametrize("data", [b"", SLOW_DATA], ids=["headers", "slow data"])
@pytest.mark.parametrize("has_token", [True, False], ids=["token", "no token"])
@pytest.mark.parametrize("connections", [1, 10, MANY])
def test_a_stop_comes_through_at_once_under_half_open_calls(
    server,
    stub,
    stepping,
    attack,
    monkeypatch,
    record_property,
    connections,
    has_token,
    data,
):
    monkeypatch.setattr("dovetail.rpc.calls.FIRST_MESSAGE_MAX", 60.0)
    token = GrpcAddress.parse(server.url).token if has_token else None
    attack(MANY, connections, token, data)
    times = stop_times(stub)
    p50, p95, worst = 1e3 * np.percentile(times, [50, 95, 100])
    record_property("stop", f"p50 {p50:.1f} ms, p95 {p95:.1f} ms, max {worst:.1f} ms")
    assert p95 <= 1e3 * AT_ONCE
    info = stub.get_info(pb.InfoRequest(version=own_version()), timeout=DEADLINE)
    assert f"pid {os.getpid()} " in info.holder
    count = len(stepping)
    wait_until(lambda: len(stepping) > count)  # the learner goes on


def test_nothing_moves_after_the_answer_to_a_stop(
    server, stub, builder, start, connect, attack
):
    arm = connect(server)
    arm.reset(start, HOLE)
    attack(MANY, 10, GrpcAddress.parse(server.url).token)
    for _ in range(10):
        stepping = threading.Thread(target=step_until_stopped, args=(arm,))
        stepping.start()
        wait_until(lambda: builder.arm.calls[-1] == "step")
        stub.stop(pb.StopRequest(), timeout=DEADLINE)
        steps = builder.arm.calls.count("step")
        stepping.join(10)
        assert builder.arm.calls.count("step") == steps
        arm.clear()


def step_until_stopped(arm):
    with contextlib.suppress(ArmError):
        while True:
            arm.step(push(0.0), 0.02)


def test_a_call_that_stays_silent_ends_by_itself(server, attack, monkeypatch):
    monkeypatch.setattr("dovetail.rpc.calls.FIRST_MESSAGE_MAX", 0.2)
    token = GrpcAddress.parse(server.url).token
    silent = attack(len(METHODS), 1, token)
    wait_until(lambda: silent.ended >= len(METHODS))
    slow = attack(len(METHODS), 1, token, SLOW_DATA)
    wait_until(lambda: slow.ended >= len(METHODS))


def test_a_call_without_token_ends_at_its_headers(server, attack):
    silent = attack(len(METHODS), 1)
    wait_until(lambda: silent.ended >= len(METHODS) - 1, 2.0)  # Stop needs no token


def test_connections_that_say_nothing_leave_room_and_are_dropped(server, stub):
    host, port = server.address.rsplit(":", 1)
    with contextlib.ExitStack() as opened:
        silent = selectors.DefaultSelector()
        for _ in range(300):
            connection = socket.create_connection((host, int(port)), timeout=10)
            silent.register(opened.enter_context(connection), selectors.EVENT_READ)
        assert np.percentile(stop_times(stub), 95) <= AT_ONCE
        deadline = time.monotonic() + 10.0  # the handshake's limit is 3 s
        while silent.get_map() and time.monotonic() < deadline:
            for key, _ in silent.select(1.0):
                with contextlib.suppress(ConnectionError):
                    if key.fileobj.recv(4096):  # the service's own settings
                        continue
                silent.unregister(key.fileobj)
        assert not silent.get_map()


def test_a_learner_that_thinks_is_no_silent_call(server, start, connect, monkeypatch):
    monkeypatch.setattr("dovetail.rpc.calls.FIRST_MESSAGE_MAX", 0.2)
    arm = connect(server)
    time.sleep(0.6)
    arm.reset(start, HOLE)
    assert arm.step(push(0.0)).stamp == 0.05


def test_a_stop_passes_steps_that_wait(server, stub, builder, start, connect):
    arm = connect(server)
    arm.reset(start, HOLE)
    target = pb.Target(
        f_star=[0.0] * 6, position_d=[0.0] * 3, quat_wxyz_d=[0.0, 1.0, 0.0, 0.0]
    )
    request = pb.StepRequest(lease=arm._lease, target=target, duration=5.0)
    call = stub.step.func  # as `Stub` made it
    steps = [call.future(request, timeout=60, **stub.step.keywords) for _ in range(40)]
    wait_until(lambda: "step" in builder.arm.calls)
    assert np.percentile(stop_times(stub), 95) <= AT_ONCE
    wait_until(lambda: all(step.done() for step in steps))
    assert sum(step.code() == grpc.StatusCode.OK for step in steps) == 1


def test_a_stop_during_a_reset_ends_it(server, stub, builder, start, connect):
    """Also one that came a moment before the arm forgot its stops, as resets do."""
    arm = connect(server)
    begun, stopped = threading.Event(), threading.Event()

    def reset(q, hole):
        begun.set()
        assert stopped.wait(10.0)
        builder.arm.clear()  # as FriArm.reset, a moment after the stop
        assert builder.arm._stop.wait(10.0)
        raise ArmError("stopped on the way")

    builder.arm.reset = reset
    said = queue.SimpleQueue()

    def reset_the_arm():
        with pytest.raises(ArmError) as error:
            arm.reset(start, HOLE)
        said.put(error)

    threading.Thread(target=reset_the_arm).start()
    assert begun.wait(10.0)
    stub.stop(pb.StopRequest(), timeout=DEADLINE)
    stopped.set()
    assert "stopped on the way" in str(said.get(timeout=2.0).value)


def test_a_stop_is_not_held_up_by_a_terminal_that_stands_still(builder, open_stub):
    from dovetail.rpc.server import ArmServer

    still = threading.Event()
    with ArmServer(builder, "127.0.0.1:0", notify=lambda line: still.wait(30)) as it:
        assert np.percentile(stop_times(open_stub(it)), 95) <= AT_ONCE
        still.set()


def test_logs_that_are_read_slowly_leave_room_for_a_stop(server, stub, monkeypatch):
    go_on = threading.Event()
    monkeypatch.setattr(server._host, "cycles", lambda: go_on.wait(30.0) and [])
    request = pb.LogRequest(version=own_version())
    calls = [stub.get_log(request, timeout=60) for _ in range(READERS_MAX)]
    wait_until(lambda: server.service.readers == READERS_MAX)
    refused(stub.get_log, request, code=grpc.StatusCode.RESOURCE_EXHAUSTED)
    assert np.percentile(stop_times(stub), 95) <= AT_ONCE
    go_on.set()
    wait_until(lambda: server.service.readers == 0)
    assert [len(list(call)) for call in calls] == [1] * READERS_MAX


def test_a_log_that_nobody_goes_on_reading_gives_its_room_back(
    server, stub, monkeypatch
):
    monkeypatch.setattr("dovetail.rpc.arm_service.LOG_TIME_MAX", 1.0)
    block = np.zeros((2000, len(CYCLE_COLUMNS)))  # 90 are more than the road holds
    monkeypatch.setattr(server._host, "cycles", lambda: [(i, block) for i in range(90)])
    request = pb.LogRequest(version=own_version())
    call = stub.get_log(request, timeout=60)
    next(call)
    assert server.service.readers == 1
    wait_until(lambda: server.service.readers == 0)
    with pytest.raises(grpc.RpcError) as error:
        list(call)
    assert error.value.code() == grpc.StatusCode.DEADLINE_EXCEEDED
    assert problem_in(error.value) is not None  # the service's word, not the client's


def test_no_number_of_pending_calls_makes_a_stop_refused(server, stub, attack):
    """gRPC itself refuses calls, stops among them, from 1000 pending ones on."""
    for _ in range(3):
        attack(90 * 60, 60)
        stub.stop(pb.StopRequest(reason="hand in the cell"), timeout=10.0)
    assert len(stop_times(stub)) == STOPS
