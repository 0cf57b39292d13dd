"""Read-only clients: they see everything, may stop the arm, and move nothing."""

import grpc
import numpy as np
import pytest

from dovetail.errors import ArmError
from dovetail.rpc import dovetail_pb2 as pb
from dovetail.rpc.arm_service import READERS_MAX
from dovetail.rpc.messages import read_state, rows_from_bytes
from dovetail.rpc.version import own_version
from states import state_numbers

from .conftest import HOLE, push, refused, wait_until


def watch(stub, **options):
    return stub.state(pb.WatchRequest(version=own_version(), **options), timeout=60)


def test_a_watcher_sees_the_states_of_the_learner(
    simulation, start, connect, open_stub
):
    arm = connect(simulation, name="learner")
    reports = watch(open_stub(simulation), log=True)
    assert not next(reports).HasField("state")
    reset = arm.reset(start, HOLE)
    report = next(reports)
    assert report.holder.startswith("learner at")
    np.testing.assert_array_equal(read_state(report.state).q, reset.q)
    step = arm.step(push(1.0))
    seen = read_state(next(reports).state)
    others = state_numbers(step)
    for name, a in state_numbers(seen).items():
        np.testing.assert_array_equal(a, others[name], err_msg=name)


def test_a_slow_watcher_gets_the_newest(simulation, start, connect, open_stub):
    arm = connect(simulation)
    reports = watch(open_stub(simulation), interval=0.5)
    next(reports)
    arm.reset(start, HOLE)
    for _ in range(20):
        last = arm.step(push(1.0))
    seen = [next(reports)]
    while seen[-1].state.stamp < last.stamp:
        seen.append(next(reports))
    assert len(seen) < 20
    assert not seen[-1].state.log


def test_there_are_only_so_many_watchers(server, stub):
    reports = [watch(stub) for _ in range(READERS_MAX)]
    for report in reports:
        next(report)
    request = pb.WatchRequest(version=own_version())
    full = grpc.StatusCode.RESOURCE_EXHAUSTED
    refused(stub.state, request, code=full)
    refused(stub.get_log, pb.LogRequest(version=own_version()), code=full)
    for report in reports:
        report.cancel()


def test_the_holder_gets_its_log_however_many_watch(
    simulation, start, connect, open_stub
):
    arm = connect(simulation)
    arm.reset(start, HOLE)
    log = arm.step(push(1.0)).log
    stub = open_stub(simulation)
    reports = [watch(stub) for _ in range(READERS_MAX)]
    for report in reports:
        next(report)
    np.testing.assert_array_equal(arm.cycles(), log)
    for lease in ("", "0" * 32):
        request = pb.LogRequest(version=own_version(), lease=lease)
        refused(stub.get_log, request, code=grpc.StatusCode.RESOURCE_EXHAUSTED)


def test_anyone_may_stop_but_only_the_holder_clears(
    server, builder, news, start, connect, stub
):
    arm = connect(server)
    arm.reset(start, HOLE)
    arm.step(push(0.0))
    stub.stop(pb.StopRequest(reason="hand in the cell"))
    with pytest.raises(ArmError, match=r"stopped \(hand in the cell, asked by ipv4"):
        arm.step(push(0.0))
    assert builder.arm.calls == ["reset", "step", "stop"]
    wait_until(lambda: "hand in the cell" in news[-1])
    refused(stub.clear, pb.Holder(), code=grpc.StatusCode.FAILED_PRECONDITION)
    info = stub.get_info(pb.InfoRequest(version=own_version()))
    assert info.stopped.startswith("hand in the cell")
    arm.clear()
    arm.step(push(0.0))


def test_a_stop_outlives_the_learner_that_was_stopped(server, start, connect, stub):
    first = connect(server)
    first.reset(start, HOLE)
    stub.stop(pb.StopRequest(reason="hand in the cell"))
    first.close()
    second = connect(server)
    with pytest.raises(ArmError, match=r"hand in the cell.*clear it first"):
        second.reset(start, HOLE)
    second.clear()
    second.reset(start, HOLE)


def test_the_log_of_the_last_motion(simulation, start, connect, open_stub):
    arm = connect(simulation)
    stub = open_stub(simulation)
    request = pb.LogRequest(version=own_version())
    assert [chunk.rows for chunk in stub.get_log(request)] == [b""]
    arm.reset(start, HOLE)
    arm.step(push(1.0))
    arm.reset(start, HOLE)
    logs = [arm.step(push(float(i))).log for i in range(3)]
    first, *chunks = stub.get_log(request)
    assert list(first.columns) == list(arm.info.columns)
    assert [chunk.step for chunk in chunks] == [0, 1, 2]
    for chunk, log in zip(chunks, logs, strict=True):
        np.testing.assert_array_equal(rows_from_bytes(chunk.rows), log)


def test_of_a_long_motion_the_end_is_kept(server, start, connect, stub, monkeypatch):
    monkeypatch.setattr("dovetail.rpc.arm_host.ROWS_KEPT", 5)
    arm = connect(server)
    arm.reset(start, HOLE)
    for _ in range(4):
        arm.step(push(0.0), duration=0.01)
    first, *chunks = stub.get_log(pb.LogRequest(version=own_version()))
    assert first.dropped == 2
    assert [chunk.step for chunk in chunks] == [2, 3]
