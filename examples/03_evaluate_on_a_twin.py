"""Try a policy on a twin, as `dovetail evaluate` does, and read the result.

A twin differs from the model in ways the policy was never told: masses, friction,
delay, noise. A result on a twin says "twin", never "robot".
"""

import argparse
import tempfile
from pathlib import Path

from rich.console import Console

from dovetail import EvaluationConfig, evaluate


def main() -> None:
    """Evaluate, and print what a program can read from the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", default="peg_square", help="shipped name or file")
    parser.add_argument("--twin", default="medium", help="shipped name or .toml file")
    parser.add_argument("--out", type=Path, help="default a temporary folder")
    parser.add_argument("--quick", action="store_true", help="one try per hole pose")
    args = parser.parse_args()

    config = EvaluationConfig(
        policy=args.policy,
        twin=args.twin,
        tries=1 if args.quick else 20,
        out=args.out or Path(tempfile.mkdtemp()) / "results",
    )
    evaluation = evaluate(config, Console())

    total = evaluation.rows[-1]
    print(f"{total.successes} of {total.tries} inserted on {evaluation.report.ground}")
    print(f"the rate is between {total.interval.low:.3f} and {total.interval.high:.3f}")
    worst = max(evaluation.outcomes, key=lambda outcome: outcome.force.peak)
    print(f"largest force {worst.force.peak:.1f} N, logged in {worst.files.log}")
    print(f"report: {evaluation.folder / 'report.html'}")


if __name__ == "__main__":
    main()
