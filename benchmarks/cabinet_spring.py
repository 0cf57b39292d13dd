"""The stiffness that the doctor finds in simulated cabinets whose stiffness is known.

    python benchmarks/cabinet_spring.py --clock wall --busy 1

Cabinet and doctor are processes of their own, as on a robot's network; by the clock,
`--busy` processes that never rest run beside them. A line for each cabinet.
"""

import argparse
import itertools
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from dovetail.arms.fri_arm import FriAddress
from dovetail.doctor.check import Check
from dovetail.doctor.fri_arm import run_fri_checks

SPRING = "cabinet's spring"
_TRIES = 5


def free_port(kind: socket.SocketKind) -> int:
    """Return a free port of this machine."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def cabinet(
    options: argparse.Namespace, stiffness: float, damping: float, period: int
) -> Iterator[FriAddress]:
    """Run a cabinet; yields the address of its arm."""
    client, control = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM)
    words = (
        f"cabinet --twin {options.twin} --period {period}ms --clock {options.clock} "
        f"--stiffness {stiffness} --damping {damping} {options.cabinet} "
        f"--client 127.0.0.1:{client} --port {free_port(socket.SOCK_DGRAM)} "
        f"--control 127.0.0.1:{control}"
    )
    if options.realtime:
        words += " --realtime"
    program = [sys.executable, "-m", "dovetail", *words.split()]
    with subprocess.Popen(program, stdout=subprocess.DEVNULL) as running:
        try:
            yield FriAddress.parse(
                f"fri://127.0.0.1:{client}?period={period}ms&clock={options.clock}"
                f"&control=127.0.0.1:{control}&reset=move&timeout=60s"
                f"&realtime={'yes' if options.realtime else 'no'}"
            )
        finally:
            running.terminate()


def find_spring(
    options: argparse.Namespace, stiffness: float, damping: float, period: int
) -> Check:
    """Return the doctor's check of the spring; a motion that ends is tried again."""
    check = Check(SPRING, "broken", "not reached")
    for _ in range(_TRIES):
        with cabinet(options, stiffness, damping, period) as address:
            for check in run_fri_checks(address, None):
                if check.name == SPRING:
                    return check
    return check


def main() -> None:
    """Print a line for each cabinet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clock", choices=("wall", "lockstep"), default="wall")
    parser.add_argument("--busy", type=int, default=0, help="processes beside it")
    parser.add_argument("--realtime", action="store_true", help="as on a robot")
    parser.add_argument("--twin", default="medium")
    parser.add_argument(
        "--cabinet",
        default="",
        help="options of it: '--good-from 0.2 --stop-slots 200' bears late answers",
    )
    parser.add_argument("--periods", nargs="*", type=int, default=[1, 5], help="[ms]")
    parser.add_argument(
        "--stiffness", nargs="*", type=float, default=[0, 20, 50, 200, 1000]
    )
    parser.add_argument("--damping", nargs="*", type=float, default=[0.0, 0.7])
    parser.add_argument("--repeats", type=int, default=2)
    options = parser.parse_args()
    spin = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(spin) for _ in range(options.busy)]
    try:
        grid = itertools.product(options.periods, options.stiffness, options.damping)
        for period, stiffness, damping in grid:
            for _ in range(options.repeats if stiffness or not damping else 0):
                check = find_spring(options, stiffness, damping, period)
                said = f"{period} ms {stiffness:g} Nm/rad {damping:g}"
                print(f"{said}: {check.name} {check.detail}", flush=True)
    finally:
        for process in busy:
            process.kill()


if __name__ == "__main__":
    main()
