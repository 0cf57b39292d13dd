"""How many steps guided policy search and SAC need, beside each other.

    python benchmarks/gps_and_sac.py --out FOLDER
    python benchmarks/gps_and_sac.py --out FOLDER --goals random --seeds 0 1
    python benchmarks/gps_and_sac.py --out FOLDER --algorithms gps --kl-step 0.5

With `--goals fixed` the hole stays at the first pose in which policies are tried, and
the tool starts up to 30 mm beside it, 20 to 60 mm above its mouth and turned by up to
0.1 rad. With `--goals random` hole and start are drawn as in a training by default.

A training counts as done at the first of its tests in which 38 of 40 tries succeed. The
tries are the same for every training, with starts that no training uses, and without
exploration; a test ends when it cannot come to 38 any more. Each finished training is a
file in the folder: a run that was cut short goes on with the next one.
"""

import argparse
import json
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dovetail.envs.registered import register_task
from dovetail.files import write_atomic
from dovetail.learn.config import TrainConfig
from dovetail.learn.progress import EpisodeRow
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.tasks.shipped import DEFAULT_ENV
from dovetail.tasks.starts import RandomisationConfig

TRIES, ENOUGH, PORTION = 40, 38, 8
NEAR = RandomisationConfig(aside=0.03, height=(0.02, 0.06), turn=0.1)
"""The small region of starts."""


@dataclass(frozen=True, kw_only=True)
class NearStart(PegInHole):
    """Peg in hole from a start near the hole."""

    randomisation: RandomisationConfig = field(default_factory=lambda: NEAR)


register_task("NearStart-v0", NearStart)
GOALS: dict[str, dict[str, Any]] = {
    "fixed": {"env": "NearStart-v0", "fixed_goal": True},
    "random": {"env": DEFAULT_ENV},
}


def train(config: TrainConfig, every: int) -> dict[str, Any]:
    """Train until a test is passed; return the step of it and all tests."""
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import configure

    from dovetail.learn.algorithms import derive_seed, make_vec_env
    from dovetail.learn.assess import TEST_SEED, play
    from dovetail.learn.checkpoint import seed_run
    from dovetail.learn.export import current_policy
    from dovetail.learn.one_run import prepared
    from dovetail.learn.tester import stage_of

    test = make_vec_env(config)
    seeds = [derive_seed(TEST_SEED, i) for i in range(TRIES)]
    tests: list[tuple[int, int, int]] = []
    testing = 0.0

    class Test(BaseCallback):
        def _on_step(self) -> bool:
            infos, dones = self.locals["infos"], self.locals["dones"]
            for info, done in zip(infos, dones, strict=True):
                if done:
                    run.stop.note(_row(self.num_timesteps, info))
            return not (tests and tests[-1][1] >= ENOUGH)

        def _on_rollout_start(self) -> None:
            nonlocal testing
            step = self.num_timesteps
            if step < every + (tests[-1][0] if tests else 0):
                return
            begin = time.process_time()
            policy = current_policy(self.model, config)
            tried = found = 0
            while tried < TRIES and tried - found <= TRIES - ENOUGH:
                portion = seeds[tried : tried + PORTION]
                found += sum(r.success for r in play(policy, portion, stage_of(test)))
                tried += len(portion)
            tests.append((step, found, tried))
            testing += time.process_time() - begin
            print(f"    step {step}: {found} of {tried}", flush=True)

    begin = time.process_time()
    with prepared(config) as run:
        seed_run(run.model, config.seed, 0)
        run.model.set_logger(configure(None, []))
        run.model.learn(config.steps, callback=Test())
    test.close()
    is_done = bool(tests) and tests[-1][1] >= ENOUGH
    return {
        "steps": tests[-1][0] if is_done else None,
        "processor time [s]": round(time.process_time() - begin - testing),
        "tests": tests,
    }


def _row(step: int, info: dict[str, Any]) -> EpisodeRow:
    """Return a finished episode as a training notes it, without force and time."""
    done = info["episode"]
    return EpisodeRow(step, done["r"], done["l"], int(info["success"]), 0.0, 0.0)


def line(name: str, results: Sequence[dict[str, Any]], most: int) -> str:
    """Return the row of the table."""
    steps = [result["steps"] for result in results]
    cells = ", ".join(f"> {most}" if step is None else str(step) for step in steps)
    known = statistics.median([most if step is None else step for step in steps])
    median = f"> {most}" if known >= most else f"{known:.0f}"
    spent = statistics.median([result["processor time [s]"] for result in results])
    return f"| {name} | {cells} | {median} | {spent:.0f} |"


def main() -> None:
    """Train what is not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--algorithms", nargs="+", default=["gps", "sac"])
    parser.add_argument("--goals", choices=list(GOALS), default="fixed")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--every", type=int, default=500)
    parser.add_argument("--max-steps", type=int, default=100)
    parser.add_argument("--kl-step", type=float)
    parser.add_argument("--conditions", type=int)
    given = parser.parse_args()
    own = {"kl_step": given.kl_step, "conditions": given.conditions}
    own = {name: value for name, value in own.items() if value is not None}
    given.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for algorithm in given.algorithms:
        more = own if algorithm == "gps" else {}
        words = [f"{name} {value:g}" for name, value in more.items()]
        title = ", ".join([algorithm, *words])
        if algorithm == "gps":
            more = {"num_envs": 8, **more}
        results = []
        for seed in given.seeds:
            name = f"{given.goals} {title} {given.steps} {seed}".replace(" ", "-")
            file = given.out / f"{name}.json"
            if not file.exists():
                print(f"  {given.goals} goals, {title}, seed {seed}", flush=True)
                config = TrainConfig(
                    out=given.out / "no-run",
                    algorithm=algorithm,
                    seed=seed,
                    steps=given.steps,
                    max_steps=given.max_steps,
                    threads=1,
                    **GOALS[given.goals],
                    **more,
                )
                write_atomic(file, json.dumps(train(config, given.every)) + "\n")
            results.append(json.loads(file.read_text()))
        rows.append(line(title, results, given.steps))
    print(
        f"\n| {given.goals} goals | seeds {given.seeds} | median | processor time [s] |"
    )
    print("|---|---|---|---|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
