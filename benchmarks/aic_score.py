"""Points of connector policies by the rules of the AI for Industry Challenge.

Tries each policy on a twin, from starts that differ, with the plug displaced in the
fingers and the port's pose given wrong as the twin's camera does it. Three tries are a
submission: the mean of 60 of them is printed beside the challenge's 300, and where the
points were lost.

    python benchmarks/aic_score.py POLICY [POLICY ...] [--tracker truth]

Reference:
    intrinsic-dev/aic, docs/scoring.md; see `dovetail.evaluation.aic_score`.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console

import dovetail  # noqa: F401  (registers the environments)
from dovetail.episode import Episode
from dovetail.evaluation.aic_score import Insertion, Motion, Score, aic_score
from dovetail.evaluation.evaluate import Evaluation, EvaluationConfig, evaluate
from dovetail.evaluation.outcome import Outcome
from dovetail.tasks.connector.geometry import DEPTH, SUCCESS_DEPTH

INSIDE = 0.005
"""Distance from the port's axis up to which a plug is in it [m]."""
_BOTTOM = np.array([0.0, 0.0, -DEPTH])


def score(outcome: Outcome, logs: Path) -> Score:
    """Return the points of a try."""
    log, path = Episode.load(logs / outcome.files.log), outcome.course.path
    motion = Motion(
        period=float(np.diff(log["time"][:2])[0]),
        velocity=np.stack([log[name] for name in ("vx", "vy", "vz")], axis=1),
        force=np.stack([log[name] for name in ("fx", "fy", "fz")], axis=1),
    )
    return aic_score(
        motion,
        Insertion(
            success=outcome.success,
            depth=outcome.depth,
            full_depth=SUCCESS_DEPTH,
            is_inside=float(np.hypot(*path[-1, :2])) < INSIDE,
            distance=float(np.linalg.norm(path[0] - _BOTTOM)),
        ),
    )


def play(config: EvaluationConfig) -> tuple[Evaluation, list[Score]]:
    """Return an evaluation, and the points of its tries."""
    result = evaluate(config, Console(quiet=True))
    begun = [outcome for outcome in result.outcomes if outcome.course.steps]
    return result, [score(outcome, result.folder / "logs") for outcome in begun]


def main() -> None:
    """Score every policy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy", nargs="+")
    parser.add_argument("--twin", default="medium")
    parser.add_argument("--tracker", default="twin", help="who tells the port's pose")
    parser.add_argument("--tries", type=int, default=20, help="at each of three places")
    given = parser.parse_args()
    print(f"| policy | plugged in | points of 300 | {' | '.join(Score._fields)} |")
    print(f"|---|---|---|{'---|' * len(Score._fields)}")
    for policy in given.policy:
        with tempfile.TemporaryDirectory() as folder:
            config = EvaluationConfig(
                policy=policy,
                twin=given.twin,
                tracker=given.tracker,
                tries=given.tries,
                out=Path(folder) / "tries",
            )
            result, points = play(config)
        mean = np.mean(points, axis=0)
        row = result.rows[-1]
        print(
            f"| {policy} | {row.successes}/{row.tries} | {3.0 * mean.sum():.0f} | "
            f"{' | '.join(f'{part:.1f}' for part in mean)} |"
        )


if __name__ == "__main__":
    main()
