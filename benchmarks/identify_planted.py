"""Are planted parameters recovered? Gravity, mass scale and damping, seed by seed.

Each seed plants other values, records the scripted motions on that arm, without noise
and with the noise of the twin medium, and fits the paper's parameters to them:

    python benchmarks/identify_planted.py --seeds 5

The last lines are the largest errors beside what they have to stay below.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from dovetail.identify.fit import FitConfig, FitResult, fit
from dovetail.identify.parameters import ParameterSet
from dovetail.identify.recorder import RecordConfig, record
from dovetail.plants.twin import load_twin
from dovetail.settings import values_of

LIMITS = {"no noise": (0.02, 0.01, 0.05), "noise of medium": (0.1, 0.03, 0.15)}
"""Largest errors: gravity [m/s2], mass scale and damping as shares of the planted."""
NOISE = ("torque_noise", "position_noise", "velocity_noise")


def plant(seed: int) -> np.ndarray:
    """Return gravity x y z [m/s2], mass scale [1] and damping [Nms/rad] of a seed."""
    rng = np.random.default_rng(seed)
    low, high = [-0.4, -0.4, -0.4, 0.92, 0.3], [0.4, 0.4, 0.4, 1.08, 1.0]
    return rng.uniform(low, high)


def recover(
    planted: np.ndarray, noise: dict[str, float], args: argparse.Namespace, seed: int
) -> FitResult:
    """Record on an arm with planted values and fit."""
    parameters = ParameterSet.parse("paper")
    model = replace(parameters.to_model(planted), seed=seed, **noise)
    quiet = Console(quiet=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.toml").write_text(model.to_toml())
        arm = f"twin:{folder / 'arm.toml'}"
        record(RecordConfig(arm=arm, out=folder / "log", seed=seed), quiet)
        return fit(
            FitConfig(
                log=folder / "log",
                out=folder / "fit",
                plant=args.plant,
                workers=args.workers,
                evaluations=args.evaluations,
                warm_start=not args.cold,
            ),
            quiet,
        )


def main() -> None:
    """Plant, record, fit, compare."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--evaluations", type=int, help="at most, of a fit")
    parser.add_argument("--plant", default="mujoco")
    parser.add_argument(
        "--cold", action="store_true", help="begin at the nominal model"
    )
    args = parser.parse_args()
    medium = load_twin("medium")
    noises = {
        "no noise": {},
        "noise of medium": {name: values_of(medium)[name] for name in NOISE},
    }
    heads = ("gravity_x", "gravity_y", "gravity_z", "mass", "damping")
    worst = {name: np.zeros(3) for name in noises}
    for seed in range(args.seeds):
        planted = plant(seed)
        print(f"seed {seed} planted    " + _row(heads, planted))
        for name, noise in noises.items():
            result = recover(planted, noise, args, seed)
            error = np.abs(result.vector - planted)
            shares = error[3:] / planted[3:]
            worst[name] = np.maximum(worst[name], [error[:3].max(), *shares])
            print(
                f"  {name:16} " + _row(heads, result.vector) + f"  "
                f"{1e3 * result.rms_before:.1f} -> {1e3 * result.rms_after:.4f} mm, "
                f"{result.evaluations} logs, {result.wall_time:.1f} s",
                flush=True,
            )
    for name, values in worst.items():
        limits = LIMITS[name]
        verdict = "reached" if (values <= limits).all() else "MISSED"
        print(
            f"{name}: worst of {args.seeds} seeds: gravity {values[0]:.4f} m/s2 (limit "
            f"{limits[0]:g}), mass scale {100 * values[1]:.3f} % ({100 * limits[1]:g}),"
            f" damping {100 * values[2]:.2f} % ({100 * limits[2]:g}): {verdict}"
        )


def _row(names: tuple[str, ...], values: np.ndarray) -> str:
    return " ".join(f"{n} {v:8.4f}" for n, v in zip(names, values, strict=True))


if __name__ == "__main__":
    main()
