"""Kill learners in mid-motion: is the arm held, are limits kept, can the next go on?

    python benchmarks/learner_kills.py [--kills 100] [--twin medium] [--realtime]

The whole road: a simulated cabinet by the clock in a process of its own, the controller
process with its gRPC service here, and learners in processes of their own that push at
random until SIGKILL ends them. Held is from the kill until the servo loop follows no
Target any more, by the service's stop or its own watchdog (0.15 s); at rest until no
joint is faster than 0.01 rad/s. Every control cycle until then is checked against the
limits of position, speed and workspace. Where the cabinet itself had ended the motion
(answers late on a busy machine) the arm was held before the kill; those are counted
apart.
"""

import argparse
import signal
import socket
import subprocess
import sys
import time

import numpy as np

from dovetail import _core
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.arms.remote_arm import GrpcAddress, RemoteArm
from dovetail.arms.watchdog import WatchdogConfig
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell
from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS
from dovetail.poses import Pose, quat_about_z
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.rpc.server import ArmServer
from dovetail.types import Array
from dovetail.workcell.workcell import Workcell

PERIOD, TASK = 0.005, "XYZ:force A:pose BC:hold"
TOOL_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
HOLE = Pose(np.array([0.60, 0.0, 0.10]), quat_about_z(0.0))
Q_SEED = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])
AT_REST = 0.01  # rad/s
_ACTIVE = 4  # session state COMMANDING_ACTIVE


class UnloggedAddress(FriAddress):
    """Of an arm that writes no file when a motion ends."""

    def build(
        self,
        cell: Workcell,
        settings: ControllerSettings,
        watchdog: WatchdogConfig | None = None,
    ) -> FriArm:
        """Listen for the cabinet."""
        return FriArm(
            self, cell.loaded_robot(), settings, watchdog=watchdog, log_folder=None
        )


def learn(address: str, seed: int) -> None:
    """Push at random until killed."""
    robot = find_cell().loaded_robot()
    osc, limits = OscConfig(), LimitConfig.for_period(robot, PERIOD, hardware=True)
    settings = ControllerSettings(
        osc=osc, limits=limits, task=TaskSpec.parse(TASK), period=PERIOD
    )
    arm = RemoteArm(GrpcAddress.parse(address), settings, robot=robot)
    start = Pose(np.array([0.60, 0.0, 0.20]), TOOL_DOWN)
    arm.reset(robot.inverse_kinematics(start, Q_SEED), HOLE)
    rng = np.random.default_rng(seed)
    print("moving", flush=True)
    while True:
        f_star = np.array([*rng.uniform(-8.0, 8.0, 3), 0.0, 0.0, 0.0])
        arm.step(_core.Target(f_star=f_star, quat_wxyz_d=TOOL_DOWN))


def count_outside(rows: Array, limits: LimitConfig) -> int:
    """Return how many control cycles are outside a limit."""
    q = rows[:, COLUMN["q1"] : COLUMN["q7"] + 1]
    dq = rows[:, COLUMN["dq1"] : COLUMN["dq7"] + 1]
    x = rows[:, COLUMN["x"] : COLUMN["z"] + 1]
    tool = limits
    outside = (
        ((q < limits.q_min) | (q > limits.q_max)).any(axis=1)
        | (np.abs(dq) > limits.dq_max).any(axis=1)
        | ((x < tool.x_min) | (x > tool.x_max)).any(axis=1)
    )
    for row in rows[outside]:
        print(f"outside: q {row[1:8].round(4)} dq {row[8:15].round(3)} x {row[22:25]}")
    return int(outside.sum())


def kill_one(server: ArmServer, offered: OfferedArm, number: int) -> list[float]:
    """Return time until held and until at rest [s], speed when killed, cycles outside.

    Held is not-a-number where the cabinet had ended the motion before.

    Raises:
        TimeoutError: The arm was not held.
    """
    learner = subprocess.Popen(
        [sys.executable, __file__, f"--learner={server.url}:{number}"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert learner.stdout is not None
    assert learner.stdout.readline() == "moving\n"
    arm = offered.arm
    assert isinstance(arm, FriArm)
    first = arm.monitoring().rows
    time.sleep(0.3 + 0.7 * np.random.default_rng(number).random())
    before = arm.monitoring()
    speed = float(np.abs(before.dq).max())
    killed = time.monotonic()
    learner.send_signal(signal.SIGKILL)
    held = rest = 0.0
    while not rest:
        state, now = arm.monitoring(), time.monotonic() - killed
        if (state.is_held or state.is_stopped) and not held:
            held = now
        if held and np.abs(state.dq).max() < AT_REST:
            rest = now
        if now > 10.0:
            raise TimeoutError(f"kill {number}: held {held:g} s, at rest {rest:g} s")
        time.sleep(0.0005)
    if before.session != _ACTIVE or arm.monitoring().motion != before.motion:
        held = rest = np.nan
    rows = arm._servo.rows(first, arm.monitoring().rows, len(CYCLE_COLUMNS))
    learner.wait()
    while server.service.leases.holder is not None:
        time.sleep(0.001)
    return [held, rest, speed, float(count_outside(rows, arm.facts.limits))]


def run(kills: int, twin: str, realtime: bool) -> None:
    """Start cabinet and service, kill, print."""
    cell = find_cell()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = f"cabinet --twin {twin} --clock wall --client 127.0.0.1:{port}"
    words += f" --port {port + 1} --control 127.0.0.1:{port + 2}"
    words += " --realtime" if realtime else ""
    cabinet = subprocess.Popen(
        [sys.executable, "-m", "dovetail.cli", *words.split()],
        stdout=subprocess.DEVNULL,
    )

    address = UnloggedAddress(
        host="127.0.0.1",
        port=port,
        control=f"127.0.0.1:{port + 2}",
        realtime=realtime,
    )
    try:
        offered = OfferedArm(address, cell)
        time.sleep(4.0)
        with ArmServer(offered, "127.0.0.1:0") as server:
            results = np.array([kill_one(server, offered, i) for i in range(kills)])
    finally:
        cabinet.send_signal(signal.SIGINT)
        cabinet.wait(timeout=20)
    held, rest, speed, outside = results.T
    print(f"{kills} learners killed in motion, {kills} times the next one took over")
    for name, values in (("held after", held), ("at rest after", rest)):
        p50, p99, worst = 1e3 * np.nanpercentile(values, [50, 99, 100])
        print(f"{name:14} p50 {p50:.1f} ms, p99 {p99:.1f} ms, max {worst:.1f} ms")
    print(f"motions that the cabinet had ended before: {np.isnan(held).sum()}")
    print(f"fastest joint when killed: median {np.median(speed):.2f} rad/s")
    print(f"control cycles outside a limit: {outside.sum():.0f}")


def main() -> None:
    """Run, or be a learner."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the cabinet, too
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--twin", default="medium")
    parser.add_argument("--realtime", action="store_true")
    parser.add_argument("--learner", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.learner:
        address, _, seed = options.learner.rpartition(":")
        learn(address, int(seed))
    run(options.kills, options.twin, options.realtime)


if __name__ == "__main__":
    main()
