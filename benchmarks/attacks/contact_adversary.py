"""Random tries of the adversary in contact, their worst, and the replay of one.

``python benchmarks/adversary.py --contact --range proven --period 0.001`` runs them. A
try is determined by seed and index; `contact_choices` says what it chooses,
`contact_trial` how it is judged.
"""

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.robots.find import DEFAULT_ROBOT

from .contact_attack import Attack, add_case, broken, is_excused, plain
from .contact_choices import POLICIES, RANGES, TASKS
from .contact_growth import SUSTAINED
from .contact_trial import Outcome

LISTED = 5
METRICS: dict[str, tuple[str, float, str]] = {
    "position": ("joint position past its limit", 0.0, "rad"),
    "speed": ("joint speed over its limit", 1.0, "1"),
    "torque": ("motor torque over its limit", 1.0, "1"),
    "taper": ("speed that falls towards a limit", 0.0, "rad/s"),
    "rate": ("change of torque over its limit", 1.0 + 1e-9, "1"),
    "wall": ("TCP outside a wall", 0.0, "m"),
    "tcp_speed": ("TCP speed over its limit, per axis", 0.0, "m/s"),
    "contact": ("contact force over the resting push", 5.0, "1"),
    "load": ("spring's torque over the motor's", 1.0, "1"),
    "grown": ("growing oscillation, RMS above 8 Hz", 0.0, "rad/s"),
    "sustained": ("sustained oscillation, the same", SUSTAINED, "rad/s"),
}
"""What each worst value is, above which number it counts, and its unit."""


@dataclass
class Tally:
    """Totals of all tries, and the worst of each metric."""

    span: str
    tries: int = 0
    cycles: int = 0
    failed: dict[str, int] = field(default_factory=lambda: dict.fromkeys(METRICS, 0))
    counts: dict[str, int] = field(default_factory=dict)
    worst: dict[str, list[tuple[float, int]]] = field(
        default_factory=lambda: {name: [] for name in METRICS}
    )
    broken: list[int] = field(default_factory=list)
    overpowered: list[int] = field(default_factory=list)
    """Broken, too, by a spring that is stronger than a motor."""
    peaks: list[float] = field(default_factory=list)

    def add(self, index: int, outcome: dict[str, Any]) -> None:
        """Count one try."""
        self.tries += 1
        self.cycles += outcome["cycles"]
        self.peaks.append(outcome["worst"]["peak"])
        for name, number in outcome["counts"].items():
            self.counts[name] = self.counts.get(name, 0) + number
        for name, (_, limit, _) in METRICS.items():
            value = outcome["worst"][name]
            self.failed[name] += value > limit
            self.worst[name] = sorted([*self.worst[name], (value, index)])[-LISTED:]
        if broken(outcome["worst"], self.span):
            is_overpowered = is_excused(outcome["worst"])
            (self.overpowered if is_overpowered else self.broken).append(index)


def run_index(task: tuple[Attack, int]) -> tuple[int, dict[str, Any]]:
    """Run one try in a worker; return what JSON can hold."""
    attack, index = task
    return index, plain(attack.run(index))


def outcomes(attack: Attack, cycles: int, workers: int) -> Iterator[Any]:
    """Yield index and outcome of tries until these cycles were run."""
    done = 0
    indices = count()
    if workers < 2:
        while done < cycles:
            result = run_index((attack, next(indices)))
            done += result[1]["cycles"]
            yield result
        return
    with ProcessPoolExecutor(workers) as pool:
        while done < cycles:
            batch = [(attack, next(indices)) for _ in range(8 * workers)]
            for result in pool.map(run_index, batch):
                done += result[1]["cycles"]
                yield result


def line_of(attack: Attack, index: int, outcome: dict[str, Any]) -> str:
    """Return a try as one line of JSON."""
    short = {k: float(f"{v:.4g}") for k, v in outcome["worst"].items()}
    content = {
        "index": index,
        "seed": attack.seed,
        "period": attack.period,
        "range": attack.span,
        "worst": short,
        "when": {k: [round(t, 4), axis] for k, (t, axis) in outcome["when"].items()},
        "counts": {k: v for k, v in outcome["counts"].items() if v},
        "choices": attack.choices(index).plain(),
    }
    return json.dumps(content)


def print_tally(attack: Attack, tally: Tally, seconds: float) -> None:
    """Print totals, and the worst tries of each metric by index."""
    print(attack)
    rate = tally.cycles / seconds
    print(
        f"{tally.tries} tries, {tally.cycles} cycles, {seconds:.0f} s, {rate:.0f} "
        "cycles/s"
    )
    print(f"{'metric':38s} {'tries':>6s} {'share':>7s}  worst (index)")
    for name, (title, _, unit) in METRICS.items():
        worst = ", ".join(
            f"{value:.3g} ({index})" for value, index in reversed(tally.worst[name])
        )
        failed = tally.failed[name]
        print(f"{title:38s} {failed:6d} {failed / tally.tries:7.1%}  {worst} {unit}")
    p50, p95, p100 = np.percentile(tally.peaks, [50, 95, 100])
    print(f"contact peak, impacts too: p50 {p50:.0f}, p95 {p95:.0f}, max {p100:.0f} N")
    print("tries or looks: " + ", ".join(f"{k} {v}" for k, v in tally.counts.items()))
    print(
        f"tries that break what range {attack.span} promises: {len(tally.broken)}",
        end=" ",
    )
    print(tally.broken[:20])
    print(f"by a spring that is stronger than a motor: {tally.overpowered[:20]}")


def print_causes(attack: Attack, tally: Tally) -> None:
    """Print the share of broken tries by kind, and what they have in common."""
    if not tally.broken:
        return
    every = [attack.choices(i) for i in range(tally.tries)]
    is_broken = np.zeros(tally.tries, dtype=bool)
    is_broken[tally.broken] = True
    for name in ("task", "policy", "near", "inertia", "is_random_start", "is_tared"):
        values = np.array([str(getattr(c, name)) for c in every])
        shares = ", ".join(
            f"{v} {is_broken[values == v].mean():.0%} of {(values == v).sum()}"
            for v in sorted(set(values))
        )
        print(f"broken by {name}: {shares}")
    rows = []
    for name in every[0].__dataclass_fields__:
        values = np.array(
            [
                np.abs(getattr(c, name)).mean()
                for c in every
                if not isinstance(getattr(c, name), (str, bool))
            ]
        )
        if len(values) == len(every) and values.std() > 0.0:
            rows.append((float(np.corrcoef(values, is_broken)[0, 1]), name))
    rows.sort(key=lambda row: -abs(row[0]))
    print("correlation with broken: ", end="")
    print(", ".join(f"{name} {r:+.2f}" for r, name in rows[:8]))


def replay(attack: Attack, index: int, folder: Path | None) -> Outcome:
    """Run one try alone; print it, and write its trace as CSV if asked to."""
    from dovetail.plants.plant import COLUMN, CYCLE_COLUMNS

    outcome = attack.run(index)
    print(line_of(attack, index, plain(outcome)))
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"try-{attack.seed}-{index}-{1e3 * attack.period:g}ms.csv"
        header = ",".join(CYCLE_COLUMNS)
        np.savetxt(path, outcome.trace, "%.9g", ",", header=header, comments="")
        print(path)
    print("\n".join(outcome.events))
    step = max(1, len(outcome.trace) // 50)
    print("  t [s]  max|dq| [rad/s]  max|tau| [Nm]  contact [N]  TCP [m]")
    dq, tau, tcp, force = (
        slice(COLUMN[first], COLUMN[last] + 1)
        for first, last in (("dq1", "dq7"), ("tau1", "tau7"), ("x", "z"), ("fx", "fz"))
    )
    for row in outcome.trace[::step]:
        p = ", ".join(f"{x:.3f}" for x in row[tcp])
        print(
            f"{row[0]:7.3f}  {np.abs(row[dq]).max():15.3f}  "
            f"{np.abs(row[tau]).max():13.1f}  {np.linalg.norm(row[force]):11.1f}  {p}"
        )
    return outcome


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog="adversary.py --contact", description="Attack the controller in contact."
    )
    parser.add_argument("--robot", default=DEFAULT_ROBOT, help="one by name")
    parser.add_argument("--cycles", type=int, default=1_000_000)
    parser.add_argument("--period", type=float, default=1e-3, help="[s]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--range", choices=tuple(RANGES), default="proven", dest="span")
    parser.add_argument(
        "--exact-margins",
        action="store_true",
        help="margins for an arm that is as its model, not the environments'",
    )
    parser.add_argument("--task", choices=TASKS)
    parser.add_argument("--policy", choices=POLICIES)
    parser.add_argument(
        "--limit",
        action="append",
        default=[],
        metavar="NAME=NUMBER",
        help="another number in LimitConfig or OscConfig, for experiments",
    )
    parser.add_argument(
        "--hold-on", type=float, default=0.0, help="[s] with the last Target, after 5 s"
    )
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--quiet", action="store_true", help="no line for each try")
    parser.add_argument("--replay", type=int, metavar="INDEX")
    parser.add_argument("--trace", type=Path, metavar="FOLDER", help="of the replay")
    parser.add_argument("--search", action="store_true", help="CMA-ES")
    parser.add_argument("--evaluations", type=int, default=1000)
    parser.add_argument("--aim", default="any", help="what the search makes worst")
    parser.add_argument("--file", type=Path, help="of the search, to go on with")
    parser.add_argument("--cases", type=Path, help="keeps what is found or replayed")
    parser.add_argument("--cause", default="unknown", help="of what is kept")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str]) -> None:
    """Run the command line, --contact taken off."""
    args = parse(arguments)
    pairs = (text.split("=") for text in args.limit)
    attack = Attack(
        period=args.period,
        span=args.span,
        seed=args.seed,
        is_hardware=not args.exact_margins,
        task=args.task,
        policy=args.policy,
        overrides=tuple((name, float(number)) for name, number in pairs),
        hold_on=args.hold_on,
        robot=args.robot,
    )
    if args.replay is not None:
        outcome = replay(attack, args.replay, args.trace)
        if args.cases is not None:
            case = {
                "name": f"{args.cause}-{args.replay}-{1e3 * args.period:g}ms",
                "cause": args.cause,
                "seed": [args.seed, args.replay, 1],
                "worst": outcome.worst,
                "vector": attack.vector(args.replay),
            }
            add_case(args.cases, attack, case)
        return
    if args.search:
        from .contact_search import search

        name = f"contact-search-{args.span}-{1e3 * args.period:g}ms-{args.seed}.jsonl"
        file = args.file or Path(name)
        search(attack, args.aim, args.evaluations, file, args.workers, args.cases)
        return
    tally = Tally(args.span)
    begin = time.perf_counter()
    for index, outcome in outcomes(attack, args.cycles, args.workers):
        tally.add(index, outcome)
        if not args.quiet:
            print(line_of(attack, index, outcome), flush=True)
    print_tally(attack, tally, time.perf_counter() - begin)
    print_causes(attack, tally)
