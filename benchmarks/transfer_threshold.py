"""How far may a simulation be from the arm before the policy stops working?

Twins between the controller's model and a shipped twin: for each, the error of the
model on a recording of the twin, and the successes of the policy in 60 tries on it.
The go / no-go line of `dovetail identify report` is this table's.

    python benchmarks/transfer_threshold.py --out threshold
    python benchmarks/transfer_threshold.py --out threshold --no-tare --tries 20

What is graded is motion: contact, clearance and noise are the twin's in full at every
grade. An inertia set cannot be blended, so the masses are: each link's mass goes
geometrically from the controller's to the twin's, its centre of mass stays. Grades
that are done are not done again.
"""

import argparse
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from dovetail.envs.registered import find_cell
from dovetail.evaluation.config import EvaluationConfig, TriesConfig
from dovetail.evaluation.evaluate import evaluate
from dovetail.files import write_atomic
from dovetail.identify.parameters import nominal_model
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.replay import LogReplay
from dovetail.plants.twin import Twin, load_twin
from dovetail.settings import values_of

NUMBERS = ("damping", "coulomb", "armature", "gravity_residual", "command_delay")
KINDS = {
    "all": NUMBERS,
    "friction": ("damping", "coulomb", "armature"),
    "weight": ("gravity_residual",),
    "delay": ("command_delay",),
}
"""What a grade changes; the masses go with "all" and "weight"."""
GRADES = [
    *((twin, "all", f) for twin in ("medium", "hard") for f in (0.0, 0.25, 0.5, 0.75)),
    *(("medium", "all", f) for f in (1.0, 1.5, 2.0)),
    ("hard", "all", 1.0),
    *(("hard", "friction", f) for f in (0.25, 0.5, 0.75, 1.0)),
    *(("hard", "weight", f) for f in (0.5, 1.0, 1.5)),
    *(("hard", "delay", f) for f in (0.5, 1.0, 1.5, 2.0)),
]


def graded(twin: Twin, kind: str, fraction: float) -> Twin:
    """Return the twin at a part of its distance from the controller's model."""
    model, cell = nominal_model(), find_cell()
    ratio = np.array(cell.loaded_robot(twin.inertia).links.mass) / np.array(
        cell.loaded_robot().links.mass
    )
    masses = np.array(twin.mass_scale) * ratio
    weight = fraction if kind in ("all", "weight") else 0.0
    changed: dict[str, Any] = {"mass_scale": tuple((masses**weight).tolist())}
    for name in NUMBERS:
        start, end = np.array(values_of(model)[name]), np.array(values_of(twin)[name])
        share = fraction if name in KINDS[kind] else 0.0
        value = start + share * (end - start)
        changed[name] = float(value) if value.ndim == 0 else tuple(value.tolist())
    about = f"{fraction:g} of the way from the model ({kind})"
    return replace(twin, description=about, inertia="drake", **changed)


def measure(
    twin: str, kind: str, fraction: float, folder: Path, args: argparse.Namespace
) -> dict:
    """Record a graded twin, compare the controller's model with it, try the policy."""
    name = "tared" if args.tare else "untared"
    done = folder / f"{name}.json"
    if done.is_file():
        return json.loads(done.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / name, ignore_errors=True)  # of a run cut short
    quiet, path = Console(quiet=True), folder / "twin.toml"
    between = graded(load_twin(twin), kind, fraction)
    path.write_text(between.to_toml())
    recording = record(
        RecordConfig(arm=f"twin:{path}", out=folder / "recording"), quiet
    )
    rms = LogReplay(recording).rms(nominal_model())
    config = EvaluationConfig(
        policy=args.policy,
        twin=str(path),
        tries=args.tries,
        tare=args.tare,
        keep_logs=False,
        out=folder / name,
    )
    total = evaluate(config, quiet).rows[-1]
    row = {
        "twin": twin,
        "kind": kind,
        "fraction": fraction,
        "rms": rms,
        "successes": total.successes,
        "tries": total.tries,
    }
    write_atomic(done, json.dumps(row) + "\n")
    return row


def main() -> None:
    """Measure every grade and print the table, the closest first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--policy", default="peg_square")
    parser.add_argument("--grades", type=int, default=len(GRADES), help="so many")
    parser.add_argument("--tries", type=int, default=TriesConfig.tries)
    parser.add_argument("--no-tare", dest="tare", action="store_false")
    arguments = parser.parse_args()
    rows = []
    for twin, kind, fraction in GRADES[: arguments.grades]:
        folder = arguments.out / f"{twin}-{kind}-{fraction:g}"
        rows.append(measure(twin, kind, fraction, folder, arguments))
        print(".", end="", flush=True)
    print("\n| twin | what differs | part | error of the model [mm RMS] | inserted |")
    print("|---|---|---|---|---|")
    for row in sorted(rows, key=lambda row: row["rms"]):
        print(
            f"| {row['twin']} | {row['kind']} | {row['fraction']:g} "
            f"| {1e3 * row['rms']:.1f} | {row['successes']}/{row['tries']} |"
        )
    for name, some in (
        ("where the delay alone differs", [r for r in rows if r["kind"] == "delay"]),
        ("else", [r for r in rows if r["kind"] != "delay"]),
    ):
        missed = [r["rms"] for r in some if r["successes"] < r["tries"]]
        worst = min(missed, default=np.inf)
        works = max((r["rms"] for r in some if r["rms"] < worst), default=0.0)
        print(
            f"\n{name}: every try inserted up to {1e3 * works:.1f} mm, the first one "
            f"missed at {1e3 * worst:.1f} mm"
        )


if __name__ == "__main__":
    main()
