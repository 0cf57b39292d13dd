"""How fast a batch of environments is, against one environment in the same run.

One environment and the batch take turns, so that other work on the machine disturbs
both alike. Prints

* environment steps per second of one environment (`gym.make`) on one core, and of the
  batch (`gym.make_vec` with its vector entry point) on ``--cores`` cores, resets
  included: medians over the turns, and the median of the ratios of neighbours (turns
  of some tenths of a second: the first steps of a turn find sleeping threads);
* where the processor time of a step goes: C++ (the control cycles, which the threads
  share) and Python (which only one of them can run), for one environment and for the
  batch;
* the ratio that these times allow, if no thread ever waited. The batch's time includes
  what its threads wait awake, so that on a busy machine it is too long.

    python benchmarks/batch.py
"""

import argparse
import os
import time
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from dovetail.envs.batch_vector_env import BatchVectorEnv

ENV = "dovetail/PegInHole-v0"


class Turn(NamedTuple):
    """Seconds of one turn, per environment step."""

    wall: float
    processor: float


def timed(run: Callable[[int], None], steps: int) -> Turn:
    """Time one turn of `steps` environment steps."""
    wall, processor = time.perf_counter(), time.process_time()
    run(steps)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return Turn(wall / steps, processor / steps)


class Single:
    """One environment under random actions."""

    def __init__(self, period: float) -> None:
        """Build it."""
        self.env = gym.make(ENV, period=period)
        self.env.reset(seed=0)
        self._rng = np.random.default_rng(0)

    def run(self, steps: int) -> None:
        """Step, and start anew where a try ends."""
        for action in self._rng.uniform(-1.0, 1.0, (steps, 4)).astype(np.float32):
            _, _, terminated, truncated, _ = self.env.step(action)
            if terminated or truncated:
                self.env.reset()


class Batch:
    """The same environment many times."""

    def __init__(self, period: float, envs: int, threads: int) -> None:
        """Build them."""
        vec = gym.make_vec(
            ENV,
            num_envs=envs,
            vectorization_mode="vector_entry_point",
            threads=threads,
            period=period,
        )
        assert isinstance(vec, BatchVectorEnv)
        self.vec, self._envs = vec, envs
        self._rng = np.random.default_rng(0)
        vec.reset(seed=0)
        length = vec.envs[0].unwrapped.max_steps  # type: ignore[attr-defined]
        for i in range(envs):  # tries end at different times, as they do in training
            self.run(length // envs * envs)
            vec.reset(options={"reset_mask": np.arange(envs) == i})

    def run(self, steps: int) -> None:
        """Step all environments, `steps` in sum."""
        shape = (steps // self._envs, self._envs, 4)
        for actions in self._rng.uniform(-1.0, 1.0, shape).astype(np.float32):
            self.vec.step(actions)


def cycles_time(single: Single, steps: int) -> float:
    """Return the processor time of one step's control cycles [s]."""
    plant: Any = single.env.unwrapped.arm.plant  # type: ignore[attr-defined]
    seconds, run = 0.0, plant.run_cycles

    def run_timed(*given: Any) -> Any:
        nonlocal seconds
        begin = time.process_time()
        out = run(*given)
        seconds += time.process_time() - begin
        return out

    plant.run_cycles = run_timed
    single.run(steps)
    del plant.run_cycles
    return seconds / steps


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--envs", type=int, default=16, help="environments in the batch"
    )
    parser.add_argument("--cores", type=int, default=2, help="cores, and threads")
    parser.add_argument(
        "--period", type=float, default=0.005, help="control period [s]"
    )
    parser.add_argument("--turns", type=int, default=25, help="turns of each")
    parser.add_argument("--steps", type=int, default=3200, help="steps of a turn")
    options = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0))[: options.cores]
    os.sched_setaffinity(0, cores)
    single = Single(options.period)
    batch = Batch(options.period, options.envs, len(cores))
    singles, batches = [], []
    for _ in range(options.turns):
        singles.append(timed(single.run, options.steps))
        batches.append(timed(batch.run, options.steps))
    one = median(turn.wall for turn in singles)
    many = median(turn.wall for turn in batches)
    ratios = sorted(a.wall / b.wall for a, b in zip(singles, batches, strict=True))
    print(
        f"period {1e3 * options.period:g} ms, {options.envs} environments, "
        f"{len(cores)} cores, load {os.getloadavg()[0]:.1f}\n"
        f"one environment: {1.0 / one:.0f} steps/s; batch: {1.0 / many:.0f} steps/s\n"
        f"ratio {median(ratios):.2f} (quartiles {ratios[len(ratios) // 4]:.2f}, "
        f"{ratios[3 * len(ratios) // 4]:.2f}); of the fastest turns "
        f"{min(s.wall for s in singles) / min(b.wall for b in batches):.2f}"
    )
    cycles = min(cycles_time(single, options.steps) for _ in range(options.turns))
    alone = min(turn.processor for turn in singles)
    each = min(turn.processor for turn in batches)
    bound = alone / max(each - cycles, each / len(cores))
    print(
        f"processor time of a step: {1e6 * alone:.0f} us alone, of which C++ "
        f"{1e6 * cycles:.0f}; {1e6 * each:.0f} us in the batch; ratio that this "
        f"allows: {bound:.2f}"
    )
    batch.vec.close()
    single.env.close()


if __name__ == "__main__":
    main()
