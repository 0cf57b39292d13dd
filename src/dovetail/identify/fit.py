"""Fit a model's parameters to a recording with CMA-ES (Hansen 2016)."""

import json
import math
import os
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.progress import TimeElapsedColumn

from dovetail.errors import ConfigError, MissingDependencyError
from dovetail.files import write_atomic
from dovetail.identify.parameters import ParameterSet, nominal_model
from dovetail.identify.population import Population, make_population
from dovetail.identify.recording import Recording
from dovetail.plants.twin import TwinConfig
from dovetail.types import Array

if TYPE_CHECKING:
    from cmaes import CMA


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """What to fit, to which log, and how long."""

    log: Path
    """Recording to fit, made by `dovetail identify record`."""
    plant: str = "mujoco"
    """Physics engine of the simulation: mujoco or bullet."""
    parameters: str = "paper"
    """paper, extended, or a list such as gravity,mass_scale,damping=0:2:0.5."""
    out: Path
    """Folder for model.toml and fit.json; new, empty, or one to resume."""
    evaluations: int = 600
    """Largest number of simulated logs."""
    seed: int = 0
    """Seed of the search."""
    workers: int | None = None
    """Processes; default one for each core."""
    resume: bool = False
    """Go on with the fit in the folder."""
    cluster: str | None = None
    """Evaluate on Ray: its address, or local."""


@dataclass(frozen=True)
class FitResult:
    """What a fit found."""

    model: TwinConfig
    vector: Array
    rms_before: float
    """Error of the nominal model [m]."""
    rms_after: float
    """Error of the fitted model [m]."""
    evaluations: int
    wall_time: float
    """[s]"""


def fit(config: FitConfig, console: Console) -> FitResult:
    """Search the parameters that bring the simulation closest to the recording."""
    parameters = ParameterSet.parse(config.parameters)
    begin = time.monotonic()
    config.out.mkdir(parents=True, exist_ok=True)
    workers = config.workers or os.cpu_count() or 1
    population = make_population(config.log, config.plant, workers, config.cluster)
    try:
        before = population.evaluate([nominal_model(config.plant)])[0]
        vector, after, count = _search(config, parameters, population, before, console)
    finally:
        population.close()
    result = FitResult(
        parameters.to_model(vector, config.plant),
        vector,
        before,
        after,
        count,
        time.monotonic() - begin,
    )
    write_atomic(config.out / "model.toml", result.model.to_toml())
    return result


def _search(
    config: FitConfig,
    parameters: ParameterSet,
    population: Population,
    before: float,
    console: Console,
) -> tuple[Array, float, int]:
    from cmaes import CMA

    low, high = parameters.low, parameters.high
    width = high - low
    optimiser = CMA(
        mean=(parameters.start - low) / width,
        sigma=0.15,
        bounds=np.column_stack([np.zeros(len(low)), np.ones(len(low))]),
        seed=config.seed,
    )
    best, best_vector, count = before, parameters.start, 0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("best {task.fields[best]:.3f} mm"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("fit", total=config.evaluations, best=1e3 * best)
        while count < config.evaluations and not optimiser.should_stop():
            asked = [optimiser.ask() for _ in range(optimiser.population_size)]
            vectors = [low + width * u for u in asked]
            values = population.evaluate(
                [parameters.to_model(v, config.plant) for v in vectors]
            )
            optimiser.tell(list(zip(asked, values, strict=True)))
            count += len(values)
            i = int(np.argmin(values))
            if values[i] < best:
                best, best_vector = values[i], vectors[i]
            progress.update(bar, completed=count, best=1e3 * best)
    return best_vector, best, count
