"""CMA-ES over what the adversary in contact may choose: the worst margin is its aim.

A round draws tries at random, takes the worst, and moves in its continuous choices; its
kinds (task, policy, ...) stay. The next round begins with other draws. What was
evaluated is written to a file, line by line: a search that is started again with the
same file and settings reads its values there until they end, and goes on.

The margin of a try is the largest of: joint position past the limit over 0.05 rad, plus
1; joint speed over its limit; contact force over 5 resting pushes; sustained vibration
over 0.3 rad/s; 1 plus a growing one. Above 1 something is broken.
"""

import json
import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from cmaes import CMA

from .contact_attack import Attack, add_case, broken, plain
from .contact_choices import NUM_KINDS, RANGES, SIZE, Array, choose
from .contact_growth import SUSTAINED

DRAWS = 40  # of a round
GENERATIONS = 12  # of a round
SIGMA = 0.15
EDGE = 0.02
AIMS = ("any", "position", "speed", "contact", "vibration")


def margins(worst: dict[str, float]) -> dict[str, float]:
    """Return each margin of a try; 1 is the limit."""
    return {
        "position": 1.0 + worst["position"] / 0.05,
        "speed": worst["speed"],
        "contact": max(0.0, worst["contact"] / 5.0),
        "vibration": max(
            worst["sustained"] / SUSTAINED,
            1.0 + worst["grown"] if worst["grown"] > 0.0 else 0.0,
        ),
    }


def badness(worst: dict[str, float], aim: str) -> float:
    """Return the largest margin, or the one that is aimed at."""
    every = margins(worst)
    return max(every.values()) if aim == "any" else every[aim]


@dataclass
class Found:
    """A try that was evaluated."""

    value: float
    vector: Array
    seed: tuple[int, ...]
    worst: dict[str, float]


@dataclass
class Search:
    """One search; `run` yields each round's worst."""

    attack: Attack
    aim: str
    file: Path
    workers: int = 1
    evaluations: int = 0
    _known: list[dict[str, Any]] = field(default_factory=list)

    def run(self, evaluations: int) -> Iterator[Found]:
        """Search until so many tries were evaluated, those in the file included."""
        if self.file.exists():
            lines = self.file.read_text().splitlines()
            self._known = [json.loads(line) for line in lines]
        with ProcessPoolExecutor(self.workers) as pool:
            number = 0
            while self.evaluations < evaluations:
                yield self._round(pool, number)
                number += 1

    def _round(self, pool: ProcessPoolExecutor, number: int) -> Found:
        first = number * DRAWS
        indices = range(first, first + DRAWS)
        drawn = [self.attack.vector(index) for index in indices]
        seeds = [(self.attack.seed, index, 1) for index in indices]
        best = max(self._evaluate(pool, drawn, seeds), key=lambda found: found.value)
        size = SIZE - NUM_KINDS
        optimiser = CMA(
            mean=np.clip(best.vector[NUM_KINDS:], EDGE, 1.0 - EDGE),
            sigma=SIGMA,
            bounds=np.tile([0.0, 1.0], (size, 1)),
            seed=number,
            population_size=4 + 3 * math.ceil(math.log(size)),
        )
        for _ in range(GENERATIONS):
            asked = [optimiser.ask() for _ in range(optimiser.population_size)]
            kinds = best.vector[:NUM_KINDS]
            vectors = [np.concatenate([kinds, x]) for x in asked]
            found = self._evaluate(pool, vectors, [best.seed] * len(vectors))
            optimiser.tell([(x, -f.value) for x, f in zip(asked, found, strict=True)])
            best = max([best, *found], key=lambda one: one.value)
        return best

    def _evaluate(
        self, pool: ProcessPoolExecutor, vectors: list[Array], seeds: list[Any]
    ) -> list[Found]:
        """Return the tries' values, from the file as far as it goes."""
        stored = self._known[self.evaluations : self.evaluations + len(vectors)]
        tasks = [
            (self.attack, vector, seed)
            for vector, seed in zip(vectors, seeds, strict=True)
        ]
        worsts = [line["worst"] for line in stored]
        fresh = list(pool.map(run_vector, tasks[len(stored) :], chunksize=2))
        with self.file.open("a") as out:
            for worst in fresh:
                out.write(json.dumps({"worst": worst}) + "\n")
        self.evaluations += len(vectors)
        return [
            Found(badness(worst, self.aim), vector, tuple(seed), worst)
            for (_, vector, seed), worst in zip(tasks, worsts + fresh, strict=True)
        ]


def run_vector(task: tuple[Attack, Array, tuple[int, ...]]) -> dict[str, float]:
    """Run a try in a worker; return its worst."""
    attack, vector, seed = task
    return plain(attack.run_vector(vector, seed))["worst"]


def search(
    attack: Attack,
    aim: str,
    evaluations: int,
    file: Path,
    workers: int,
    cases: Path | None,
) -> None:
    """Run a search, print each round's worst and keep those that break a promise."""
    print(f"{attack}, aim {aim}, {file}")
    worst = -math.inf
    for number, found in enumerate(
        (run := Search(attack, aim, file, workers)).run(evaluations)
    ):
        choices = choose(found.vector, RANGES[attack.span])
        worst = max(worst, found.value)
        each = ", ".join(f"{k} {v:.3g}" for k, v in margins(found.worst).items())
        print(
            f"round {number}, {run.evaluations} tries: {found.value:.3f} ({each}), "
            f"{choices.task} {choices.policy}, worst so far {worst:.3f}",
            flush=True,
        )
        exceeded = broken(found.worst, attack.span)
        if cases is not None and exceeded:
            name = f"{choices.task}-{choices.policy}-{1e3 * attack.period:g}ms"
            name += f"-{attack.span}-{'-'.join(exceeded)}-{attack.seed}-{number}"
            add_case(
                cases,
                attack,
                {
                    "name": name,
                    "cause": "search",
                    "seed": list(found.seed),
                    "worst": found.worst,
                    "vector": found.vector.tolist(),
                },
            )
            print(json.dumps(choices.plain()))
