"""Up to which disturbance do the shipped policies insert?

One disturbance at a time, on twin `medium` at 5 ms, from mild to hard; each cell is
`dovetail evaluate` with 30 tries. The range of a disturbance ends at the last value at
which at least 95 % of the tries succeed, as do those before it.

    python benchmarks/policy_range.py --write

prints the table of docs/robustness.md and writes src/dovetail/policies/ranges.toml,
from which `dovetail evaluate` says that a try is outside. Without `--write` it only
prints. `--policy NAME` and `--disturbance NAME` choose; `--tries 5` is a quick look.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

from dovetail.evaluation.measured import DISTURBANCES, RANGES
from dovetail.learn.policy import Policy, find_policy, list_policies
from dovetail.plants.twin import load_twin

TWIN = "medium"
ENOUGH = 0.95
"""Share of the tries that succeed within a range."""


VALUES: dict[str, tuple[float, ...]] = {
    "push": (10, 20, 30, 45, 60),
    "fixture_speed": (0.01, 0.02, 0.04, 0.06, 0.08, 0.1),
    "bias": (0.001, 0.002, 0.003, 0.005, 0.01),
    "turn": (0.01, 0.02, 0.05, 0.1),
    "contact_friction": (0.3, 0.5, 0.7, 1.0, 1.5),
    "command_delay": (0.005, 0.01, 0.015),
    "clearance": (0.0005, 0.0003, 0.0002, 0.0001),
}
"""Tried, mild to hard [SI]."""


def options_for(name: str, value: float, folder: Path) -> list[str]:
    """Return the options of `dovetail evaluate` that make a try that hard."""
    if name in ("push", "fixture_speed"):
        return ["--twin", TWIN, f"--{name.replace('_', '-')}", str(value)]
    if name in ("bias", "turn"):
        return ["--twin", TWIN, "--tracker", f"late?delay=0&{name}={value}"]
    if name == "clearance":
        return ["--twin", TWIN, "--clearance", str(value)]
    file = folder / f"{name}.toml"
    file.write_text(replace(load_twin(TWIN), **{name: value}).to_toml())
    is_late = name == "command_delay" and value > 0.01
    more = ["--delay", f"{1e3 * value:g}ms"] if is_late else []
    return ["--twin", str(file), *more]


def successes(policy: str, options: list[str], tries: int) -> tuple[int, int, float]:
    """Return how many of how many tries succeeded, and the p95 of peak forces [N]."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["evaluate", policy, *options, "--tries", str(tries)]
        words += ["--no-keep-logs", "--workers", "2", "--out", f"{folder}/out"]
        ended = subprocess.run(
            [sys.executable, "-m", "dovetail", *words], capture_output=True, text=True
        )
        if ended.returncode:
            raise RuntimeError(f"dovetail {' '.join(words)}: {ended.stderr}")
        report = json.loads((Path(folder) / "out" / "report.json").read_text())
    row = report["rows"][-1]
    return row["successes"], row["tries"], row["force_peak_p95"]


def sweep(policy: str, name: str, tries: int) -> tuple[list[str], float | None]:
    """Try the values of a disturbance; return the cells, and where its range ends."""
    kind, cells, last, is_within = DISTURBANCES[name], [], None, True
    for value in VALUES[name]:
        with tempfile.TemporaryDirectory() as folder:
            options = options_for(name, value, Path(folder))
            done, count, peak = successes(policy, options, tries)
        is_within = is_within and done >= ENOUGH * count
        last = value if is_within else last
        cells.append(f"{kind.scale * value:g}: {done} ({peak:.0f} N)")
        print(f"  {policy} {name} {cells[-1]}", file=sys.stderr, flush=True)
        if done < 0.25 * count:
            break
    return cells, last


def text_of(ranges: dict[str, dict[str, float]]) -> str:
    """Return the file of the ranges."""
    lines = [
        "# How hard a try may be for each shipped policy, as measured; smaller is",
        "# harder for clearance. By: python benchmarks/policy_range.py --write",
    ]
    for policy, known in sorted(ranges.items()):
        lines += ["", f"[{policy}]"]
        lines += [f"{name} = {value}" for name, value in sorted(known.items())]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Sweep, print the table, write the ranges."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tries", type=int, default=10, help="at each of three poses")
    parser.add_argument("--policy", choices=list_policies(), action="append")
    parser.add_argument("--disturbance", choices=[*VALUES], action="append")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    ranges = tomllib.loads(RANGES.read_text()) if RANGES.exists() else {}
    count = 3 * given.tries
    print(f"| disturbance | policy | within | successes of {count} (p95 of peaks) |")
    print("|---|---|---|---|")
    for name in given.disturbance or VALUES:
        kind = DISTURBANCES[name]
        for policy in given.policy or list_policies():
            settings = Policy.load(find_policy(policy)).metadata["env"]
            if name == "clearance" and name not in settings:
                continue  # its task has none
            cells, last = sweep(policy, name, given.tries)
            within = "none"
            if last is not None:
                within = f"{kind.scale * last:g} {kind.unit}".removesuffix(" 1")
            words = f"{kind.words} [{kind.unit}]"
            print(f"| {words} | `{policy}` | {within} | {', '.join(cells)} |")
            known = ranges.setdefault(policy, {})
            none = math.inf if kind.falls else 0.0
            known[name] = none if last is None else last
            if given.write:
                RANGES.write_text(text_of(ranges))


if __name__ == "__main__":
    main()
