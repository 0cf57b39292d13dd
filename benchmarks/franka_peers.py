"""A Franka's tool on a circle, and after a jump, by dovetail and by two peers.

All work against franka-sim, FCI's limits enforced, one after the other: 20 s of a
circle (80 mm, 5 s) in free space, then a step of 50 mm, then a jump of 0.3 m. The arm's
own states are compared with the wanted position, by the arm's clock.

Peers, as their makers set them: franky's `CartesianImpedanceTracker` (2.0.0, 500 N/m,
an error clip of 0.1 m, at most 1 Nm per cycle), with position, velocity and
acceleration every 10 ms; and the law of libfranka's Cartesian impedance example (150
N/m, critically damped) in Python over pylibfranka, every millisecond. The example
itself holds one pose; the law says nothing about jumps. It runs once as it is and once
with the change of torque cut at 0.99 Nm per cycle: FCI allows 1.
dovetail gets a Target every 50 ms.
"""

import argparse
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

HOST = "127.0.0.1"
ROOT = Path(__file__).parents[1]
FRANKY = ROOT / ".venv/franky/bin/python"
RADIUS, TURN = 0.08, 5.0  # m, s
CIRCLE, STAY = 20.0, 4.0  # s: the circle, and after each step
STEPS = (0.05, 0.3)  # m, along y, there and back
SETTLED = 0.005  # m
CLIENTS = ("dovetail", "franky", "example", "example, limited")
Array = np.ndarray


class Wanted(NamedTuple):
    """Position, velocity and acceleration against the start, world axes."""

    position: Array
    velocity: Array
    acceleration: Array


def circle(t: float) -> Wanted:
    """Return the wanted motion at a time [s]: its radius grows within a turn."""
    w = 2.0 * math.pi / TURN
    share = min(t / TURN, 1.0)
    size = RADIUS * share * share * (3.0 - 2.0 * share)
    grows = RADIUS * 6.0 * share * (1.0 - share) / TURN
    c, s = math.cos(w * t), math.sin(w * t)
    way, turn = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
    return Wanted(
        size * way,
        grows * way + size * w * turn,
        2.0 * grows * w * turn - size * w * w * way,
    )


def still(offset: float) -> Wanted:
    """Return a place aside that is wanted at once."""
    return Wanted(np.array([0.0, offset, 0.0]), np.zeros(3), np.zeros(3))


def phases(size: float) -> list[tuple[str, float, Callable[[float], Wanted]]]:
    """Return what is wanted one after the other: a name, a time [s], the motion.

    Args:
        size: Share of the times: 1, or less to try.
    """
    parts: list[tuple[str, float, Callable[[float], Wanted]]]
    parts = [
        ("circle", size * CIRCLE, circle),
        ("back", size * STAY, lambda _: still(0)),
    ]
    for step in STEPS:
        name = f"{1e3 * step:.0f} mm"
        there: Callable[[float], Wanted] = lambda _, y=-0.5 * step: still(y)  # noqa: E731
        parts.append((f"before {name}", size * STAY, there))
        parts.append((name, size * STAY, lambda _, y=0.5 * step: still(y)))
    return parts


class Ran(NamedTuple):
    """What one controller came to."""

    rows: list[tuple[str, list[list[float]]]]
    """Of every phase: time [s] and position against the start [m], 4 numbers a row."""
    cycles: int
    lost: int
    """Cycles of the arm that had no command."""
    ended: str
    """Name of the reflex that ended the motion; empty without."""


def run_dovetail(size: float) -> Ran:
    """Follow by dovetail's arm, with Targets of 50 ms."""
    from franka_rehearsed import AWAY, make_arm

    from dovetail import _core
    from dovetail.errors import ArmError
    from dovetail.plants.plant import COLUMN

    arm = make_arm("jumps", realtime=False)
    state = arm.reset(arm.facts.robot.posture("down"), AWAY)
    start, x = state.tool.position, COLUMN["x"]
    target = _core.Target(quat_wxyz_d=state.tool.quat_wxyz)
    rows: list[tuple[str, list[list[float]]]] = []
    ended = ""
    try:
        for name, duration, motion in phases(size):
            begin, found = state.stamp, []
            rows.append((name, found))
            for _ in range(round(duration / 0.05)):
                wanted = motion(state.stamp - begin)
                target.position_d = start + wanted.position
                target.velocity_d = np.append(wanted.velocity, np.zeros(3))
                target.acceleration_d = np.append(wanted.acceleration, np.zeros(3))
                state = arm.step(target)
                log = state.log[:, [0, x, x + 1, x + 2]] - [begin, *start]
                found += log.tolist()
    except ArmError as error:
        ended = error.reason
    counts = arm.statistics()["counts"]
    arm.close()
    return Ran(rows, counts["cycles"], counts["lost"], ended)


def run_example(size: float, dtau_max: float = math.inf) -> Ran:
    """Follow by the law of libfranka's Cartesian impedance example.

    Args:
        size: Share of the times.
        dtau_max: Most that a torque changes in a cycle [Nm].
    """
    import pylibfranka

    from dovetail.poses import quat_from_matrix, rotation_error

    robot = pylibfranka.Robot(HOST, pylibfranka.RealtimeConfig.kIgnore)
    robot.set_collision_behavior([100.0] * 7, [100.0] * 7, [100.0] * 6, [100.0] * 6)
    model = robot.load_model()
    K = np.array([150.0] * 3 + [10.0] * 3)
    D = 2.0 * np.sqrt(K)
    rows: list[tuple[str, list[list[float]]]] = []
    lost = cycles = 0
    control, start, quat, ended = robot.start_torque_control(), None, None, ""
    tau_d, now = np.zeros(7), 0.0
    try:
        for name, duration, motion in phases(size):
            begin, found = now, []
            rows.append((name, found))
            while now - begin < duration:
                state, passed = control.readOnce()
                now += passed.to_sec() if cycles else 0.0
                lost += max(0, round(1e3 * passed.to_sec()) - 1) if cycles else 0
                cycles += 1
                pose = np.array(state.O_T_EE).reshape(4, 4, order="F")
                here, turned = pose[:3, 3], quat_from_matrix(pose[:3, :3])
                if start is None or quat is None:
                    start, quat = here, turned
                wanted = motion(now - begin)
                e = np.append(
                    start + wanted.position - here, rotation_error(quat, turned)
                )
                J = np.array(model.zero_jacobian(state)).reshape(6, 7, order="F")
                dq = np.array(state.dq)
                tau = J.T @ (K * e - D * (J @ dq)) + np.array(model.coriolis(state))
                tau_d = np.clip(tau, tau_d - dtau_max, tau_d + dtau_max)
                control.writeOnce(pylibfranka.Torques(tau_d.tolist()))
                found.append([now - begin, *(here - start)])
        last = pylibfranka.Torques(tau_d.tolist())
        control.readOnce()
        last.motion_finished = True
        control.writeOnce(last)
    except pylibfranka.ControlException as error:
        ended = str(error)
    return Ran(rows, cycles, lost, ended)


def run_franky(size: float) -> Ran:
    """Follow by franky's tracker; runs in its own environment."""
    import franky  # pyright: ignore[reportMissingImports]

    robot = franky.Robot(HOST, realtime_config=franky.RealtimeConfig.Ignore)
    robot.recover_from_errors()
    seen: list[tuple[float, float, list[float]]] = []

    def look(state: Any, step: Any, relative: Any, now: Any, signal: Any) -> None:
        at = state.O_T_EE.translation
        seen.append((now.to_sec(), step.to_sec(), np.asarray(at).tolist()))

    begins: list[tuple[str, float]] = []
    ended = ""
    start = robot.current_pose.end_effector_pose
    try:
        with franky.CartesianImpedanceTracker(robot, period=0.01) as tracker:
            tracker.motion.register_callback(look)
            tracker.tick()
            while not seen:
                time.sleep(0.001)
            for name, duration, motion in phases(size):
                begin = seen[-1][0]
                begins.append((name, begin))
                while seen[-1][0] - begin < duration and tracker.tick():
                    wanted = motion(seen[-1][0] - begin)
                    place = np.asarray(start.translation) + wanted.position
                    tracker.set_target(
                        franky.Affine(place, start.quaternion),
                        twist=franky.Twist(wanted.velocity, np.zeros(3)),
                        acceleration=franky.TwistAcceleration(
                            wanted.acceleration, np.zeros(3)
                        ),
                    )
    except franky.ControlException as error:
        ended = str(error)
    times = np.array([s[0] for s in seen])
    places = np.array([s[2] for s in seen]) - np.asarray(start.translation)
    rows = []
    ends = [*(b for _, b in begins[1:]), math.inf]
    for (name, begin), end in zip(begins, ends, strict=True):
        at = (times > begin) & (times <= end)
        found = np.column_stack([times[at] - begin, places[at]]).tolist()
        rows.append((name, found))
    lost = sum(max(0, round(1e3 * s[1]) - 1) for s in seen[1:])
    return Ran(rows, len(seen), lost, ended)


def run_apart(python: Path, size: float) -> Ran:
    """Run franky's part by its own Python, and read what it prints."""
    done = subprocess.run(
        [python, __file__, "--size", str(size), "--only", "franky", "--as-client"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"franky has ended with {done.returncode}: {done.stderr}")
    return Ran(*json.loads(done.stdout.splitlines()[-1]))


def place() -> None:
    """Bring the arm to where each one begins."""
    from franka_rehearsed import AWAY, make_arm

    arm = make_arm("jumps", realtime=False)
    arm.reset(arm.facts.robot.posture("down"), AWAY)
    arm.close()


def print_row(name: str, ran: Ran) -> None:
    """Print a controller's errors on the circle, and how it settles after each step."""
    found = {phase: np.array(rows) for phase, rows in ran.rows if rows}
    cells = []
    rows = found.get("circle", np.empty((0, 4)))
    rows = rows[rows[:, 0] > TURN]
    if len(rows):
        wanted = np.array([circle(t).position for t in rows[:, 0]])
        error = 1e3 * np.linalg.norm(rows[:, 1:] - wanted, axis=1)
        cells.append(f"{np.sqrt(np.mean(error**2)):.1f}, {error.max():.1f} mm")
    else:
        cells.append("none")
    for step in STEPS:
        rows = found.get(f"{1e3 * step:.0f} mm", np.empty((0, 4)))
        cells.append(settling(rows, 0.5 * step) if len(rows) else "not reached")
    names = ", ".join(re.findall(r"[a-z_]{12,}", ran.ended)) or ran.ended
    cells += [names or "none", f"{ran.lost} of {ran.cycles}"]
    print(f"| {name} | {' | '.join(cells)} |", flush=True)


def settling(rows: Array, goal: float) -> str:
    """Return when the tool stays within 5 mm of a goal [m], and how far beyond it was.

    Args:
        rows: Time [s] and position [m], 4 numbers a row.
        goal: Along y.
    """
    error = np.linalg.norm(rows[:, 1:] - [0.0, goal, 0.0], axis=1)
    beyond = 1e3 * max(0.0, float((rows[:, 2] - goal).max()))
    if error[-1] > SETTLED:
        return f"{1e3 * error[-1]:.0f} mm off at the end, {beyond:.0f} mm beyond"
    late = np.flatnonzero(error > SETTLED)
    time_to = rows[late[-1], 0] if len(late) else 0.0
    return f"{time_to:.2f} s, {beyond:.0f} mm beyond"


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--size", type=float, default=1.0, help="share of the times")
    parser.add_argument("--only", choices=CLIENTS, help="one of them; else all")
    parser.add_argument("--franky", type=Path, default=FRANKY, help="a Python with it")
    parser.add_argument("--processor", type=int, help="all of it stays on this one")
    parser.add_argument("--under", default="", help="starts it, such as 'chrt -f 20'")
    parser.add_argument("--python", type=Path, help="of franka-sim")
    parser.add_argument("--as-client", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.as_client:  # in franky's environment there is no dovetail
        print(json.dumps(run_franky(args.size)))
        return
    from beside_franka_sim import PYTHON, franka_in_step
    from franka_rehearsed import on

    runs: dict[str, Callable[[], Ran]] = {
        "dovetail": lambda: run_dovetail(args.size),
        "franky": lambda: run_apart(args.franky.absolute(), args.size),
        "example": lambda: run_example(args.size),
        "example, limited": lambda: run_example(args.size, 0.99),
    }
    if args.processor is not None:
        os.sched_setaffinity(0, {args.processor})
    print("| | circle, RMS, max | step of 50 mm | jump of 0.3 m | reflex | lost |")
    print("|---|---|---|---|---|---|")
    under = f"{on(args.processor)} {args.under}"
    python = (args.python or PYTHON).absolute()
    with franka_in_step(python, enforce=True, under=under):
        for name in [args.only] if args.only else CLIENTS:
            place()
            print_row(name, runs[name]())
            time.sleep(0.5)


if __name__ == "__main__":
    main()
