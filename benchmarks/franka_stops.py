"""Time that a Franka takes to come to rest when one end of its loop is gone.

franka-sim is the control box, in a network namespace: as root, or the cut is left out.
A learner lets poses jump; while a joint is faster than 0.2 rad/s the learner or the
loop is killed or stopped, a stop is asked for, or the cable is cut. The time until no
joint is faster than 0.02 rad/s any more, in the mean of 20 ms, is taken from
franka-sim's own states: an arm that it holds vibrates at 500 Hz. Where the loop is
alive it brakes; where commands are missing the control box does, after 20 of them.

`python benchmarks/rehearse_franka.py --stops` runs this.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from beside_franka_sim import HOST, PYTHON, franka_in_step
from franka_rehearsed import AWAY, WALLS, make_arm, on
from franka_shared import Shared

MOVES, RESTS = 0.2, 0.02  # rad/s
BEGINS = 5
MEAN = 20  # states
SEEN = 2.0  # s in which an end is looked for
NAMED = 5.0  # s in which the learner must say what has happened
NETWORK = "10.77.0.1/24", "10.77.0.2/24"
OURS, THEIRS = "dovetail0", "dovetail1"

_LEARNER = "import franka_stops; franka_stops.learn('{}', {})"


class Stopped(NamedTuple):
    """One try."""

    speed: float
    """Fastest joint when it happened [rad/s]."""
    rest: float
    """Time until the arm was at rest [s]."""
    ended: float
    """Time until no torque was taken from the loop any more [s], or inf."""
    said: str
    """Name of the cause, where one was given."""


@contextmanager
def network() -> Iterator[tuple[str, str]]:
    """Yield the address of a namespace's end of a cable, and what enters it."""
    if os.geteuid() != 0 or shutil.which("ip") is None:
        yield HOST, ""
        return
    name = f"franka{os.getpid()}"
    ours, theirs = NETWORK
    inside = f"netns exec {name} ip"
    try:
        for command in (
            f"netns add {name}",
            f"link add {OURS} type veth peer name {THEIRS} netns {name}",
            f"addr add {ours} dev {OURS}",
            f"link set {OURS} up",
            f"{inside} addr add {theirs} dev {THEIRS}",
            f"{inside} link set {THEIRS} up",
            f"{inside} link set lo up",
        ):
            subprocess.run(["ip", *command.split()], check=True)
        yield theirs.partition("/")[0], f"ip netns exec {name}"
    finally:
        for command in (f"link del {OURS}", f"netns del {name}"):
            subprocess.run(["ip", *command.split()], check=False)


def learn(host: str, processor: int | None) -> None:
    """Let poses jump until something ends it; print its name."""
    from dovetail import _core
    from dovetail.errors import ArmError

    rng = np.random.default_rng()
    arm = make_arm("jumps", realtime=False, host=host, processor=processor)
    state = arm.reset(arm.facts.robot.posture("down"), AWAY)
    signal.signal(signal.SIGUSR1, lambda *_: arm.stop())
    target = _core.Target(quat_wxyz_d=state.tool.quat_wxyz)
    low, high = (np.array(wall) for wall in WALLS)
    print("moves", flush=True)
    try:
        for k in range(100_000):
            if k % 40 == 0:
                target.position_d = rng.uniform(low + 0.05, high - 0.05)
            begin = time.monotonic()
            arm.step(target)
            if time.monotonic() - begin > SEEN / 2.0:
                held = arm.statistics()["counts"]["held"]
                print(f"held: {held} cycles without a new Target", flush=True)
    except ArmError as error:
        print(f"{error.reason}: {error}", flush=True)
        os._exit(0)  # the loop may be stopped: nothing waits for it


def loop_of(learner: int) -> int:
    """Return the process of a learner's loop."""
    path = Path(f"/proc/{learner}/task/{learner}/children")
    return int(path.read_text().split()[0])


def cut(learner: int) -> None:
    """Take the cable out."""
    subprocess.run(["ip", "link", "set", OURS, "down"], check=True)


CASES: dict[str, Callable[[int], None]] = {
    "stop-asked-for": lambda learner: os.kill(learner, signal.SIGUSR1),
    "learner-killed": lambda learner: os.kill(learner, signal.SIGKILL),
    "learner-stopped": lambda learner: os.kill(learner, signal.SIGSTOP),
    "loop-killed": lambda learner: os.kill(loop_of(learner), signal.SIGKILL),
    "loop-stopped": lambda learner: os.kill(loop_of(learner), signal.SIGSTOP),
    "network-cut": cut,
}


def run(
    case: str, host: str, shared: Shared, processor: int | None, wait: float
) -> Stopped:
    """Run one try; the learner moves for a time [s] before."""
    learner = moving(host, processor)
    loop = loop_of(learner.pid)
    time.sleep(wait)
    while (fast := speed(shared)) < MOVES:
        time.sleep(0.001)
    begin = time.monotonic()
    CASES[case](learner.pid)
    time.sleep(SEEN)
    rows = shared.since(begin)
    said = what_was_said(learner, loop)
    if case == "network-cut":
        subprocess.run(["ip", "link", "set", OURS, "up"], check=True)
    times = rows[:, 0]
    took = (times[MEAN:] - times[:-MEAN])[:, None]
    means = np.abs((rows[MEAN:, 2:9] - rows[:-MEAN, 2:9]) / took).max(axis=1)
    rest = last(times[:-MEAN], means > RESTS) - begin
    return Stopped(fast, rest, last(times, rows[:, 1] > 0.0) - begin, said)


def moving(host: str, processor: int | None) -> subprocess.Popen[str]:
    """Return a learner that moves the arm."""
    for _ in range(BEGINS):
        learner = subprocess.Popen(
            [sys.executable, "-c", _LEARNER.format(host, processor)],
            cwd=Path(__file__).parent,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert learner.stdout is not None
        if learner.stdout.readline().strip() == "moves":
            return learner
        said = learner.communicate()[0].strip().splitlines()
        print(f"did not begin: {said[-1]}", file=sys.stderr)
    sys.exit(f"no learner of {BEGINS} could begin: the machine is too busy")


def speed(shared: Shared) -> float:
    """Return the fastest joint now [rad/s]."""
    rows = shared.since(time.monotonic() - 0.1)[-MEAN:]
    if len(rows) < MEAN:
        return 0.0
    return float(np.abs(rows[:, 9:].mean(axis=0)).max())


def last(times: np.ndarray, is_so: np.ndarray) -> float:
    """Return when something was so for the last time; inf if it still is."""
    if not is_so.any():
        return float(times[0])
    return float("inf") if is_so[-1] else float(times[is_so][-1])


def what_was_said(learner: subprocess.Popen[str], loop: int) -> str:
    """Let everything go on, and return what the learner or its loop has said."""
    try:
        text = learner.communicate(timeout=NAMED)[0]
    except subprocess.TimeoutExpired:
        os.kill(learner.pid, signal.SIGCONT)
        time.sleep(0.5)
        learner.kill()
        if is_there(loop):
            os.kill(loop, signal.SIGKILL)  # it has the pipe, too
        text = learner.communicate()[0]
    if is_there(loop):
        os.kill(loop, signal.SIGKILL)
    lines = [line for line in text.splitlines() if ":" in line]
    return lines[0] if lines else "nothing"


def is_there(process: int) -> bool:
    """Return whether a process runs, or is stopped."""
    return Path(f"/proc/{process}").exists()


def main(arguments: Sequence[str]) -> None:
    """Run the command line, --stops taken off."""
    parser = argparse.ArgumentParser(
        prog="rehearse_franka.py --stops",
        description=str(__doc__).splitlines()[0],
    )
    parser.add_argument("--tries", type=int, default=5)
    parser.add_argument("--only", choices=CASES, help="one case; else all")
    parser.add_argument("--python", type=Path, default=PYTHON, help="of franka-sim")
    parser.add_argument("--under", default="", help="starts it, such as 'chrt -f 20'")
    parser.add_argument("--processor", type=int, help="see rehearse_franka.py")
    args = parser.parse_args(arguments)
    rng = np.random.default_rng(0)
    print("| what happens | fastest joint | at rest after | commanded until | said |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, network() as (host, inside):
        file = Path(folder) / "shared"
        shared = Shared.made(file)
        with franka_in_step(
            args.python.absolute(),
            enforce=True,
            under=f"{inside} {on(args.processor)} {args.under}",
            host=host,
            options=("--shared", str(file)),
        ):
            for case in [args.only] if args.only else CASES:
                if case == "network-cut" and not inside:
                    print(f"| {case} | needs root | | | |")
                    continue
                tries = [
                    run(case, host, shared, args.processor, rng.uniform(0.5, 2.5))
                    for _ in range(args.tries)
                ]
                print_row(case, tries)


def print_row(case: str, tries: Sequence[Stopped]) -> None:
    """Print a case: its median and its worst."""
    speeds, rests, ends = (np.array([t[k] for t in tries]) for k in range(3))
    said = sorted({t.said.partition(":")[0] for t in tries})
    print(
        f"| {case.replace('-', ' ')} | {speeds.max():.2f} rad/s "
        f"| {np.median(rests):.2f}, {rests.max():.2f} s "
        f"| {np.median(ends):.2f}, {ends.max():.2f} s | {', '.join(said)} |",
        flush=True,
    )
    print(f"  {tries[0].said}", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
