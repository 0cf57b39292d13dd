"""An evolved attack: CMA-ES over everything an adversary can choose in two seconds.

    python benchmarks/evolved_attack.py                        walls, true states
    python benchmarks/evolved_attack.py --states bad --objective position
    python benchmarks/evolved_attack.py --replay results/attacks/FILE.json --rows 20

The exact rigid arm, no contact, no delay. What is evolved: f* and theta of 40 actions
at 20 Hz, the configuration at the start, and with `--states stale` which 2 % of the
messages arrive late, repeated or not at all; with `--states bad` some have wrong
numbers, too, in any field, from 1e-5 to 1e3 rad, NaN and infinity; `received` is `bad`
without lost messages: where none arrives nothing can be done. What is sought is
the largest excess of one kind over the true limits, margins not taken off. The worst
episode of every search is written to a file and can be run again, also against another
controller. A search whose file is there, of the same options and the same build, is not
run again. With OPENBLAS_NUM_THREADS=1 in the environment the workers do not wait for
one another's linear algebra.
"""

import argparse
import hashlib
import json
import math
import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from attacks.episode import (
    COLUMNS,
    LOST,
    Array,
    Attacked,
    Episode,
    Settings,
    Wrong,
    load_episode,
    save_episode,
)

from dovetail import _bench

SECONDS = 2.0
ACTIONS = 40
GENES = 7 + 4 * ACTIONS
START_SPREAD = 0.3  # rad of the start per unit of its gene
BAD_SHARE = 0.02  # of all messages
EVENT_GENES = 5
SMALLEST, LARGEST = 1e-5, 1e3  # rad, rad/s: sizes of wrong numbers
LONGEST = 5  # cycles that a state is late, repeated or lost
RANDOM_SHARE = 0.3  # of a search's episodes, before it evolves the best of them
REACH = 0.5  # weight of `reach` beside the excess over a wall

KINDS = {"stale": range(3), "bad": range(8), "received": (0, 1, 3, 4, 5, 6, 7)}
"""Of events: late, repeated, lost, and five ways in which numbers are wrong."""

OBJECTIVES = {
    "wall": ("wall", 1e3, "mm"),
    "position": ("position", 1e3, "mrad"),
    "speed": ("speed", 1.0, "rad/s"),
    "torque-step": ("step_by_bad", 1.0, "Nm"),
}
"""Name, result of `_bench.run_attack`, factor and unit."""


@dataclass(frozen=True)
class Search:
    """One search of a given number of cycles, the same whatever ran before."""

    settings: Settings
    objective: str
    states: str
    cycles: int
    seed: int
    index: int
    folder: Path

    @property
    def path(self) -> Path:
        """Where its worst episode goes."""
        name = f"{self.objective}-{self.states}-{self.settings.period:g}"
        margins = "-hardware" if self.settings.hardware else ""
        observed = "-observed" if self.settings.observed else ""
        f_star = f"{self.settings.f_star:g}"
        return self.folder / f"{name}-{f_star}{margins}{observed}-{self.index}.json"

    @property
    def identity(self) -> dict[str, Any]:
        """What its result depends on, the build included."""
        own = {name: value for name, value in vars(self).items() if name != "folder"}
        return own | {"settings": asdict(self.settings), "build": build()}


@lru_cache(maxsize=1)
def build() -> str:
    """Return what tells one build of the control core from another."""
    return hashlib.sha256(Path(str(_bench.__file__)).read_bytes()).hexdigest()[:12]


def bad_states(
    genes: Array, cycles: int, kinds: Sequence[int]
) -> tuple[list[int], list[Wrong]]:
    """Decode events: when, of which kind, where, how large, how long."""
    age, wrong = [0] * cycles, []
    left = round(BAD_SHARE * cycles)
    for when, kind, element, size, length in genes.reshape(-1, EVENT_GENES):
        share = _fold(np.array([when, kind, element, size, length]))
        first = 1 + int(share[0] * (cycles - 2))  # the very first is the start's own
        last = min(first + 1 + int(share[4] * LONGEST), cycles, first + left)
        if last <= first or any(age[first:last]):
            continue
        left -= last - first
        what = kinds[min(int(share[1] * len(kinds)), len(kinds) - 1)]
        for k in range(first, last):
            if what == 0:  # late by up to LONGEST cycles, one after the other
                age[k] = min(k, last - first)
            elif what == 1:  # repeated
                age[k] = min(k, k - first + 1)
            elif what == 2:
                age[k] = LOST
        if what > 2:
            wrong += _wrong_numbers(range(first, last), what, share[2], share[3])
    return age, sorted(wrong, key=lambda number: number[0])


def _wrong_numbers(
    cycles: range, what: int, element: float, size: float
) -> list[Wrong]:
    """One joint's q or dq, or all of them, wrong by one number in each cycle."""
    sign = 1.0 if size > 0.5 else -1.0
    reach = 2.0 * abs(size - 0.5)
    error = sign * SMALLEST * (LARGEST / SMALLEST) ** min(reach / 0.96, 1.0)
    if reach > 0.98:
        error = math.nan if sign > 0 else math.inf
    joint = min(int(element * 7), 6)
    elements = {3: [joint], 4: [7 + joint], 5: range(7), 6: range(7, 14)}
    chosen = elements.get(what, [joint, 7 + joint])
    return [(k, i, error) for k in cycles for i in chosen]


def _fold(x: Array) -> Array:
    """Map any number onto 0 to 1 without an edge where a search would stick."""
    return 1.0 - np.abs(1.0 - np.mod(0.5 + 0.5 * x, 2.0))


def decode(search: Search, centre: Array, genes: Array) -> Episode:
    """Make an episode of a point of the search."""
    settings = search.settings
    cycles = round(SECONDS / settings.period)
    f_star = settings.f_star * np.clip(genes[7 : 7 + 3 * ACTIONS], -1.0, 1.0)
    age, wrong = [0] * cycles, []
    if search.states != "true":
        age, wrong = bad_states(genes[GENES:], cycles, KINDS[search.states])
    return Episode(
        q=centre + START_SPREAD * genes[:7],
        f_star=f_star.reshape(ACTIONS, 3),
        theta=np.pi * genes[7 + 3 * ACTIONS : GENES],
        age=age,
        wrong=wrong,
    )


def first_guess(attacked: Attacked, centre: Array, rng: np.random.Generator) -> Array:
    """Return random genes: bang-bang, held, or driving a joint to its nearer limit."""
    genes = np.zeros(GENES)
    kind, hold = rng.integers(3), rng.choice([1, 5, 20, 40])
    signs = np.zeros(3)
    for k in range(ACTIONS):
        if k % hold == 0:
            signs = rng.choice([-1.0, 1.0], 3)
            if kind == 2:
                joint = rng.integers(7)
                column = attacked.chain.jacobian(centre)[:3, joint]
                signs = np.sign(column) * rng.choice([-1.0, 1.0])
            if kind == 1:
                signs *= rng.uniform(0.0, 1.0, 3)
        genes[7 + 3 * k : 10 + 3 * k] = signs
    genes[7 + 3 * ACTIONS :] = (
        rng.uniform(-1.0, 1.0) if kind else rng.uniform(-1.0, 1.0, ACTIONS)
    )
    return genes


def run_search(search: Search) -> tuple[float, dict, int]:
    """Run one search: value [in its unit], what the worst episode reached, cycles."""
    if search.path.exists():
        try:
            _, _, worst = load_episode(search.path)
        except (ValueError, KeyError, TypeError):  # JSONDecodeError is a ValueError
            worst = {}
        if worst.get("search") == search.identity:
            return value_of(search, worst), worst, worst["cycles_run"]
        print(f"{search.path} is of other options or another build: run again")
    from cmaes import CMA, SepCMA

    rng = np.random.default_rng([search.seed, search.index])
    attacked = Attacked(search.settings)
    per_episode = round(SECONDS / search.settings.period)
    budget = max(1, search.cycles // per_episode)
    events = round(BAD_SHARE * per_episode) if search.states != "true" else 0
    best, run = (-math.inf, {}, None), 0
    guess = (-math.inf, np.zeros(7), np.zeros(GENES + EVENT_GENES * events))

    def cost(centre: Array, genes: Array) -> float:
        nonlocal best, run
        episode = decode(search, centre, genes)
        while attacked.room(episode.q) < 0.0:  # back towards a start that is one
            episode.q = 0.5 * (episode.q + centre)
        run += 1
        worst, _ = attacked.run(episode)
        value = value_of(search, worst)
        if value > best[0]:
            best = value, worst, episode
        # Where the walls hold there is no slope: how late they are met gives one.
        slope = REACH * 1e3 * worst["reach"][0] if search.objective == "wall" else 0.0
        return -value - slope

    while run < RANDOM_SHARE * budget:
        centre = attacked.start(rng)
        genes = np.concatenate(
            [first_guess(attacked, centre, rng), rng.normal(0, 1, EVENT_GENES * events)]
        )
        value = -cost(centre, genes)
        if value > guess[0]:
            guess = value, centre, genes
    kind = SepCMA if events else CMA
    optimizer = kind(
        mean=guess[2], sigma=0.3, seed=int(rng.integers(2**31)), population_size=20
    )
    while run < budget:
        points = [optimizer.ask() for _ in range(optimizer.population_size)]
        optimizer.tell([(x, cost(guess[1], x)) for x in points])
    assert best[2] is not None
    worst = best[1] | {"cycles_run": run * per_episode, "search": search.identity}
    save_episode(search.path, search.settings, best[2], worst)
    return best[0], worst, run * per_episode


def value_of(search: Search, worst: dict) -> float:
    """Return the objective in its unit."""
    name, factor, _ = OBJECTIVES[search.objective]
    return factor * worst[name][0]


def excesses(worst: dict) -> dict[str, tuple]:
    """Return what has a value, a cycle and an element."""
    return {n: tuple(v) for n, v in worst.items() if isinstance(v, tuple | list)}


def replay(path: Path, rows: int) -> None:
    """Run a saved episode with today's controller and print its worst moments."""
    settings, episode, before = load_episode(path)
    worst, trace = Attacked(settings).run(episode, trace=True)
    print(settings)
    print(f"{'':16s} {'then':>12s} {'now':>12s}  cycle  element")
    for name, (value, cycle, element) in excesses(worst).items():
        then = before[name][0]
        print(f"{name:16s} {then:12.5g} {value:12.5g}  {cycle:5d}  {element}")
    if not rows:
        return
    centre = worst["wall"][1]
    print("cycle", *COLUMNS)
    for k in range(max(0, centre - rows), min(len(trace), centre + rows // 4 + 1)):
        print(k, *(f"{x:.4g}" for x in trace[k, :-1]), f"{int(trace[k, -1]):#x}")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument(
        "--periods", type=float, nargs="+", default=[1e-3, 2e-3, 2.5e-3, 5e-3]
    )
    parser.add_argument("--cycles", type=int, default=2_000_000, help="per period")
    parser.add_argument("--searches", type=int, default=2, help="per period")
    parser.add_argument("--objective", choices=OBJECTIVES, default="wall")
    parser.add_argument("--states", choices=("true", *KINDS), default="true")
    parser.add_argument("--f-star", type=float, default=30.0, help="[m/s2]")
    parser.add_argument("--task", default="XYZ:force A:pose BC:hold")
    parser.add_argument("--force-damping", type=float, default=0.0, help="[1/s]")
    parser.add_argument("--hardware", action="store_true")
    parser.add_argument("--observed", action="store_true", help="dq from positions")
    parser.add_argument("--limit", action="append", default=[], help="field=value")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("results/attacks"))
    parser.add_argument("--replay", type=Path)
    parser.add_argument("--rows", type=int, default=0, help="of a replay's trace")
    args = parser.parse_args()
    if args.searches < 1:
        parser.error(f"--searches {args.searches}: allowed is 1 or more")
    if args.replay and not args.replay.is_file():
        parser.error(
            f"--replay {args.replay}: there is no such file; a search writes one"
        )
    if args.replay:
        replay(args.replay, args.rows)
        return
    begin = time.perf_counter()
    searches = searches_of(args)
    with multiprocessing.Pool(args.workers) as pool:
        found = pool.map(run_search, searches, chunksize=1)
    for period in args.periods:
        rows = [
            (value, search, worst, cycles)
            for search, (value, worst, cycles) in zip(searches, found, strict=True)
            if search.settings.period == period
        ]
        print_worst(period, rows)
    print(f"{time.perf_counter() - begin:.0f} s")


def searches_of(args: argparse.Namespace) -> list[Search]:
    """Return the searches that the command line asks for."""
    limits = {name: float(v) for name, v in (x.split("=") for x in args.limit)}
    return [
        Search(
            Settings(
                period=period,
                f_star=args.f_star,
                task=args.task,
                force_damping=args.force_damping,
                hardware=args.hardware,
                observed=args.observed,
                limits=limits,
            ),
            args.objective,
            args.states,
            args.cycles // args.searches,
            args.seed,
            index,
            args.folder,
        )
        for period in args.periods
        for index in range(args.searches)
    ]


def print_worst(period: float, rows: list[tuple[float, Search, dict, int]]) -> None:
    """Print the worst of one period's searches."""
    value, search, worst, _ = max(rows, key=lambda row: row[0])
    cycles = sum(row[3] for row in rows)
    unit = OBJECTIVES[search.objective][2]
    print(f"{period:g} s: worst {value:.3f} {unit} in {cycles} cycles: {search.path}")
    others = {name: float(f"{v[0]:.4g}") for name, v in excesses(worst).items()}
    print("   ", json.dumps(others))


if __name__ == "__main__":
    main()
