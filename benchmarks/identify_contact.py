"""How accurate is the contact friction that is estimated from slides?

A row for each twin: its own friction coefficient, the estimate with its 95 % interval,
its error, and whether the truth lies inside.

    python benchmarks/identify_contact.py --twins 20

With --stiffness a row says by how much the lowest corner of the part's end goes down
per newton of normal force, of the same twin with contacts of 5 and of 25 ms. If contact
gave way enough to be seen, the two would differ.

    python benchmarks/identify_contact.py --twins 6 --shipped --stiffness
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from dovetail.envs.registered import find_cell
from dovetail.identify.contact_friction import contact_friction
from dovetail.identify.contact_log import StripLog, load_contact
from dovetail.identify.recorder import RecordConfig, record
from dovetail.plants.plant import COLUMN
from dovetail.plants.sampled_twin import sample_twin
from dovetail.plants.twin import Twin, list_twins, load_twin
from dovetail.poses import matrix_from_quat


def slides_of(
    name: str, twin: Twin, period: float, folder: Path
) -> tuple[StripLog, ...]:
    """Record slides on a twin, and read them."""
    file = folder / f"{name}.toml"
    file.write_text(twin.to_toml())
    config = RecordConfig(
        arm=f"twin:{file}",
        period=period,
        out=folder / name,
        sequences=1,
        steps=2,
        contact=True,
    )
    recording = record(config, Console(quiet=True))
    return load_contact(config.out, recording.metadata)


def measure(
    name: str, strips: tuple[StripLog, ...], truth: float
) -> tuple[bool, float] | None:
    """Print the row of a twin.

    Returns:
        Whether the truth is inside the interval, and the estimate's error as a share
        of it; None where it is not identified.
    """
    peak = max(s.log[:, COLUMN["fz"]].max() for strip in strips for s in strip.slides)
    found = contact_friction(strips)
    if found.value is None or found.half_width is None or found.reason:
        print(f"| {name} | {truth:.3f} | | {found.reason} | | {peak:.0f} |")
        return None
    is_inside = abs(found.value - truth) <= found.half_width
    error = found.value / truth - 1.0
    print(
        f"| {name} | {truth:.3f} | {found.value:.3f} +- {found.half_width:.3f} "
        f"| {'yes' if is_inside else 'no'} | {100.0 * error:+.1f} | {peak:.0f} |",
        flush=True,
    )
    return is_inside, error


def compliance(strips: tuple[StripLog, ...]) -> float:
    """Return how far the end's lowest corner goes down per normal force [m/N]."""
    held = find_cell().held.corners
    end = held[held[:, 2] > held[:, 2].max() - 1e-4]
    slopes = []
    for strip in strips:
        rows = []
        for slide in strip.slides:
            if slide.press == 0.0:
                continue
            log = slide.log[len(slide.log) // 2 :]
            quats = log[:, COLUMN["qw"] : COLUMN["qz"] + 1]
            low = [(matrix_from_quat(quat)[2] @ end.T).min() for quat in quats]
            rows.append(
                (log[:, COLUMN["wrench_fz"]].mean(), np.mean(log[:, COLUMN["z"]] + low))
            )
        force, height = np.array(rows).T
        slopes.append(-np.polyfit(force, height, 1)[0])
    return float(np.mean(slopes))


def stiffness(twins: dict[str, Twin], period: float, folder: Path) -> None:
    """Print the table of --stiffness."""
    print("| twin | 5 ms [um/N] | 25 ms [um/N] |\n|---|---|---|")
    for name, twin in twins.items():
        found = [
            compliance(
                slides_of(
                    f"{name} {time:g}", replace(twin, contact_time=time), period, folder
                )
            )
            for time in (0.005, 0.025)
        ]
        print(f"| {name} | {1e6 * found[0]:.1f} | {1e6 * found[1]:.1f} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=20)
    parser.add_argument("--first", type=int, default=100, help="seed of the first twin")
    parser.add_argument("--shipped", nargs="*", default=list(list_twins()))
    parser.add_argument("--engine", default="mujoco")
    parser.add_argument("--period", type=float, default=0.005, help="[s]")
    parser.add_argument("--stiffness", action="store_true")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.twins)
    twins = {f"seed {seed}": sample_twin(seed, asked.engine) for seed in seeds}
    twins |= {name: load_twin(name) for name in asked.shipped}
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        if asked.stiffness:
            stiffness(twins, asked.period, folder)
            return
        print("| twin | friction [1] | estimate [1] | inside | error [%] | peak [N] |")
        print("|---|---|---|---|---|---|")
        found = [
            measure(
                name,
                slides_of(name, twin, asked.period, folder),
                twin.contact_friction,
            )
            for name, twin in twins.items()
        ]
    rows = [row for row in found if row is not None]
    print(f"{len(rows)} of {len(found)} identified", end="")
    if not rows:
        print()
        return
    errors = sorted(abs(error) for _, error in rows)
    print(
        f", {sum(inside for inside, _ in rows)} of {len(rows)} inside; error "
        f"{100.0 * errors[len(errors) // 2]:.1f} % median, {100.0 * errors[-1]:.1f} % "
        "worst"
    )


if __name__ == "__main__":
    main()
