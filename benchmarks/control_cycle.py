"""How long one control cycle takes, model terms included, beside a peer.

States come from closed loops on the exact arm: random postures, f* of +-5 m/s2 (a
harsh policy) or +-30 m/s2 (the adversary), 20 times a second. The recorded cycles are
replayed five times through `_core.replay`, which times each call of `Controller.step`
in C++. On a busy machine the 99th percentile shows the other processes; `quiet` takes
each cycle's fastest replay.

The peer is put together from public libraries on the same states: Pinocchio's generic
algorithms for the model terms (called from Python, the cost of an empty call taken off)
and DAQP for the same quadratic program (its own C timers, set-up included), each the
fastest of five calls. Its control law, bounds and disturbance estimate are not counted.
"""

# pyright: reportMissingImports=false
import argparse
import time
from typing import TYPE_CHECKING, Any

import daqp
import numpy as np
import pinocchio
from adversary import TASK, Adversary, Array, Settings

from dovetail import _core
from dovetail.control.build import make_controller
from dovetail.control.config import OscConfig

pin: Any = pinocchio  # its stubs name none of its compiled half

if TYPE_CHECKING:
    from collections.abc import Callable

    from dovetail.robots.robot import Robot

EPISODES = 20
SECONDS = 1.0  # of each episode
ACTION = 0.05  # s
REPLAYS = 5
PEER_CYCLES = 2000
Cycles = dict[str, Array]


def record(settings: Settings, episode: int) -> tuple[Adversary, Array, Cycles, Array]:
    """Run one closed loop; return what made it, its start, inputs and flags."""
    adversary = Adversary(settings, seed=1)
    adversary.rng = np.random.default_rng([1, episode])
    q = start = adversary.start()
    pose = adversary.robot.tool_pose(q)
    adversary.controller.reset(q, pose.position, pose.quat_wxyz)
    plant = adversary.plant()
    plant.reset(q, np.zeros(7))
    target = _core.Target()
    count = round(SECONDS / settings.period)
    cycles = {"q": np.empty((count, 7)), "dq": np.empty((count, 7))}
    cycles |= {"f_star": np.empty((count, 6)), "quat_wxyz_d": np.empty((count, 4))}
    limited = np.zeros(count)
    for k in range(count):
        if k % round(ACTION / settings.period) == 0:
            adversary.choose(target, episode % 3, q, pose.quat_wxyz, True)
        q, dq = plant.read()
        cycles["q"][k], cycles["dq"][k] = q, dq
        cycles["f_star"][k], cycles["quat_wxyz_d"][k] = (
            target.f_star,
            target.quat_wxyz_d,
        )
        result = adversary.controller.step(q, dq, target)
        limited[k] = result.flags.packed != 0
        plant.apply(result.tau, settings.period)
    return adversary, start, cycles, limited


def time_cycles(settings: Settings) -> tuple[Array, float, list[Cycles]]:
    """Return times (replay, cycle) [s], the share of limited cycles, the inputs."""
    times, shares, recorded = [], [], []
    for episode in range(EPISODES):
        adversary, start, cycles, limited = record(settings, episode)
        pose = adversary.robot.tool_pose(start)
        runs = []
        for _ in range(REPLAYS):
            adversary.controller.reset(start, pose.position, pose.quat_wxyz)
            runs.append(_core.replay(adversary.controller, **cycles)[1][:, 0])
        times.append(np.array(runs))
        shares.append(limited.mean())
        recorded.append(cycles)
    return np.hstack(times), float(np.mean(shares)), recorded


def pinocchio_model(robot: "Robot") -> Any:
    """Return the same arm as a Pinocchio model, the TCP as its last frame."""
    model = pin.Model()
    parent, at, links = 0, robot.geometry, robot.links
    for i in range(7):
        place = pin.SE3(at.origin_rotation[i], at.origin_position[i])
        parent = model.addJoint(parent, pin.JointModelRZ(), place, f"A{i + 1}")
        body = pin.Inertia(float(links.mass[i]), links.com[i], links.inertia[i])
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    position, rotation = at.tool_in_link()
    place = pin.SE3(rotation, position)
    model.addFrame(pin.Frame("tcp", parent, 0, place, pin.FrameType.OP_FRAME))
    return model


def time_call(function: "Callable[[], object]") -> float:
    """Return the fastest of a few calls [s]."""
    best = np.inf
    for _ in range(REPLAYS):
        begin = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - begin)
    return best


def time_terms(model: Any, data: Any, q: Array, dq: Array) -> float:
    """Return what Pinocchio needs for M, c, g, J and dJ dq at one state [s]."""
    frame = model.nframes - 1
    axes = pin.LOCAL_WORLD_ALIGNED
    zero = np.zeros(7)
    calls: list[Callable[[], object]] = [
        lambda: pin.crba(model, data, q),
        lambda: pin.nonLinearEffects(model, data, q, dq),
        lambda: pin.computeGeneralizedGravity(model, data, q),
        lambda: pin.computeFrameJacobian(model, data, q, frame, axes),
        lambda: pin.forwardKinematics(model, data, q, dq, zero),
    ]
    empty = time_call(lambda: None)
    return sum(max(time_call(call) - empty, 0.0) for call in calls)


def time_qp(
    controller: _core.Controller, chain: _core.Chain, q: Array, dq: Array, target: Any
) -> float:
    """Return what DAQP needs for the cycle's quadratic program [s], by its timers."""
    terms = controller.osc_terms(q, dq, target)
    M, h = terms["M"], terms["h"]
    a0 = terms["Minv"] @ (terms["u0"] - h)
    J, g = chain.jacobian(q)[:3], chain.gravity(q)
    djc = chain.jacobian_dot_dq(q, dq)[:3]
    limits = controller.limits
    H = np.eye(10) * limits.rho
    H[:7, :7] = M
    f = np.append(-M @ a0, np.zeros(3))
    free = np.full(3, 1e30)
    A = np.zeros((10, 10))
    A[:3] = np.hstack([J, -np.eye(3)])
    A[3:, :7] = M
    room = limits.tau_max - h
    upper = np.concatenate([terms["ub"], free, terms["cu"] - djc, room - g])
    lower = np.concatenate([terms["lb"], -free, terms["cl"] - djc, -room - g - 2 * h])
    best = np.inf
    for _ in range(REPLAYS):
        info = daqp.solve(H, f, A, upper, lower, np.zeros(20, np.int32))[3]
        best = min(best, info["setup_time"] + info["solve_time"])
    return best


def time_peer(settings: Settings, recorded: list[Cycles]) -> tuple[Array, Array]:
    """Return Pinocchio's and DAQP's time in a sample of the recorded cycles [s]."""
    adversary = Adversary(settings, seed=1)
    model = pinocchio_model(adversary.robot)
    data = model.createData()
    model.armature[:] = adversary.robot.motors.armature
    controller = make_controller(
        adversary.robot,
        OscConfig.for_period(settings.period),
        adversary.limits,
        TASK,
        settings.period,
    )
    rows = {k: np.concatenate([c[k] for c in recorded]) for k in recorded[0]}
    rng = np.random.default_rng(0)
    terms, programs = [], []
    for k in rng.choice(len(rows["q"]), PEER_CYCLES, replace=False):
        q, dq = rows["q"][k], rows["dq"][k]
        target = _core.Target(f_star=rows["f_star"][k])
        target.quat_wxyz_d = rows["quat_wxyz_d"][k]
        controller.reset(q, np.zeros(3), np.array([1.0, 0, 0, 0]))
        terms.append(time_terms(model, data, q, dq))
        programs.append(time_qp(controller, adversary.chain, q, dq, target))
    return np.array(terms), np.array(programs)


def row(name: str, seconds: Array, note: str = "") -> None:
    """Print percentiles in microseconds; `seconds` has a row for each replay."""
    p50, p99 = 1e6 * np.percentile(seconds, [50, 99])
    quiet = 1e6 * np.percentile(np.min(np.atleast_2d(seconds), axis=0), [50, 99])
    print(f"{name:32s} {p50:6.2f} {p99:6.2f}  {quiet[0]:6.2f} {quiet[1]:6.2f}  {note}")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--period", type=float, default=1e-3, help="[s]")
    parser.add_argument(
        "--robot",
        nargs="+",
        default=[None],
        help="by name, without a tool; or the cell's. Of several the cycles are "
        "compared with the first one's",
    )
    args = parser.parse_args()
    print(f"{'':32s} {'all':>13s}  {'quiet':>13s}")
    print(
        f"{'control cycle [us]':32s} {'p50':>6s} {'p99':>6s}  {'p50':>6s} {'p99':>6s}"
    )
    for f_star in (5.0, 30.0):
        for scheme in ("qp", "paper"):
            first = None
            for robot in args.robot:
                settings = Settings(
                    robot=robot, period=args.period, scheme=scheme, f_star=f_star
                )
                times = print_robot(settings)
                first = times if first is None else first
                ratios = np.percentile(times, [50, 99]) / np.percentile(first, [50, 99])
                if robot != args.robot[0]:
                    print(
                        f"of {args.robot[0]}: p50 {ratios[0]:.2f}, p99 {ratios[1]:.2f}"
                    )


def print_robot(settings: Settings) -> Array:
    """Print a robot's rows; returns each cycle's fastest time [s]."""
    times, share, recorded = time_cycles(settings)
    name = f"{settings.robot} " if settings.robot else ""
    note = f"{share:.0%} of the cycles limited"
    row(f"{name}dovetail {settings.scheme}, f* {settings.f_star:.0f}", times, note)
    quiet: Array = times.min(axis=0)
    if settings.scheme != "paper":
        terms, programs = time_peer(settings, recorded)
        row(f"{name}peer: Pinocchio terms", terms)
        row(f"{name}peer: DAQP", programs)
        row(f"{name}peer: both", terms + programs, "no control law")
        ratio = np.median(terms + programs) / np.median(quiet)
        print(f"the peer's median is {ratio:.1f} times ours")
    return quiet


if __name__ == "__main__":
    main()
