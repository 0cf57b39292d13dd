"""Flood the UDP port of an arm behind FRI with broken datagrams while it moves.

    python benchmarks/fuzz_arm.py [--count 1000000]

They come from a stranger: the motion must go on, the same one, and nothing that they
say may count.
"""

import argparse
import multiprocessing
import socket
import time

from fri_loop import HOLE, LOOPBACK, Q_SEED, TOOL_DOWN, run_cabinet
from fuzz_cabinet import flood

from dovetail import _core
from dovetail.arms.fri_arm import FriAddress, FriArm
from dovetail.control.config import LimitConfig, OscConfig
from dovetail.control.settings import ControllerSettings
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.registered import find_cell

PERIOD = 0.005


def corpus() -> list[bytes]:
    """Return good messages in which a stranger claims another state and posture."""
    messages = []
    for state in range(5):
        message = _core.FriMonitoring()
        message.state = state
        message.quality = 3
        message.send_period_ms = 5
        message.q_measured = message.ipo_q = [0.1 * i for i in range(7)]
        message.tau_measured = message.tau_external = [1.0] * 7
        message.sequence = 1000 * state
        messages.append(message.encode(_core.fri_version("1.15")))
    return messages


def main() -> None:
    """Flood, then say what the arm counted and whether its motion went on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    options = parser.parse_args()
    options.plant, options.clock = "mujoco", "lockstep"
    options.period, options.realtime = PERIOD, False
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        port = probe.getsockname()[1]
    here, there = multiprocessing.Pipe()
    multiprocessing.Process(
        target=run_cabinet, args=(options, there), daemon=True
    ).start()
    here.send(port)
    robot = find_cell().loaded_robot()
    settings = ControllerSettings(
        osc=OscConfig.for_period(PERIOD),
        limits=LimitConfig.for_period(robot, PERIOD),
        task=TaskSpec.parse("XYZ:force A:pose BC:hold"),
        period=PERIOD,
    )
    address = FriAddress(
        host=LOOPBACK, port=port, clock="lockstep", control=here.recv()
    )
    arm = FriArm(address, robot, settings, log_folder=None)
    arm.reset(Q_SEED, HOLE)
    target = _core.Target()
    target.quat_wxyz_d = TOOL_DOWN
    arm.step(target)
    before = arm.statistics()
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender = multiprocessing.Process(
        target=flood, args=(link, (LOOPBACK, port), options.count, corpus())
    )
    start, steps = time.perf_counter(), 0
    sender.start()
    while sender.is_alive():
        arm.step(target)
        steps += 1
    wall = time.perf_counter() - start
    after = arm.statistics()
    print(f"{options.count} datagrams from a stranger in {wall:.0f} s, {steps} steps")
    names = ("foreign", "undecodable", "missed", "older", "motions", "stops")
    changes = {n: after["counts"][n] - before["counts"][n] for n in names}
    print(f"counted meanwhile: {changes}; {after['session']}")
    arm.close()


if __name__ == "__main__":
    main()
