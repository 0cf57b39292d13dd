"""Fit a model to a recording: the parameters that move the simulation as the arm."""

import os
import shlex
import time
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

from dovetail.distribution import installed_version
from dovetail.errors import ConfigError, LogError
from dovetail.files import write_atomic
from dovetail.identify.contact_estimate import ContactEstimate, with_contact
from dovetail.identify.contact_friction import contact_friction
from dovetail.identify.contact_log import load_contact
from dovetail.identify.fit_folder import MODEL, SUMMARY, FitFolder
from dovetail.identify.parameters import ParameterSet
from dovetail.identify.population import (
    Population,
    evaluate_population,
    make_population,
)
from dovetail.identify.prior import Prior
from dovetail.identify.recording import Recording
from dovetail.identify.search import Search, space_of
from dovetail.identify.warm_start import (
    NO_EFFECT,
    WarmStart,
    describe_sensitivity,
    measure_warm_start,
)
from dovetail.options import option_words
from dovetail.plants.find import find_engine
from dovetail.plants.twin import Twin
from dovetail.settings import defaults_of, settings, values_of
from dovetail.types import Array

EVALUATIONS_PER_PARAMETER = 200
"""Default budget of simulated logs; a search that has converged ends before."""
AT_BOUND = 0.01
"""Distance from a bound that counts as there, as a share of the range."""


@settings()
class FitSearchConfig:
    """The search for the parameters."""

    evaluations: int | None = None
    """Most logs to simulate; default 200 per parameter."""
    seed: int = 0
    """Seed of the search, 0 or more."""
    warm_start: bool = True
    """Begin CMA-ES at a least-squares answer; without, at the nominal model."""


@settings()
class SimulatedLogsConfig:
    """Engine and processes that simulate the logs."""

    plant: str = "mujoco"
    """Physics engine of the simulation: mujoco, bullet or drake."""
    workers: int | None = None
    """Processes; default one for each core."""
    cluster: str | None = None
    """Simulate on a Ray cluster: its address, auto, or local."""


@settings()
class FitConfig(FitSearchConfig, SimulatedLogsConfig):
    """Settings of a fit: parameters, log and budget."""

    log: Path
    """Recording to fit, made by `dovetail identify record`."""
    parameters: str = "paper"
    """Parameters: paper, extended, or a list such as gravity,mass_scale,damping;
    NAME=LOW:HIGH or NAME=LOW:HIGH:START sets bounds and start."""
    out: Path = Path("identified")
    """Folder for model.toml and fit.json; new or empty, or with --resume a fit's."""
    resume: bool = False
    """Go on with the fit that is in the folder."""


@dataclass(frozen=True)
class FitResult:
    """Result of a fit."""

    model: Twin
    vector: Array
    """Value of each parameter, in its unit."""
    rms_before: float
    """Error of the nominal model [m]."""
    rms_after: float
    """Error of the fitted model [m]."""
    evaluations: int
    wall_time: float
    """Time of the search [s], all its runs together."""
    parameters: ParameterSet
    """Parameters that were searched, with their start in the controller's model."""
    warnings: tuple[str, ...] = field(default=())
    """Warnings for a reader of the result."""
    contact: tuple[ContactEstimate, ...] = field(default=())
    """Contact parameters from the recording's slides; empty where it has none."""


def fit(config: FitConfig, console: Console) -> FitResult:
    """Search the parameters that bring the simulation closest to the recording.

    Args:
        config: What to do.
        console: Where progress and warnings go.

    Raises:
        DovetailError: A setting, the recording, the folder, or workers that die; see
            its message.
        KeyboardInterrupt: It was cut short, and it was said how to go on.
    """
    try:
        return _fit(config, console)
    except KeyboardInterrupt:
        if (config.out / SUMMARY).is_file():
            command = shlex.join(["dovetail", *resume_words(config)])
            console.print(
                "cut short; every generation that ended is kept; go on with: "
                f"{command}",
                soft_wrap=True,
                highlight=False,
            )
        raise


def resume_words(config: FitConfig) -> list[str]:
    """Return the command that goes on with a fit: what differs from the defaults."""
    words = ["identify", "fit", str(config.log)]
    usual = defaults_of(FitConfig)
    for name, value in values_of(replace(config, resume=True)).items():
        is_named = value != usual.get(name) or name == "out"
        if name != "log" and is_named:
            words += option_words(name, value)
    return words


def _fit(config: FitConfig, console: Console) -> FitResult:
    find_engine(config.plant)  # what it does not know is refused before any work
    parameters = ParameterSet.parse(config.parameters)
    budget = config.evaluations or EVALUATIONS_PER_PARAMETER * len(parameters.names)
    if budget < 1 or config.seed < 0:
        raise ConfigError(
            f"evaluations is {budget} and seed {config.seed}; needs at least 1 and 0"
        )
    recording = Recording.load(config.log)
    parameters = parameters.of_robot(recording.cell.robot)
    slides = load_contact(config.log, recording.metadata)
    contact = (contact_friction(slides),) if slides else ()
    settings = _settings(config, parameters, recording)
    folder = FitFolder.claim(config.out, settings, resume=config.resume)
    workers = os.cpu_count() or 1 if config.workers is None else config.workers
    population = make_population(recording, config.plant, workers, config.cluster)
    begin = time.monotonic()
    with closing(population):
        prior = Prior(parameters, len(recording.sequences))
        warm_start = _begin(folder, settings, prior, population, config)
        search = _Fit(config, prior, warm_start, folder, population)
        search.repeat()
        earlier = folder.generations[-1]["time"] if folder.generations else 0.0
        search.run(budget, begin - earlier, console)
        vector, after = search.conclude()
    wall_time = time.monotonic() - begin + earlier
    warnings = _warnings(parameters, warm_start, vector, population.deaths)
    model = with_contact(parameters.to_model(vector, config.plant), contact)
    model = model.on(recording.cell.robot)
    result = FitResult(
        _describe(model, recording, after),
        vector,
        warm_start.before,
        after,
        search.search.evaluations + warm_start.evaluations,
        wall_time,
        parameters,
        warnings,
        contact,
    )
    _write(folder, parameters, warm_start, result, search.search.history, config)
    for warning in warnings:
        console.print(f"warning: {warning}", soft_wrap=True, highlight=False)
    return result


def _settings(
    config: FitConfig, parameters: ParameterSet, recording: Recording
) -> dict[str, Any]:
    """Return what determines the search, as JSON can hold it."""
    return {
        "log": recording.fingerprint(),
        "robot": recording.metadata["robot"],
        "task": recording.metadata["task"],
        "period": recording.period,
        "plant": config.plant,
        "parameters": [
            [p.name, p.unit, p.low, p.high, p.start, p.spread]
            for p in parameters.parameters
        ],
        "seed": config.seed,
        "warm_start": config.warm_start,
    }


def _begin(
    folder: FitFolder,
    settings: dict[str, Any],
    prior: Prior,
    population: Population,
    config: FitConfig,
) -> WarmStart:
    """Measure where the search begins, or read it where it is known."""
    if folder.summary is not None:
        return WarmStart.from_dict(folder.summary["warm_start"])
    plant, warm = config.plant, config.warm_start
    warm_start = measure_warm_start(prior, population, plant, warm=warm)
    folder.write_summary(
        {"state": "running", "settings": settings, "warm_start": warm_start.to_dict()}
    )
    folder.begin_generations()
    return warm_start


class _Fit:
    """A search over the active parameters, and where its values come from."""

    def __init__(
        self,
        config: FitConfig,
        prior: Prior,
        warm_start: WarmStart,
        folder: FitFolder,
        population: Population,
    ) -> None:
        self._config = config
        self._prior = prior
        self._parameters = prior.parameters
        self._active = list(warm_start.active)
        self._folder = folder
        self._population = population
        space = space_of(prior.parameters, warm_start.active)
        self.search = Search(
            space, warm_start.mean, warm_start.covariance, warm_start.start, config.seed
        )

    def _whole(self, vector: Array) -> Array:
        """Return the vector of all parameters; those without effect stay at start."""
        whole = self._parameters.start.copy()
        whole[self._active] = vector
        return whole

    def _errors(self, vectors: list[Array]) -> list[float]:
        """Return the RMS error of each vector of the active parameters [m]."""
        engine = self._config.plant
        models = [self._parameters.to_model(self._whole(v), engine) for v in vectors]
        return evaluate_population(models, self._population)

    def _values(self, vectors: list[Array]) -> list[float]:
        """Return what is minimised: error [m] times the factor of the prior."""
        factors = [self._prior.factor(self._whole(v)) for v in vectors]
        return (np.array(self._errors(vectors)) * factors).tolist()

    def repeat(self) -> None:
        """Repeat the folder's generations to the search."""
        for number, generation in enumerate(self._folder.generations):
            count = len(self.search.ask())
            if len(generation["values"]) != count:
                raise LogError(
                    f"{self._folder.path}: generation {number} has "
                    f"{len(generation['values'])} values, the search asks for {count}; "
                    "it was made by another version: choose another --out"
                )
            self.search.tell(generation["values"])

    def run(self, budget: int, begin: float, console: Console) -> None:
        """Search until the budget is used or nothing improves.

        Args:
            budget: Most evaluations.
            begin: When the search began, by the monotonic clock [s].
            console: Where the progress bar goes.
        """
        search = self.search
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("simulated logs, best {task.fields[best]:.3f} mm"),
            TimeElapsedColumn(),
        )
        with Progress(*columns, console=console) as progress:
            bar = progress.add_task("fit", total=budget, best=1e3 * search.best)
            while search.evaluations < budget and not search.has_converged():
                values = self._values(search.ask())
                search.tell(values)
                self._folder.append(values, time.monotonic() - begin)
                progress.update(
                    bar, completed=search.evaluations, best=1e3 * search.best
                )
            progress.update(bar, total=search.evaluations)

    def conclude(self) -> tuple[Array, float]:
        """Return the best vector of all parameters, and its error [m].

        The middle of the last generation is a candidate too.
        """
        search = self.search
        vectors = [search.best_vector, search.mean]
        errors = self._errors(vectors)
        values = [
            error * self._prior.factor(self._whole(vector))
            for error, vector in zip(errors, vectors, strict=True)
        ]
        best = int(np.argmin(values))
        return self._whole(vectors[best]), errors[best]


def _warnings(
    parameters: ParameterSet, warm_start: WarmStart, vector: Array, deaths: int
) -> tuple[str, ...]:
    """Return what a reader of the result has to know."""
    lines = [
        f"{describe_sensitivity(p, size)}: it has no effect on this log and stays at "
        f"{p.start:g} {p.unit}"
        for p, size in zip(parameters.parameters, warm_start.sensitivity, strict=True)
        if size < NO_EFFECT
    ]
    shares = space_of(parameters).to_shares(vector)
    for i, p in enumerate(parameters.parameters):
        if i not in warm_start.active or AT_BOUND < shares[i] < 1.0 - AT_BOUND:
            continue
        name, bound = ("lower", p.low) if shares[i] <= AT_BOUND else ("upper", p.high)
        lines.append(
            f"{p.name} ends at its {name} bound of {bound:g} {p.unit} ({vector[i]:.4g} "
            f"{p.unit}): the log asks for more than the bound allows, or for something "
            "that is not among the parameters; widen it with "
            f"{p.name}=LOW:HIGH, or fit more parameters"
        )
    if deaths:
        lines.append(f"workers died {deaths} times; their evaluations were done again")
    return tuple(lines)


def _describe(model: Twin, recording: Recording, after: float) -> Twin:
    arm = recording.metadata["arm"].partition("?")[0]
    text = f"identified from {arm}, {1e3 * after:.2f} mm RMS left on the fitting log"
    return replace(model, description=text)


def _write(
    folder: FitFolder,
    parameters: ParameterSet,
    warm_start: WarmStart,
    result: FitResult,
    history: list[float],
    config: FitConfig,
) -> None:
    """Write the model, then the summary that says it is there."""
    made = datetime.now(UTC).isoformat(timespec="seconds")
    known = folder.summary or {}
    version = installed_version("dovetail")
    comments = (
        f"# Made by dovetail {version}, {made}: dovetail identify fit",
        f"# Log: {config.log} (hash {known['settings']['log']})",
        f"# Parameters: {', '.join(parameters.names)}",
        f"# RMS error of the TCP on the log: {1e3 * result.rms_before:.3f} mm before, "
        f"{1e3 * result.rms_after:.3f} mm after; {result.evaluations} simulated logs",
        *(f"# Contact: {estimate.sentence()}" for estimate in result.contact),
        "# No noise: it is a model to train in, not a twin to try on.",
    )
    text = "\n".join(comments) + "\n" + result.model.to_toml()
    write_atomic(folder.path / MODEL, text)
    values = [
        {
            "name": p.name,
            "unit": p.unit,
            "low": p.low,
            "high": p.high,
            "start": p.start,
            "spread": p.spread,
            "value": float(value),
            "sensitivity_mm": 1e3 * size,
            "has_effect": i in warm_start.active,
        }
        for i, (p, value, size) in enumerate(
            zip(
                parameters.parameters,
                result.vector,
                warm_start.sensitivity,
                strict=True,
            )
        )
    ]
    folder.write_summary(
        known
        | {
            "state": "done",
            "made": made,
            "versions": {
                n: installed_version(n) for n in ("dovetail", "cmaes", "mujoco")
            },
            "log": str(config.log.absolute()),
            "parameters": values,
            "history_mm": [1e3 * e for e in history],
            "result": {
                "rms_before": result.rms_before,
                "rms_after": result.rms_after,
                "evaluations": result.evaluations,
                "wall_time": result.wall_time,
                "warnings": list(result.warnings),
                "contact": [estimate.numbers() for estimate in result.contact],
            },
        }
    )
