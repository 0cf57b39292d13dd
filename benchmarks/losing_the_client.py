"""Lose a client in mid-motion: how long and how far does the simulated arm move on?

    python benchmarks/losing_the_client.py [--tries 3] [--clock wall] [--period 1ms]
        [--plant mujoco]

A client in a process of its own moves the TCP to and fro at 0.25 m/s. It is killed
(SIGKILL), paused (SIGSTOP), or its cable is out (every datagram lost, both ways). Times
run from that moment until the TCP is slower than 1 mm/s for good, ways from the same
moment; the last column counts from the end of the motion, which the cabinet decides
after its number of missing commands. By the clock, time is this machine's; in lockstep,
where the cabinet waits for a silent client, it is the arm's. The arm's true pose is
read from the engine.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.cabinet.cabinet import Cabinet
from dovetail.cabinet.config import CabinetConfig, Endpoint
from dovetail.cabinet.realtime import request_realtime
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.durations import parse_duration
from dovetail.envs.registered import find_cell
from dovetail.plants.find import make_plant
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import load_twin, make_twin
from dovetail.poses import Pose, quat_about_z
from dovetail.types import Array

LOOPBACK, TASK = "127.0.0.1", "XYZ:force A:pose BC:hold"
TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
SPEED, DAMPING = 0.25, 16.0  # m/s, 1/s
AT_REST = 1e-3  # m/s
_ATTEMPTS = 10
PLANTS = ("mujoco", "easy", "medium", "hard")
CAUSES = ("kill", "pause", "cable")


class Sample(NamedTuple):
    """The arm after one step of the plant."""

    clock: float
    """This machine's clock [s]."""
    time: float
    """The arm's time [s]."""
    position: Array
    """True position of the TCP [m]."""
    joint_speed: float
    """Measured speed of the fastest joint [rad/s]."""


class Recorder:
    """A plant that writes down where the TCP is after every step."""

    def __init__(self, name: str) -> None:
        cell = find_cell()
        if name in ("mujoco", "bullet"):
            self._plant: Any = make_plant(name, cell, DynamicsConfig())
        else:
            self._plant = make_twin(load_twin(name), cell)
        self.samples: list[Sample] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def reset(self, q: Array, hole: Pose) -> None:
        """Place the arm, and forget the samples."""
        self._plant.reset(q, hole)
        self.samples = [
            Sample(time.monotonic(), 0.0, self._plant.tool_pose().position, 0.0)
        ]

    def apply(self, tau: Array, dt: float, drive: Array | None = None) -> None:
        """Step the plant and note where it is."""
        self._plant.apply(tau, dt, drive)
        now = self.samples[-1].time + dt
        pose = self._plant.tool_pose()
        fastest = float(np.abs(self._plant.read()[1]).max())
        self.samples.append(Sample(time.monotonic(), now, pose.position, fastest))

    def speed(self) -> float:
        """Return the TCP's mean speed of the last 20 ms [m/s]."""
        last, samples = self.samples[-1], self.samples
        for sample in reversed(samples[-25:]):
            if last.time - sample.time > 0.0199:
                way = np.linalg.norm(last.position - sample.position)
                return float(way) / (last.time - sample.time)
        return 0.0


def run_client(
    port: int, control: int, period: float, clock: str, realtime: bool
) -> None:
    """Move the TCP to and fro along y until killed."""
    if realtime:  # its servo thread alone, not all that it inherits from the cabinet
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    robot = find_cell().loaded_robot()
    settings = ControllerSettings(
        osc=OscConfig.for_period(period, force_damping=[DAMPING] * 3 + [0.0] * 3),
        limits=LimitConfig.for_period(robot, period, hardware=True),
        task=TaskSpec.parse(TASK),
        period=period,
    )
    address = FriAddress(
        host=LOOPBACK,
        port=port,
        clock="wall" if clock == "wall" else "lockstep",
        control=f"{LOOPBACK}:{control}",
        realtime=realtime,
    )
    arm = FriArm(address, robot, settings, log_folder=None)
    start = robot.inverse_kinematics(Pose(np.array([0.6, 0.0, 0.2]), TOOL_DOWN), Q_SEED)
    arm.reset(start, HOLE)
    sign = 1.0
    while True:
        state = arm.step(
            _core.Target(
                f_star=np.array([0.0, sign * SPEED * DAMPING, 0.0, 0.0, 0.0, 0.0]),
                quat_wxyz_d=TOOL_DOWN,
            )
        )
        if sign * state.tool.position[1] > 0.15:
            sign = -sign


class Loss(NamedTuple):
    """What one loss of a client led to."""

    speed: float
    """Speed of the TCP before [m/s]."""
    joint_speed: float
    """Speed of the fastest joint before [rad/s]."""
    rest: float
    """From the loss to rest, by the clock of the row [s]."""
    arm_rest: float
    """The same in the arm's time [s]: less where the machine was busy."""
    way: float
    """Length of the TCP's way from the loss on [m]."""
    way_after: float
    """The part of it after the end of the motion [m]."""
    reason: str
    """Why the cabinet ended the motion."""


class NoMotionError(RuntimeError):
    """The motion had ended before the client was lost."""


def lose(
    name: str,
    period: float,
    clock: Literal["wall", "lockstep"],
    cause: str,
    rng: np.random.Generator,
) -> Loss:
    """Start cabinet and client, lose the client, and see the arm come to rest."""
    plant = Recorder(name)
    plant.reset(Q_SEED, HOLE)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "events.jsonl"
        client_port = 30209
        config = CabinetConfig(
            period=period,
            clock=clock,
            patience=0.2,
            fair_from=0.0,
            good_from=0.3,
            restart_delay=None,
            client=Endpoint(LOOPBACK, client_port),
            bind=Endpoint(LOOPBACK, 0),
            control=Endpoint(LOOPBACK, 0),
        )
        with Cabinet(plant, config, log=log) as cabinet:  # type: ignore[arg-type]
            assert cabinet.control_address is not None
            place = f"{client_port}:{cabinet.control_address.port}:{period}:{clock}"
            place += f":{os.sched_getscheduler(0) == os.SCHED_FIFO}"
            client = subprocess.Popen(
                [sys.executable, __file__, f"--client={place}"],
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # no shell that ends wakes a paused client
            )
            try:
                return _lose(cabinet, plant, client, log, cause, rng)
            finally:
                client.kill()
                client.wait()


def _lose(
    cabinet: Cabinet,
    plant: Recorder,
    client: "subprocess.Popen[bytes]",
    log: Path,
    cause: str,
    rng: np.random.Generator,
) -> Loss:
    end = time.monotonic() + 60.0
    while plant.speed() < 0.96 * SPEED:
        if client.poll() is not None or time.monotonic() > end:
            raise NoMotionError(cabinet.status())
        time.sleep(0.0005)
    time.sleep(cabinet.config.period * rng.random())
    speed, lost = plant.speed(), time.monotonic()
    if cause == "cable":
        cabinet.request({"do": "fault", "text": "loss=1"})
    else:
        client.send_signal(signal.SIGKILL if cause == "kill" else signal.SIGSTOP)
    while not cabinet.status()["braked"]:
        if time.monotonic() > lost + 60.0:
            raise TimeoutError(f"the arm never came to rest: {cabinet.status()}")
        time.sleep(0.01)
    samples = list(plant.samples)
    events = [json.loads(line) for line in log.read_text().splitlines()]
    stops = [e for e in events if e["event"] == "stop"]
    if len(stops) != 1 or samples[-1].clock < lost:
        raise NoMotionError(cabinet.status())
    (stop,) = stops
    period = cabinet.config.period
    begin = stop["time"] - (cabinet.config.stop_misses - 1) * period
    first = _index(samples, begin)  # the arm, as the first command is missing
    if cabinet.config.clock == "wall":
        # A signal takes its time: a client that still answers is not lost.
        lost = max(lost, samples[_index(samples, begin - period)].clock)
        first = next(i for i, s in enumerate(samples) if s.clock >= lost)
        first = max(first - 1, 0)
    points = np.array([s.position for s in samples])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    times = np.diff([s.time for s in samples])
    rest = 1 + int(np.flatnonzero(steps / times > AT_REST)[-1])
    arm_rest = samples[rest].time - samples[first].time
    if cabinet.config.clock == "wall":
        duration = samples[rest].clock - lost
    else:
        duration = arm_rest
    ended = _index(samples, stop["time"])
    way, after = float(steps[first:].sum()), float(steps[ended:].sum())
    fastest = samples[first].joint_speed
    return Loss(speed, fastest, duration, arm_rest, way, after, stop["reason"])


def _index(samples: list[Sample], time: float) -> int:
    """Return the first sample at or after one of the arm's times [s]."""
    return next(i for i, s in enumerate(samples) if s.time >= time - 1e-9)


def lose_once(
    name: str,
    period: float,
    clock: Literal["wall", "lockstep"],
    cause: str,
    rng: np.random.Generator,
) -> Loss:
    """Lose a client, again where a busy machine has ended the motion before."""
    for _ in range(_ATTEMPTS):
        try:
            return lose(name, period, clock, cause, rng)
        except NoMotionError as error:
            print(f"  again: {error}", file=sys.stderr)
    raise NoMotionError(f"{_ATTEMPTS} times before the client was lost")


def main() -> None:
    """Run, or be a client."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the client, too
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--tries", type=int, default=3)
    parser.add_argument("--clock", choices=("wall", "lockstep"), action="append")
    parser.add_argument("--period", action="append", help="1ms, 2ms or 5ms")
    parser.add_argument("--plant", action="append", help="mujoco, bullet, or a twin")
    parser.add_argument("--realtime", action="store_true")
    parser.add_argument("--client", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.client:
        port, control, period, clock, realtime = options.client.split(":")
        is_real_time = realtime == "True"
        run_client(int(port), int(control), float(period), clock, is_real_time)
    if options.realtime:
        print(request_realtime())
    sys.setswitchinterval(1e-4)
    rng = np.random.default_rng(0)
    print(f"worst of {options.tries} tries; time to rest and way from the loss, and")
    print("the part of the way that is after the end of the motion")
    print("plant   clock     period  lost by   TCP [m/s]  joint [rad/s]", end="")
    print("  rest [ms]  in the arm's time [ms]  way [mm]  after [mm]")
    for name in options.plant or PLANTS:
        for clock in options.clock or ("wall", "lockstep"):
            for text in options.period or ("1ms", "5ms"):
                for cause in CAUSES:
                    period = parse_duration(text, "--period")
                    losses = [
                        lose_once(name, period, clock, cause, rng)
                        for _ in range(options.tries)
                    ]
                    worst = np.max([loss[:6] for loss in losses], axis=0)
                    speed, fastest, rest, arm_rest, way, after = worst
                    print(
                        f"{name:7} {clock:9} {text:7} {cause:8} {speed:11.3f}  "
                        f"{fastest:12.2f}  "
                        f"{1e3 * rest:9.1f}  {1e3 * arm_rest:22.0f}  "
                        f"{1e3 * way:8.2f}  {1e3 * after:10.2f}",
                        flush=True,
                    )
                    for loss in losses:
                        if "missed in a row" not in loss.reason:
                            print(f"  ended by: {loss.reason}")


if __name__ == "__main__":
    main()
