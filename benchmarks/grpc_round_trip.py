"""What a step over gRPC takes beyond the arm's own time, beside a bare gRPC echo.

    python benchmarks/grpc_round_trip.py [--steps 2000] [--waits 100]

The service runs in a process of its own on loopback. Its arm either answers at once or
waits for the 50 ms of a policy step, and says in `stamp` how long that took; what is
left of the learner's time is the road there and back. The peer is gRPC alone: the same
number of bytes there and back, no arm and no checks. Blocks of both take turns.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import Any, cast

import grpc
import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState, ToolState
from dovetail.arms.arm_address import ArmAddress
from dovetail.arms.remote_arm import GrpcAddress, RemoteArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.poses import Pose
from dovetail.robots.robot import Robot
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.server import ArmServer
from dovetail.types import Vec7
from dovetail.workcell.workcell import Workcell

PERIOD, STEP = 0.005, 0.05
QUAT = np.array([0.0, 1.0, 0.0, 0.0])
REQUEST, WAITING, ANSWER = b"r" * 170, b"w" * 170, b"a" * 3700
"""As long as a StepRequest and a Report with ten control cycles."""


class TimedArm:
    """Takes no time for a step of one period, real time for a longer one."""

    def __init__(self, robot: Robot, period: float) -> None:
        self.robot, self.period = robot, period
        log = np.random.default_rng(0).normal(size=(10, len(CYCLE_COLUMNS)))
        seven, three = np.full(7, 0.1), np.full(3, 0.1)
        self.rest = (
            seven,
            seven,
            ToolState(three, QUAT, np.full(6, 0.1)),
            three,
            np.zeros(6),
            0,
            log,
        )

    def reset(self, q: Vec7, hole: Pose) -> ArmState:
        """Answer at once."""
        return ArmState(0.0, *self.rest)

    def step(self, target: _core.Target, duration: float = STEP) -> ArmState:
        """Wait, or not, and say how long it took."""
        # Not `_replace`: its 0.01 to 0.02 ms after a wait would not be in the stamp.
        return ArmState(wait(duration > self.period), *self.rest)

    def stop(self) -> None:
        """Nothing moves."""

    def statistics(self) -> dict[str, Any]:
        """Nothing is counted."""
        return {"notes": []}

    def close(self) -> None:
        """Nothing is held."""


class TimedAddress(ArmAddress):
    """Makes the arm for the service."""

    def build(self, cell: Workcell, settings: ControllerSettings) -> Arm:
        """Return the arm; the service asks it for no more than it has."""
        return cast("Arm", TimedArm(cell.loaded_robot(), settings.period))

    def describe_ground(self) -> str:
        """Return that nothing moves."""
        return "nowhere"


class Echo(grpc.GenericRpcHandler):
    """The peer: answers with the time that it waited and as many bytes as a Report."""

    def service(self, handler_call_details: Any) -> Any:
        """Return the handler of a call."""
        if handler_call_details.method == "/echo/Unary":
            return grpc.unary_unary_rpc_method_handler(lambda r, _: self._answer(r))
        return grpc.stream_stream_rpc_method_handler(
            lambda requests, _: map(self._answer, requests)
        )

    def _answer(self, request: bytes) -> bytes:
        return b"%12.9f" % wait(request == WAITING) + ANSWER


def wait(is_long: bool) -> float:
    """Wait for a policy step or not at all; return how long it took [s]."""
    start = time.perf_counter()
    if is_long:
        time.sleep(STEP)
    return time.perf_counter() - start


def serve() -> None:
    """Serve arm and echo until the standard input ends."""
    echo = grpc.server(ThreadPoolExecutor(4), handlers=[Echo()])
    port = echo.add_insecure_port("127.0.0.1:0")
    echo.start()
    with ArmServer(
        OfferedArm(TimedAddress(text="timed"), find_cell()), "127.0.0.1:0"
    ) as server:
        print(server.url, port, flush=True)
        sys.stdin.read()
    echo.stop(0)


def timed(call: Callable[[], float], count: int) -> list[float]:
    """Return the time of each call [s] less what it says the arm took."""
    times = []
    for _ in range(count):
        start = time.perf_counter()
        own = call()
        times.append(time.perf_counter() - start - own)
    return times


def processor_time(pid: int) -> float:
    """Return what a process has used of the processors [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(
    address: str, echo_port: str, steps: int, waits: int, pids: tuple[int, int]
) -> None:
    """Measure in turns and print the table; `pids` are the learner's, the service's."""
    robot = find_cell().loaded_robot()
    settings = ControllerSettings(
        osc=OscConfig(),
        limits=LimitConfig.for_period(robot, PERIOD),
        task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
        period=PERIOD,
    )
    arm = RemoteArm(GrpcAddress.parse(address), settings, robot=robot)
    arm.reset(np.full(7, 0.1), Pose(np.array([0.6, 0.0, 0.1]), QUAT))
    target = _core.Target(quat_wxyz_d=QUAT)
    channel = grpc.insecure_channel(f"127.0.0.1:{echo_port}")
    unary = channel.unary_unary("/echo/Unary")
    outbox: SimpleQueue[bytes | None] = SimpleQueue()
    answers = channel.stream_stream("/echo/Stream")(iter(outbox.get, None))

    def stream(request: bytes) -> float:
        outbox.put(request)
        return float(next(answers)[:12])

    blocks = {
        "RemoteArm.step": (lambda: arm.step(target, PERIOD).stamp, steps),
        "peer: stream echo": (lambda: stream(REQUEST), steps),
        "peer: unary echo": (lambda: float(unary(REQUEST)[:12]), steps),
        "RemoteArm.step, 50 ms": (lambda: arm.step(target, STEP).stamp, waits),
        "peer: stream echo, 50 ms": (lambda: stream(WAITING), waits),
        "peer: unary echo, 50 ms": (lambda: float(unary(WAITING)[:12]), waits),
    }
    times: dict[str, list[float]] = {name: [] for name in blocks}
    for call, _ in blocks.values():
        timed(call, 10)
    used = np.zeros(2)
    for _ in range(10):
        for name, (call, count) in blocks.items():
            before = [processor_time(pid) for pid in pids]
            times[name] += timed(call, max(1, count // 10))
            if name == "RemoteArm.step, 50 ms":
                used += np.subtract([processor_time(pid) for pid in pids], before)
    print(f"{'beyond the own time of the arm':32}" + "     p50     p90     p99     max")
    for name, values in times.items():
        row = [*np.percentile(values, [50, 90, 99]), max(values)]
        print(f"{name:32}" + "".join(f"{1e6 * v:8.0f}" for v in row) + " us")
    middle = {name: np.median(values) for name, values in times.items()}
    for end in ("", ", 50 ms"):
        ratio = middle[f"RemoteArm.step{end}"] / middle[f"peer: stream echo{end}"]
        print(f"RemoteArm.step over gRPC's stream alone{end}: {ratio:.2f}")
    learner, service = 1e3 * used / len(times["RemoteArm.step, 50 ms"])
    print(
        "processor time of a step of 50 ms: "
        f"learner {learner:.1f} ms, service {service:.1f} ms"
    )
    outbox.put(None)
    channel.close()
    arm.close()


def main() -> None:
    """Start the service's process, measure, end it."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n")[0])
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--waits", type=int, default=100)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve()
        return
    with subprocess.Popen(
        [sys.executable, __file__, "--serve"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as service:
        assert service.stdout is not None
        address, echo_port = service.stdout.readline().split()
        try:
            pids = (os.getpid(), service.pid)
            measure(address, echo_port, options.steps, options.waits, pids)
        finally:
            service.communicate("", timeout=20)
    if service.returncode:
        sys.exit("the service's process has failed; it says above why")


if __name__ == "__main__":
    main()
