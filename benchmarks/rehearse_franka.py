"""A Franka's loop against franka-sim, which ends a motion as the robot does.

franka-sim is somebody else's simulator of Franka's control box, in an environment of
its own: `make rehearse-franka` sets it up and runs this. Behaviours take turns: random
corners of f*, corners that are held for a second, a joint that is driven to its nearer
limit, reaches at 0.25 m/s, poses that jump by 0.3 m and 90 degrees, and policies that
are switched every two seconds. Motions that end early are counted by reason, and so are
cycles that had no command in time; after each of them the behaviour goes on. With
`--push 30` the hand is pushed meanwhile.

`--stops` kills, stops and disconnects one end of the loop: `franka_stops`.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from beside_franka_sim import PYTHON, franka_in_step
from franka_rehearsed import AWAY, WALLS, make_arm, on
from franka_shared import Shared

from dovetail import _core
from dovetail.arms.franka.arm import FrankaArm
from dovetail.errors import ArmError
from dovetail.poses import quat_about_z, quat_multiply

F_STAR = 5.0  # m/s2
SWITCHED = ("random", "held", "to a limit", "joints")
KINDS = (*SWITCHED[:3], "reaches", "jumps", "switched")
STEPS = 40  # of 50 ms between two jumps, reaches or policies
REACH = 0.25 * 0.05  # m in a step of 50 ms


def behave(
    arm: FrankaArm, kind: str, steps: int, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Act for so many steps of 50 ms; yields each one's torque rates [Nm/s]."""
    robot = arm.facts.robot
    state = arm.reset(robot.posture("down"), AWAY)
    hold = turned = state.tool.quat_wxyz
    at = goal = state.tool.position
    low, high = (np.array(wall) for wall in WALLS)
    target = _core.Target()
    signs, now = np.ones(3), kind
    yield np.zeros(7)  # it is at its start
    for k in range(steps):
        if kind == "switched":
            now = SWITCHED[k // STEPS % len(SWITCHED)]
        is_new = k % STEPS == 0
        turn = quat_about_z(rng.uniform(-0.8, 0.8))
        target.joint_mode = now == "joints"
        if now in ("reaches", "jumps"):
            if is_new:
                goal = rng.uniform(low + 0.05, high - 0.05)
                yaw = (now == "jumps") * rng.choice([-1.0, 1.0]) * np.pi / 4.0
                turned = quat_multiply(quat_about_z(yaw), hold)
            at = nearer(at, goal, REACH if now == "reaches" else np.inf)
            target.position_d = at
            target.quat_wxyz_d = turned
        elif now == "joints" and is_new:
            target.q_d = robot.posture("down") + rng.uniform(-0.2, 0.2, 7)
        elif now != "joints":
            if now == "to a limit":
                signs = towards_a_limit(arm, state.q, int(rng.integers(7)))
            elif now == "random" or k % 20 == 0:
                signs = rng.choice([-1.0, 1.0], 3)
            target.f_star = np.append(F_STAR * signs, np.zeros(3))
            target.quat_wxyz_d = quat_multiply(turn, hold)
        state = arm.step(target)
        cycles = np.maximum(np.diff(state.log[:, :1], axis=0), 1e-3)
        rates = np.abs(np.diff(state.log[:, 15:22], axis=0)) / cycles
        yield rates.max(axis=0, initial=0.0)


def nearer(at: np.ndarray, goal: np.ndarray, most: float) -> np.ndarray:
    """Return the place that is nearer to a goal by so much [m], or the goal."""
    way = goal - at
    return at + way * min(1.0, most / max(float(np.linalg.norm(way)), 1e-9))


def towards_a_limit(arm: FrankaArm, q: np.ndarray, joint: int) -> np.ndarray:
    """Return the signs of f* that drive a joint to its nearer limit."""
    limits = arm.facts.robot.limits
    middle = (limits.q_min + limits.q_max) / 2.0
    signs = np.sign(arm.facts.robot.chain().jacobian(q)[:3, joint])
    return signs * (1.0 if q[joint] > middle[joint] else -1.0)


def rehearse(args: argparse.Namespace, shared: Shared) -> Counter[str]:
    """Run the behaviours; returns how many motions ended early, by reason."""
    rng = np.random.default_rng(args.seed)
    kinds = [args.only] if args.only else KINDS
    steps = max(1, round(args.minutes * 60.0 / 0.05 / len(kinds)))
    early: Counter[str] = Counter()
    for kind in kinds:
        left = steps
        while left > 0:
            done = one_motion(args, kind, left, rng, shared, early)
            left = left - done if done else 0  # else another would not begin either
            time.sleep(0.5)
    return early


def one_motion(
    args: argparse.Namespace,
    kind: str,
    steps: int,
    rng: np.random.Generator,
    shared: Shared,
    early: Counter[str],
) -> int:
    """Print a line of one motion, and count its end; returns the steps that it took."""
    arm = make_arm(kind, realtime=args.realtime, processor=args.processor)
    fastest, done = np.zeros(7), -1  # the first is the start
    try:
        for rate in behave(arm, kind, steps, rng):
            shared.push = args.push
            fastest = np.maximum(fastest, rate)
            done += 1
        end = f"torque rate up to {fastest.max():.0f} Nm/s"
    except ArmError as error:
        early[error.reason] += 1
        end = f"{error.reason}: {error}"
    finally:
        shared.push = 0.0
        arm.close()
    found = arm.statistics()
    counts = found.get("counts", {"cycles": 0, "lost": 0, "held": 0})
    times = "/".join(f"{1e6 * t:.0f}" for t in found.get("times", {}).values())
    print(
        f"{kind:12s} {counts['cycles']:8d} {counts['lost']:6d} "
        f"{counts['held']:6d} {times:>24s}  {end}",
        flush=True,
    )
    return max(done, 0)


def main() -> None:
    """Run the command line."""
    if "--stops" in sys.argv[1:]:
        import franka_stops

        franka_stops.main([a for a in sys.argv[1:] if a != "--stops"])
        return
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--python", type=Path, default=PYTHON, help="of franka-sim")
    parser.add_argument("--only", choices=KINDS, help="one behaviour; else all")
    parser.add_argument("--push", type=float, default=0.0, help="at the hand [N]")
    parser.add_argument("--realtime", action="store_true", help="real-time priority")
    parser.add_argument("--under", default="", help="starts it, such as 'chrt -f 20'")
    parser.add_argument(
        "--processor",
        type=int,
        help="franka-sim and the loop stay on it: where one is paused, so is the other",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--stops", action="store_true", help="has its own --help")
    args = parser.parse_args()
    names = "behaviour", "cycles", "lost", "held", "loop p50/p99/max [us]"
    print("{:12s} {:>8s} {:>6s} {:>6s} {:>24s}".format(*names), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "shared"
        shared = Shared.made(file)
        options = ("--shared", str(file))
        python = args.python.absolute()
        under = f"{on(args.processor)} {args.under}"
        with franka_in_step(python, enforce=True, under=under, options=options):
            early = rehearse(args, shared)
    reasons = ", ".join(f"{reason} {count}" for reason, count in early.items())
    print(f"motions that ended early: {early.total()}{reasons and f' ({reasons})'}")
    sys.exit(1 if early else 0)


if __name__ == "__main__":
    main()
