"""How long it takes until a policy has learned: ours, and three peers, to one test.

Each learner starts in a process of its own, so that imports and compilations count, and
ends with the same test: deterministic episodes until the Wilson bound of `--until` is
shown. The peers learn in the same environments by the same reward, discount, steps in a
sum and first entropy, for the same test; what they have of their own is

* sbx: SBX's SAC as it is, with the recipe that `dovetail train` had before it ended by
  a test (4 environments, two updates of 256 per step, rate 1e-3);
* sb3: Stable-Baselines3's SAC (torch) with the recipe of `dovetail train`; it has no
  layer normalisation;
* flash: SBX's SAC with many environments (64), large batches (2048) and few updates
  (one for 32 steps), as FlashSAC has them; not its networks.

Prints wall and processor time to the end of the training and of the whole command, the
environment steps, the successes of 200 episodes that are the same for all, and for ours
the successes on twin `medium`. A learner that needs longer than `--limit` is stopped.

    python benchmarks/training_time.py
    python benchmarks/training_time.py --peers --clearance 0.00006 --steps 200000

Reference:
    FlashSAC: Fast and stable off-policy reinforcement learning for high-dimensional
    robot control, arXiv 2604.04539.
"""

import argparse
import json
import os
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dovetail.learn.algorithms import (
    derive_seed,
    falling_rate,
    limit_threads,
    make_vec_env,
)
from dovetail.learn.assess import assess, play
from dovetail.learn.config import TrainConfig
from dovetail.learn.early_stopping import EarlyStopping
from dovetail.learn.progress import EpisodeLog, Stopwatch

PEERS = {
    "sbx": {
        "num_envs": 4,
        "updates_per_step": 2.0,
        "learning_rate": 1e-3,
        "policy_delay": 1,
        "tau": 0.005,
    },
    "sb3": {"policy_delay": 1},
    "flash": {
        "num_envs": 64,
        "batch_size": 2048,
        "updates_per_step": 1 / 32,
        "policy_delay": 1,
        "learning_rate": 3e-3,
        "tau": 0.02,
    },
}
"""What is set otherwise than in `dovetail train`."""


class Figures(NamedTuple):
    """How a learner did."""

    trained: float
    """Wall time of the training [s]."""
    whole: float
    """Wall time of its process [s]."""
    processor: float
    """Processor time of its process [s]."""
    steps: int
    """Environment steps."""
    successes: int
    """Of the evaluation's episodes."""


class Predictor:
    """A model of either library as an actor."""

    def __init__(self, model: Any) -> None:
        """Take the model."""
        self._model = model

    def reset(self) -> None:
        """Forget nothing: it has no memory."""

    def __call__(self, observation: Any) -> Any:
        """Return the action without exploration."""
        return self._model.predict(observation, deterministic=True)[0]


def settings(options: argparse.Namespace, seed: int) -> TrainConfig:
    """Return the settings of ours."""
    given = {"clearance": options.clearance}
    return TrainConfig(
        task_options=given,
        seed=seed,
        steps=options.steps,
        until=options.until,
        learning_starts=options.learning_starts,
        eval_episodes=options.episodes,
    )


def make_peer(name: str, config: TrainConfig, env: Any, stop: EarlyStopping) -> Any:
    """Build a peer's algorithm as its library has it."""
    import sbx
    import stable_baselines3

    def rate(remaining: float) -> float:
        share = stop.rate(round(config.steps * (1.0 - remaining)))
        falling = falling_rate(config.full_rate, config.final_rate, remaining)
        return min(falling, config.full_rate * share)

    networks: dict[str, Any] = {"net_arch": list(config.net)}
    if name != "sb3":
        networks["layer_norm"] = config.layer_norm
    kind = stable_baselines3.SAC if name == "sb3" else sbx.SAC
    return kind(
        "MlpPolicy",
        env,
        learning_rate=rate,
        gamma=config.gamma,
        batch_size=config.batch_size,
        tau=config.tau,
        buffer_size=config.steps + config.num_envs,
        learning_starts=config.learning_starts,
        n_steps=config.n_steps,
        train_freq=1,
        gradient_steps=config.gradient_steps,
        ent_coef=config.entropy_coefficient(),
        policy_kwargs=networks,
        seed=derive_seed(config.seed),
        device="cpu",
    )


def train_peer(name: str, config: TrainConfig, folder: Path) -> dict[str, Any]:
    """Train a peer in this process, until it passes the test."""
    env, exam = make_vec_env(config), make_vec_env(config)
    from stable_baselines3.common.logger import configure

    from dovetail.learn.recorder import Recorder
    from dovetail.learn.tester import stage_of

    stop, stage = EarlyStopping(config), stage_of(exam)
    model = make_peer(name, config, env, stop)
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    env._seeds = [derive_seed(config.seed, 0, 2, i) for i in range(env.num_envs)]

    def is_passed() -> bool:
        step, actor = int(model.num_timesteps), Predictor(model)
        portions = (
            [episode.success for episode in play(actor, seeds, stage)]
            for seeds in stop.seeds(step)
        )
        return stop.is_passed(step, portions)

    watch = Stopwatch(0.0, 0, lambda: int(model._n_updates))
    log = EpisodeLog(folder / "progress.csv", 0)
    model.learn(
        config.steps,
        callback=Recorder(
            log,
            watch,
            lambda status: None,
            lambda: None,
            config.checkpoint_interval,
            stop,
            is_passed,
        ),
    )
    trained = watch.elapsed()
    found = assess(Predictor(model), config.eval_episodes, stage)
    for vec in (env, exam):
        vec.close()
    log.close()
    steps = int(model.num_timesteps)
    return {"trained": trained, "steps": steps, "successes": found["successes"]}


def timed(words: list[str], limit: float) -> tuple[float, float] | None:
    """Run a process; return its wall and processor time [s], None when stopped."""
    quiet = subprocess.DEVNULL
    start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        subprocess.run(words, check=True, timeout=limit, stdout=quiet, stderr=quiet)
    except subprocess.TimeoutExpired:
        return None
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - start, spent


def run_ours(config: TrainConfig, folder: Path, limit: float) -> Figures | None:
    """Train by the command line, as a user does."""
    words = [*shlex.split(config.command())[1:], "--out", str(folder)]
    spent = timed([sys.executable, "-m", "dovetail", *words], limit)
    if spent is None:
        return None
    policy = json.loads((folder / "policy.json").read_text())["provenance"]
    evaluation = json.loads((folder / "evaluation.json").read_text())
    trained, steps = policy["wall_time_s"], policy["steps"]
    return Figures(trained, *spent, steps, evaluation["successes"])


def run_peer(
    name: str, options: argparse.Namespace, seed: int, folder: Path
) -> Figures | None:
    """Train a peer in a process of this file."""
    folder.mkdir()
    words = [sys.executable, __file__, "--only", name, "--out", str(folder)]
    words += ["--seeds", str(seed)]
    for given in ("steps", "until", "clearance", "learning_starts", "episodes"):
        words += [f"--{given.replace('_', '-')}", str(vars(options)[given])]
    spent = timed(words, options.limit)
    if spent is None:
        return None
    found = json.loads((folder / "figures.json").read_text())
    return Figures(found["trained"], *spent, found["steps"], found["successes"])


def on_medium(folder: Path, tries: int) -> str:
    """Return the successes of a policy on twin medium, three poses of the hole."""
    if tries == 0:
        return ""
    out = folder / "medium"
    words = ["evaluate", str(folder / "policy"), "--twin", "medium"]
    words += ["--tries", str(tries), "--out", str(out)]
    subprocess.run(
        [sys.executable, "-m", "dovetail", *words],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    tried = json.loads((out / "report.json").read_text())["tries"]
    return f"{sum(bool(row['success']) for row in tried)}/{len(tried)}"


def line(name: str, seed: int, figures: Figures | None, limit: float, more: str) -> str:
    """Return a row of the table."""
    if figures is None:
        return f"| {name} | {seed} | over {limit:.0f} | | | | | |"
    cells = [f"{figures.trained:.0f}", f"{figures.whole:.0f}"]
    cells += [f"{figures.processor:.0f}", str(figures.steps), str(figures.successes)]
    return f"| {name} | {seed} | {' | '.join(cells)} | {more} |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument(
        "--peers", nargs="*", choices=PEERS, default=list(PEERS), help="first seed only"
    )
    parser.add_argument("--clearance", type=float, default=0.0005, help="[m]")
    parser.add_argument("--steps", type=int, default=60_000, help="at most")
    parser.add_argument("--until", type=float, default=0.98, help="see dovetail train")
    parser.add_argument("--learning-starts", type=int, default=1000)
    parser.add_argument("--episodes", type=int, default=200, help="of the evaluation")
    parser.add_argument("--tries", type=int, default=20, help="on medium, per pose")
    parser.add_argument("--limit", type=float, default=600.0, help="of a training [s]")
    parser.add_argument("--only", choices=PEERS, help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, help="run folders; default temporary ones")
    options = parser.parse_args()
    limit_threads()
    folder = options.out or Path(tempfile.mkdtemp())
    if options.only:
        config = settings(options, options.seeds[0])
        config = replace(config, **PEERS[options.only])
        found = train_peer(options.only, config, folder)
        (folder / "figures.json").write_text(json.dumps(found))
        return
    print(
        f"clearance {1e3 * options.clearance:g} mm per side, until {options.until:g}, "
        f"{len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}\n"
        f"| learner | seed | training [s] | whole [s] | processor [s] | steps | of "
        f"{options.episodes} | on medium |\n|---|---|---|---|---|---|---|---|",
        flush=True,
    )
    done = []
    for seed in options.seeds:
        place = folder / f"dovetail-{seed}"
        figures = run_ours(settings(options, seed), place, options.limit)
        medium = "" if figures is None else on_medium(place, options.tries)
        done += [] if figures is None else [figures]
        row = line("dovetail", seed, figures, options.limit, medium)
        print(row, flush=True)
    for name in options.peers:
        seed = options.seeds[0]
        place = folder / f"{name}-{seed}"
        figures = run_peer(name, options, seed, place)
        print(line(name, seed, figures, options.limit, ""), flush=True)
    if done:
        longest = max(figures.whole for figures in done)
        least = min(figures.successes for figures in done)
        mean = np.mean([figures.processor for figures in done])
        print(
            f"dovetail: longest {longest:.0f} s, least {least} of {options.episodes}, "
            f"mean processor time {mean:.0f} s"
        )


if __name__ == "__main__":
    main()
