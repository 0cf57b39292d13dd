"""Does the arm keep its limits under a shipped policy, at every period and twin?

For each control period, twin and push: what was inserted, how far anything went over a
joint or wall limit, and how hard the contacts were, in N tries of the policy with a
tare, seeded and spread over the three hole poses as `dovetail evaluate` does it. The
tare's own way counts, too.

    python benchmarks/period_table.py --tries 60 --workers 2

A single cell: `--period 1ms --twin hard --push 30`. `none` is MuJoCo alone, and
`stiff` the same with contacts of 2 ms at every period; `--margins model` takes those of
an arm that is exactly as its model. Below 0 is inside. Rows are printed as they come;
`--json FILE` keeps every try. `heavy` is `medium` with links 10 to 30 % heavier. What
the last line ends where nothing else helps:

    --limit passive=0 --limit estimate_rate=300 --limit posture_stiffness=0

and, to see what it ended, `--limit last_line=0` beside them.
"""

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import groupby, product
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from attacks.contact_trial import having
from encoder_plant import EncoderPlant

from dovetail.arms.local_arm import LocalArm
from dovetail.control.config import LimitConfig
from dovetail.errors import ArmError, ConfigError, PlantError
from dovetail.evaluation.job import TrialJob
from dovetail.evaluation.perturbation import Perturbation, make_perturbed
from dovetail.evaluation.transfer import wilson_interval
from dovetail.evaluation.trials import plan_trials
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import known_env_id, policy_settings
from dovetail.plants.plant import COLUMN, FLAG_MASK, DynamicsConfig
from dovetail.plants.twin import Twin, list_twins, load_twin
from dovetail.tasks.peg_in_hole.task import PegInHole

PERIODS = (1.0, 2.0, 2.5, 5.0)
"""Control periods [ms]."""
IDEAL = {
    "none": None,
    "stiff": DynamicsConfig(contact_time=2e-3),
}
"""Grounds without a twin: MuJoCo as it is, and with contacts as stiff as at 1 ms."""
HEAVY = {
    "mass_scale": [1.1, 1.2, 1.3, 1.15, 1.25, 1.3, 1.2],
    "gravity_residual": [-0.2, 0.3, -0.4],  # m/s2
}
"""In what the twin `heavy` differs from `medium`."""
COUNTED = ("bad_input", "unsafe", "implausible", "ended")
"""Flags whose cycles are counted."""

_Q = slice(COLUMN["q1"], COLUMN["q7"] + 1)
_DQ = slice(COLUMN["dq1"], COLUMN["dq7"] + 1)
_XYZ = slice(COLUMN["x"], COLUMN["z"] + 1)
_FORCE = slice(COLUMN["fx"], COLUMN["fz"] + 1)


class Cell(NamedTuple):
    """Where and how a number of tries is made."""

    twin: str
    period: float
    """Control period [ms]."""
    push: float
    """Largest push [N]."""
    margins: str
    """Of the limits: "hardware", as an arm is built, or "model"."""
    encoders: bool
    """Whether velocities come from positions, as behind FRI."""
    policy: str
    others: tuple[tuple[str, float], ...] = ()
    """Other numbers in LimitConfig or OscConfig, for experiments."""


class Try(NamedTuple):
    """What one try gave."""

    success: bool
    cycles: int
    """Control cycles, the tare's included."""
    outside: int
    """Of them outside a joint or wall limit, by the measured state."""
    speed: float
    """Largest joint speed over its limit [1]."""
    joint: float
    """Furthest that a joint was past a position limit [rad]; below 0 inside."""
    wall: float
    """Furthest that the TCP was through a wall [m]; below 0 inside."""
    peak: float
    """Largest contact force [N]."""
    flags: dict[str, int]
    """Cycles with each of COUNTED."""
    stopped: str
    """Why it ended before its time; empty where it did not."""


def find_twin(name: str) -> Twin:
    """Return a shipped twin, or `heavy`."""
    return replace(load_twin("medium"), **HEAVY) if name == "heavy" else load_twin(name)


@cache
def prepare(cell: Cell) -> tuple[Policy, gym.Env]:
    """Build a cell's environment and load its policy."""
    policy = Policy.load(find_policy(cell.policy))
    options = policy_settings(policy.metadata)
    options |= {"tare": True, "period": 1e-3 * cell.period}
    if cell.twin in IDEAL:
        options |= {"plant": "mujoco", "dynamics": IDEAL[cell.twin]}
    else:
        options["twin"] = find_twin(cell.twin)
    perturbation = Perturbation(push=cell.push)
    env = make_perturbed(known_env_id(policy.metadata), perturbation, options)
    if cell.margins == "model" or cell.encoders or cell.others:
        _rebuild(env.unwrapped, cell)
    return policy, env


def _rebuild(env: Any, cell: Cell) -> None:
    """Give an environment's arm other margins or encoders; the judge keeps its own."""
    old, facts = env.arm, env.arm.facts
    limits = facts.limits
    if cell.margins == "model":
        limits = LimitConfig.for_period(
            facts.robot,
            facts.period,
            hardware=False,
            x_min=limits.x_min,
            x_max=limits.x_max,
            dx_max=limits.dx_max,
            near_speed=limits.near_speed,
            near_press=limits.near_press,
        )
    osc, limits = having(facts.osc, limits, cell.others)
    plant: Any = old.plant
    if cell.encoders:
        plant = EncoderPlant(plant, facts.period)
    arm = LocalArm(plant, facts.robot, osc, limits, facts.task, facts.period)
    env.arm = arm
    env._tare._arm = arm  # there is no option for this


def attempt(cell: Cell, job: TrialJob) -> Try:
    """Run one try from reset to success, time-out or the arm's stop."""
    policy, env = prepare(cell)
    core: Any = env.unwrapped
    logs, success, stopped = [], False, ""
    try:
        hole = PegInHole.trial_poses[job.pose].pose()
        observation, _ = env.reset(seed=job.seed, options={"fixture": hole})
        policy.reset()
        logs.append(core.state.log)
        done = False
        while not done:
            observation, _, ended, cut, info = env.step(policy(observation))
            logs.append(core.state.log)
            done, success = ended or cut, info["success"]
    except ArmError as error:
        stopped = error.reason or "arm"
        if error.state is not None:
            logs.append(error.state.log)  # type: ignore[attr-defined]
    except PlantError:
        stopped = "diverged"
    except ConfigError as error:
        stopped = f"refused ({str(error).partition(';')[0]})"
    log = np.vstack([np.empty((0, len(COLUMN))), *logs])
    return judge(log, core, success=success, stopped=stopped)


def judge(log: np.ndarray, core: Any, *, success: bool, stopped: str) -> Try:
    """Return a try's numbers from the log of all its cycles."""
    limits, (low, high) = core.arm.facts.robot.limits, core.cell.walls
    q, x = log[:, _Q], log[:, _XYZ]
    flags = log[:, COLUMN["flags"]].astype(np.int64)
    return Try(
        success=success and not stopped,
        cycles=len(log),
        outside=core.violations.count(np.ascontiguousarray(log)),
        speed=float(np.max(np.abs(log[:, _DQ]) / limits.dq_max, initial=0.0)),
        joint=float(
            np.max(np.maximum(q - limits.q_max, limits.q_min - q), initial=-9.0)
        ),
        wall=float(np.max(np.maximum(x - high, low - x), initial=-9.0)),
        peak=float(np.max(np.linalg.norm(log[:, _FORCE], axis=1), initial=0.0)),
        flags={
            name: int(np.count_nonzero(flags & FLAG_MASK[name])) for name in COUNTED
        },
        stopped=stopped,
    )


def run(cells: list[Cell], tries: int, workers: int) -> Iterator[tuple[Cell, Try]]:
    """Make the tries of each cell, in order; seeds are the same in each.

    Tries are spread evenly over the hole poses; what is left over goes to the first.
    """
    jobs = plan_trials(
        len(PegInHole.trial_poses), -(-tries // len(PegInHole.trial_poses)), 0
    )
    jobs = sorted(jobs, key=lambda job: job.attempt)[:tries]
    work = list(product(cells, jobs))
    if workers == 1:
        yield from ((cell, attempt(cell, job)) for cell, job in work)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        done = pool.map(attempt, *zip(*work, strict=True))
        yield from zip((cell for cell, _ in work), done, strict=True)


TITLES = (
    "twin",
    "period",
    "push",
    "inserted",
    "Wilson 95 %",
    "cycles outside",
    "of",
    "joint speed",
    "past joint limit",
    "through wall",
    "peak p95",
    "peak max",
    *(name.replace("_", " ") for name in COUNTED),
    "stopped",
)


def row(cell: Cell, tries: list[Try]) -> list[str]:
    """Return a cell's line of the table, in the order of TITLES."""
    successes = sum(t.success for t in tries)
    low, high = wilson_interval(successes, len(tries))
    peaks = [t.peak for t in tries]
    return [
        cell.twin,
        f"{cell.period:g} ms",
        f"{cell.push:g} N",
        f"{successes}/{len(tries)}",
        f"{100 * low:.0f}-{100 * high:.0f} %",
        str(sum(t.outside for t in tries)),
        str(sum(t.cycles for t in tries)),
        f"{max(t.speed for t in tries):.3f} x",
        f"{max(t.joint for t in tries):.4f} rad",
        f"{1e3 * max(t.wall for t in tries):.1f} mm",
        f"{np.percentile(peaks, 95):.1f} N",
        f"{max(peaks):.1f} N",
        *(str(sum(t.flags[name] for t in tries)) for name in COUNTED),
        ", ".join(sorted({t.stopped for t in tries} - {""})) or "-",
    ]


def setting(text: str) -> tuple[str, float]:
    """Return name and number of `NAME=NUMBER`."""
    name, _, number = text.partition("=")
    return name, float(number)


def main() -> None:
    """Make every cell's tries and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    known = (*IDEAL, "heavy", *list_twins())
    parser.add_argument("--policy", default="peg_square")
    parser.add_argument(
        "--period",
        type=lambda text: float(text.removesuffix("ms")),
        nargs="+",
        choices=PERIODS,
        default=PERIODS,
        help="[ms]: 1ms, 2.5ms",
    )
    default = ["none", "easy", "medium", "hard"]
    parser.add_argument("--twin", nargs="+", choices=known, default=default)
    parser.add_argument("--push", type=float, nargs="+", default=[0, 30], help="[N]")
    parser.add_argument("--margins", choices=("hardware", "model"), default="hardware")
    parser.add_argument(
        "--encoders", action="store_true", help="no measured velocity, as behind FRI"
    )
    parser.add_argument(
        "--limit", action="append", default=[], metavar="NAME=NUMBER", type=setting
    )
    parser.add_argument("--tries", type=int, default=60, help="of each cell")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file for every try")
    given = parser.parse_args()
    changed = tuple(given.limit)
    cells = [
        Cell(twin, period, push, given.margins, given.encoders, given.policy, changed)
        for push, twin, period in product(given.push, given.twin, given.period)
    ]
    print("| " + " | ".join(TITLES) + " |\n|" + "---|" * len(TITLES), flush=True)
    kept = []
    results = run(cells, given.tries, given.workers)
    for cell, pairs in groupby(results, key=lambda pair: pair[0]):
        tries = [t for _, t in pairs]
        print("| " + " | ".join(row(cell, tries)) + " |", flush=True)
        kept += [cell._asdict() | t._asdict() for t in tries]
    if given.json is not None:
        given.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
