"""One call from settings to the report of all experiments, resumable at any point."""

import importlib.util
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from rich.console import Console

from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.identify.parameters import ParameterSet
from dovetail.plants.twin import Twin, load_twin
from dovetail.reproduce.budget import Budget, find_budget
from dovetail.reproduce.executor import Executor, LocalExecutor
from dovetail.reproduce.folder import locked, open_folder, write_twins
from dovetail.reproduce.plan import PlanConfig, plan
from dovetail.reproduce.report import write_reproduction
from dovetail.reproduce.schedule import RunSummary, check_plan, find_done, run_stages
from dovetail.reproduce.show import StageDisplay


@dataclass(frozen=True, kw_only=True)
class ReproduceConfig:
    """Settings of a reproduction: size, twins, plant and folder."""

    budget: Literal["smoke", "quick", "full"] = "quick"
    """Size: smoke runs every part once and learns nothing; quick trains one seed of
    each variant; full trains five."""
    out: Path = Path("reproduction")
    """Results folder: new, empty, or one of the same settings to go on with."""
    twins: tuple[str, ...] = ("medium", "hard")
    """Twins that stand in for the robot, shipped names or .toml files. All are
    identified; the transfer table and the robustness are of the first."""
    plant: Literal["bullet", "mujoco"] | None = None
    """Engine to train in; default bullet, as the paper, where it is installed."""
    parameters: str = "extended"
    """Parameters that are identified for the trainings: paper, extended or a list."""
    seed: int = 0
    """First training seed."""
    workers: int | None = None
    """Stages at once; default the cores."""
    cluster: str | None = None
    """Run the stages on Ray: `local`, or a cluster's address. The results folder must
    be at the same path on all its machines."""


class Reproduction(NamedTuple):
    """Result of a reproduction."""

    root: Path
    """The results folder, absolute."""
    tally: RunSummary
    """Stages that are done, failed or left out."""
    files: list[Path]
    """Report, figures and JSON."""


def reproduce(
    config: ReproduceConfig, console: Console, budget: Budget | None = None
) -> Reproduction:
    """Run what is not done yet of the experiments, and write the report.

    A stage that fails does not stop the others; the report says what is missing.

    Args:
        config: Settings.
        console: Where the progress goes.
        budget: Sizes in place of the named budget's.

    Raises:
        ConfigError: A setting is wrong, or the folder is of another configuration or
            in use; nothing is changed then.
        MissingDependencyError: Something that a stage needs is not installed.
    """
    twins = _load_twins(config.twins)
    ParameterSet.parse(config.parameters)
    if config.workers is not None:
        LocalExecutor(config.workers)  # refuses what makes no sense
    settings = PlanConfig(
        budget=budget or find_budget(config.budget),
        twins=tuple(twins),
        plant=config.plant or default_plant(),
        parameters=config.parameters,
        seed=config.seed,
    )
    _require_installed(settings.plant)
    stages = plan(settings)
    check_plan(stages)
    tables = {name: twin.table() for name, twin in twins.items()}
    described = {
        "budget": settings.budget.to_json(),
        "twins": tables,
        "plant": settings.plant,
        "identify_plant": settings.identify_plant,
        "parameters": settings.parameters,
        "seed": settings.seed,
    }
    root = open_folder(config.out, described)
    with locked(root):
        done = find_done(root, stages)
        write_twins(root, twins)
        with (
            closing(_make_executor(config)) as executor,
            StageDisplay(root, stages, done, executor.slots, console) as display,
        ):
            tally = run_stages(root, stages, executor, display)
        files = write_reproduction(root, settings, stages, tally)
    return Reproduction(root, tally, files)


def default_plant() -> Literal["bullet", "mujoco"]:
    """Return PyBullet, the paper's simulator, where it is installed."""
    return "bullet" if importlib.util.find_spec("pybullet") else "mujoco"


def _make_executor(config: ReproduceConfig) -> Executor:
    if config.cluster is None:
        return LocalExecutor(config.workers)
    from dovetail.reproduce.cluster import RayExecutor

    return RayExecutor(config.cluster, config.workers)


def _load_twins(names: tuple[str, ...]) -> dict[str, Twin]:
    """Return the twins by the names that files and tables give them."""
    if not names:
        raise ConfigError("twins is empty; name at least one, such as medium")
    twins: dict[str, Twin] = {}
    for name in names:
        stem = Path(name).stem if name.endswith(".toml") else name
        if stem in twins:
            raise ConfigError(f"twin {stem!r} is given twice; give each once")
        twins[stem] = load_twin(name)
    return twins


def _require_installed(plant: str) -> None:
    """Say what is missing before anything is written."""
    needed = {"sbx": "learn", "cmaes": "identify"}
    if plant == "bullet":
        needed["pybullet"] = "bullet"
    missing = [extra for m, extra in needed.items() if not importlib.util.find_spec(m)]
    if missing:
        raise MissingDependencyError(
            f"the experiments need more packages: {install_command(*missing)}"
        )
