"""Identification against mujoco.sysid, on the same log and parameters, in one run.

`mujoco.sysid` (Gauss-Newton with box bounds) gets our closed-loop replay as its
residual, our bounds and our start; we search with CMA-ES. Printed: error on the fitting
log and on a held-out log, simulated logs, time, and how wide each one's intervals are.

    python benchmarks/identify_sysid.py --twin medium --parameters paper

`--log` and `--held-out` take recordings that exist, of any arm.
"""

import argparse
import contextlib
import io
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from dovetail.identify.fit import FitConfig, fit
from dovetail.identify.parameters import ParameterSet, nominal_model
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording
from dovetail.identify.replay import LogReplay
from dovetail.identify.uncertainty import analyse
from dovetail.types import Array

QUIET = Console(quiet=True)


class Fit(NamedTuple):
    """What one method found, and what it took."""

    vector: Array
    logs: int
    """Simulated logs."""
    seconds: float
    half: Array
    """Half width of each 95 % interval."""


def import_sysid() -> Any:
    """Return mujoco.sysid, or say how to install it."""
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):
        sys.exit(
            "mujoco.sysid lacks what it needs; install it: "
            "pip install 'mujoco[sysid]==3.17.0'"
        )
    return sysid


class Residual:
    """Position error of the replay over the whole log, as sysid asks for it."""

    def __init__(self, replay: LogReplay, parameters: ParameterSet) -> None:
        """Keep what is replayed and what is varied."""
        self.replay, self.parameters, self.count = replay, parameters, 0
        self.measured = np.concatenate(replay.recording.positions())

    def __call__(self, x: Array, params: Any) -> tuple[list[Array], None, None]:
        """Return the residual of one vector, or of each column of an array."""
        columns = [self.one(column) for column in np.atleast_2d(x.T)]
        return [columns[0] if x.ndim == 1 else np.column_stack(columns)], None, None

    def one(self, vector: Array) -> Array:
        """Return the position error [m], flat."""
        self.count += 1
        inside = np.clip(vector, self.parameters.low, self.parameters.high)
        model = self.parameters.to_model(inside)  # sysid's bounds hold to rounding
        return (np.concatenate(self.replay.run(model)) - self.measured).ravel()


def with_sysid(
    sysid: Any, optimizer: str, log: Recording, parameters: ParameterSet, plant: str
) -> Fit:
    """Fit with one of mujoco.sysid's optimisers."""
    residual = Residual(LogReplay(log, plant), parameters)
    table = sysid.ParameterDict(
        {
            p.name: sysid.Parameter(p.name, p.start, p.low, p.high)
            for p in parameters.parameters
        }
    )
    table.move_off_bounds()
    begin = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):  # its optimisers print each step
        fitted, result = sysid.optimize(
            table, residual, optimizer=optimizer, verbose=False, x_scale="jac"
        )
    seconds = time.perf_counter() - begin
    vector = np.clip(fitted.as_vector(), parameters.low, parameters.high)
    count, error = residual.count, residual.one(vector)
    _, half = sysid.calculate_intervals([error], np.asarray(result.jac))
    return Fit(vector, count, seconds, half)


def with_dovetail(log: Path, parameters: str, plant: str, out: Path, seed: int) -> Fit:
    """Fit with CMA-ES."""
    begin = time.perf_counter()
    config = FitConfig(log=log, plant=plant, parameters=parameters, out=out, seed=seed)
    result = fit(config, QUIET)
    seconds = time.perf_counter() - begin
    chosen = ParameterSet.parse(parameters)
    judged = analyse(LogReplay(Recording.load(log), plant), chosen, result.vector)
    half = np.array([e.uncertainty.interval[1] - e.value for e in judged.estimates])
    return Fit(result.vector, result.evaluations, seconds, half)


def main() -> None:
    """Fit one log in three ways and print what each gives on another log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--held-out", type=Path)
    parser.add_argument("--twin", default="medium")
    parser.add_argument("--parameters", default="paper")
    parser.add_argument("--plant", default="mujoco")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    sysid = import_sysid()
    parameters = ParameterSet.parse(arguments.parameters)
    with tempfile.TemporaryDirectory() as folder:
        log, held_out = arguments.log, arguments.held_out
        for name, seed in (("log", 0), ("held_out", 1)):
            if getattr(arguments, name) is None:
                path, arm = Path(folder) / name, f"twin:{arguments.twin}"
                record(RecordConfig(arm=arm, out=path, seed=seed), QUIET)
                log, held_out = (path, held_out) if name == "log" else (log, path)
        fits = {
            "dovetail, CMA-ES": with_dovetail(
                log,
                arguments.parameters,
                arguments.plant,
                Path(folder) / "fit",
                arguments.seed,
            )
        }
        fitted = Recording.load(log)
        for optimizer in ("mujoco", "scipy"):
            fits[f"mujoco.sysid, {optimizer}"] = with_sysid(
                sysid, optimizer, fitted, parameters, arguments.plant
            )
        show(fits, fitted, Recording.load(held_out), parameters, arguments.plant)


def show(
    fits: dict[str, Fit],
    log: Recording,
    held_out: Recording,
    parameters: ParameterSet,
    plant: str,
) -> None:
    """Print errors and times, then values and intervals."""
    replays = LogReplay(log, plant), LogReplay(held_out, plant)
    before = [1e3 * r.rms(nominal_model()) for r in replays]
    print("| fit | fitting log [mm RMS] | held-out log [mm RMS] | simulated logs | s |")
    print("|---|---|---|---|---|")
    print(f"| none | {before[0]:.3f} | {before[1]:.3f} | | |")
    held = {}
    for name, (vector, count, seconds, _) in fits.items():
        ours, other = (1e3 * r.rms(parameters.to_model(vector)) for r in replays)
        held[name] = other
        print(f"| {name} | {ours:.3f} | {other:.3f} | {count} | {seconds:.1f} |")
    first, *rest = held.values()
    print(
        f"\nheld-out error over the better of the two peers: {first / min(rest):.3f}\n"
    )
    print("| parameter |", " | ".join(fits), "|")
    print("|---" * (1 + len(fits)) + "|")
    for i, p in enumerate(parameters.parameters):
        cells = [f"{v[i]:.4g} +- {half[i]:.2g}" for v, _, _, half in fits.values()]
        print(f"| {p.name} [{p.unit}] |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
