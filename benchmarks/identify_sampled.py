"""Are identified values true? Sampled twins, each identified from its own log.

A row for each twin and parameter set: error on a held-out log before and after, seconds
of the fit, and how many of the values that the report calls known have the twin's own
value inside their 95 % interval.

    python benchmarks/identify_sampled.py --twins 20 --out sampled

Rows that are done are not done again. The truth of a mass is the twin's link over the
model's, so its inertia set counts; of a value for all joints it is the joints' mean.
"""

import argparse
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from dovetail.envs.registered import find_cell
from dovetail.files import write_atomic
from dovetail.identify.fit import FitConfig, fit
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.identify.uncertainty import analyse
from dovetail.plants.sampled_twin import sample_twin
from dovetail.plants.twin import Twin

SETS = ("paper", "extended")


def truth_of(twin: Twin) -> Twin:
    """Return the twin with its masses as shares of the model's, of its own bodies."""
    cell = find_cell()
    mass = np.array(cell.loaded_robot(twin.inertia).links.mass)
    ratio = mass / np.array(cell.loaded_robot().links.mass)
    return replace(twin, mass_scale=tuple((np.array(twin.mass_scale) * ratio).tolist()))


def measure(
    seed: int,
    parameters: str,
    folder: Path,
    sequences: int,
    evaluations: int | None,
) -> dict:
    """Record a twin twice, fit the first log, and compare with the twin itself."""
    done = folder / f"{parameters}.json"
    if done.is_file():
        return json.loads(done.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    quiet, twin = Console(quiet=True), sample_twin(seed)
    (folder / "twin.toml").write_text(twin.to_toml())
    arm = f"twin:{folder / 'twin.toml'}"
    for name, excitation in (("log", 0), ("held-out", 1)):
        if not (folder / name / "recording.json").is_file():
            shutil.rmtree(folder / name, ignore_errors=True)
        config = RecordConfig(
            arm=arm, out=folder / name, seed=excitation, sequences=sequences
        )
        record(config, quiet)
    out = folder / parameters
    shutil.rmtree(out, ignore_errors=True)
    log = folder / "log"
    config = FitConfig(
        log=log, out=out, parameters=parameters, workers=1, evaluations=evaluations
    )
    found = fit(config, quiet)
    held_out = LogReplay(Recording.load(folder / "held-out"))
    result = analyse(LogReplay(Recording.load(log)), found.parameters, found.vector)
    truth = found.parameters.values_in(truth_of(twin))
    row = {
        "twin": seed,
        "inertia": twin.inertia,
        "parameters": parameters,
        "before": held_out.rms(found.parameters.nominal()),
        "after": held_out.rms(found.model),
        "fitting": found.rms_after,
        "evaluations": found.evaluations,
        "seconds": found.wall_time,
        "estimates": [
            estimate.numbers() | {"truth": float(value)}
            for estimate, value in zip(result.estimates, truth, strict=True)
        ],
    }
    write_atomic(done, json.dumps(row, indent=1) + "\n")
    return row


def is_inside(estimate: dict) -> bool:
    """Say whether the truth lies in the interval."""
    low, high = estimate["interval"]
    return low <= estimate["truth"] <= high


def print_row(row: dict) -> None:
    """Print a row of the table, and which known values miss the truth."""
    known = [e for e in row["estimates"] if e["verdict"] == "known"]
    missed = [e["name"] for e in known if not is_inside(e)]
    print(
        f"| {row['twin']} | {row['inertia']} | {row['parameters']} "
        f"| {1e3 * row['before']:.1f} | {1e3 * row['after']:.2f} "
        f"| {row['seconds']:.0f} | {len(known)} of {len(row['estimates'])} "
        f"| {len(known) - len(missed)} | {', '.join(missed)} |",
        flush=True,
    )


def print_summary(rows: list[dict], parameters: str) -> None:
    """Print median error and share of truths inside of a parameter set."""
    some = [row for row in rows if row["parameters"] == parameters]
    every = [
        e for row in some for e in row["estimates"] if np.isfinite(e["interval"][0])
    ]
    known = [e for e in every if e["verdict"] == "known"]
    after = [1e3 * row["after"] for row in some]
    print(
        f"{parameters}: {len(some)} twins, held-out error {np.median(after):.2f} mm "
        f"RMS median, {max(after):.2f} worst; {len(known)} values known, "
        f"{sum(is_inside(e) for e in known)} of their truths inside; "
        f"of all {len(every)} bounded ones "
        f"{sum(is_inside(e) for e in every)}"
    )


def main() -> None:
    """Identify twin after twin and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=20)
    parser.add_argument("--first", type=int, default=100, help="seed of the first twin")
    parser.add_argument("--sets", nargs="+", default=SETS, choices=SETS)
    parser.add_argument("--sequences", type=int, default=10)
    parser.add_argument("--evaluations", type=int)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    rows = []
    print("| twin | inertia | parameters | before [mm] | held out [mm] ", end="")
    print(
        "| fit [s] | known | inside | outside |\n|---|---|---|---|---|---|---|---|---|"
    )
    for seed in range(args.first, args.first + args.twins):
        for parameters in args.sets:
            folder, sizes = args.out / str(seed), (args.sequences, args.evaluations)
            rows.append(measure(seed, parameters, folder, *sizes))
            print_row(rows[-1])
    for parameters in args.sets:
        print_summary(rows, parameters)


if __name__ == "__main__":
    main()
