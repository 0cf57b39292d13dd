"""How well does a tare tell weight from friction, and what is it worth to a policy?

For each shipped twin: the f* that the tare measures before each try, against the one on
the same twin without dry friction and noise, from the same starts; and the successes of
a policy with it and without.

    python benchmarks/tare_accuracy.py
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
from rich.console import Console

import dovetail  # noqa: F401  (registers the environments)
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.evaluation.job import TrialJob
from dovetail.evaluation.trials import plan_trials
from dovetail.plants.twin import Twin, list_twins, load_twin
from dovetail.tasks.peg_in_hole.task import PegInHole
from dovetail.types import Array


def without_friction(twin: Twin) -> Twin:
    """Return the twin without dry friction and noise."""
    silent = {"torque_noise": 0.0, "position_noise": 0.0, "velocity_noise": 0.0}
    return replace(twin, coulomb=(0.0,) * 7, **silent)


def tares(twin: Twin, jobs: list[TrialJob]) -> Array:
    """Return the tare before each try [m/s2], shape (tries, 3)."""
    env = gym.make("dovetail/PegInHole-v0", twin=twin, tare=True)
    found = []
    for job in jobs:
        hole = PegInHole.trial_poses[job.pose].pose()
        found.append(env.reset(seed=job.seed, options={"fixture": hole})[1]["tare"][:3])
    env.close()
    return np.array(found)


def successes(policy: str, twin: str, *, tare: bool, tries: int) -> str:
    """Return how many tries of a policy inserted."""
    with tempfile.TemporaryDirectory() as folder:
        config = EvaluationConfig(
            policy=policy,
            twin=twin,
            tare=tare,
            tries=tries,
            keep_logs=False,
            out=Path(folder) / "evaluation",
        )
        total = evaluate(config, Console(quiet=True)).rows[-1]
    return f"{total.successes}/{total.tries}"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", default="peg_square")
    parser.add_argument("--tries", type=int, default=20)
    parser.add_argument("--twins", nargs="+", default=list_twins())
    arguments = parser.parse_args()
    jobs = plan_trials(len(PegInHole.trial_poses), arguments.tries, 0)
    print(
        "| twin | mean f* x y z [m/s2] | error of an axis, RMS; worst [m/s2] ", end=""
    )
    print("| inserted without; with |\n|---|---|---|---|")
    for name in arguments.twins:
        twin = load_twin(name)
        found = tares(twin, jobs)
        error = np.abs(found - tares(without_friction(twin), jobs))
        mean = " ".join(f"{value:.2f}" for value in found.mean(axis=0))
        rms = np.sqrt((error**2).mean())
        counts = [
            successes(arguments.policy, name, tare=tare, tries=arguments.tries)
            for tare in (False, True)
        ]
        print(
            f"| {name} | {mean} | {rms:.2f}; {error.max():.2f} | {'; '.join(counts)} |"
        )


if __name__ == "__main__":
    main()
