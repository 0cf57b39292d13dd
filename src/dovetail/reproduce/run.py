"""One call from settings to the report of all experiments, resumable at any point."""

import importlib.util
import json
import os
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import tomlkit
from rich.console import Console

from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.files import write_atomic
from dovetail.plants.plant import Engine
from dovetail.plants.sampled_twin import sample_twin
from dovetail.plants.twin import Twin, load_twin
from dovetail.reproduce.budget import Budget, find_budget
from dovetail.reproduce.design import Design
from dovetail.reproduce.folder import (
    TRAIN,
    locked,
    open_folder,
    read_json,
    stage_folder,
    write_twins,
)
from dovetail.reproduce.plan import ARM, Stage, plan
from dovetail.reproduce.report import write_reproduction
from dovetail.reproduce.workflow import RunSummary, run_stages

PORTS = "cabinet.json"
"""File of the ports between the training on the twin and the twin's cabinet."""


@dataclass(frozen=True, kw_only=True)
class ReproduceConfig:
    """Settings of a reproduction: size, twins and folder."""

    budget: Literal["smoke", "quick", "full"] = "quick"
    """Size: smoke runs every part once and learns nothing; quick has 6 twins, full has
    20 and takes a night."""
    out: Path = Path("reproduction")
    """Results folder: new, empty, or one of the same settings to go on with."""
    twins: tuple[str, ...] = ()
    """Twins that stand in for robots, shipped names or .toml files; by default they
    are drawn as `dovetail twin sample` does."""
    seed: int = 0
    """First seed of the trainings and of the twins that are drawn."""
    workers: int | None = None
    """Stages at once; default the cores, or what the profile says."""
    profile: str | None = None
    """Run the stages on several machines: a profile of Snakemake, its name or folder.
    It says how, such as by Slurm. They all need the results folder at one path."""


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
    sizes = budget or find_budget(config.budget)
    twins = _load_twins(config.twins) or _draw_twins(config.seed, sizes.twins)
    if config.workers is not None and config.workers < 1:
        raise ConfigError(f"workers is {config.workers}; needs at least 1")
    _require_installed()
    design = Design(
        budget=sizes, twins=tuple(twins), engines=_engines(), seed=config.seed
    )
    stages = plan(design)
    described = {
        "budget": sizes.to_json(),
        "twins": {name: twin.table() for name, twin in twins.items()},
        "engines": list(design.engines),
        "seed": config.seed,
        "stages": {stage.name: stage.to_json() for stage in stages},
    }
    root = open_folder(config.out, described)
    with locked(root):
        write_twins(root, {**twins, ARM: load_twin(ARM)})
        _write_trainings(root, stages)
        words = [*_where(config), "--config", *_ports(root / PORTS)]
        tally = run_stages(root, stages, words, console)
        files = write_reproduction(root, design, stages, tally)
    return Reproduction(root, tally, files)


def _engines() -> tuple[Engine, ...]:
    """Return the engines that are installed; the cells of others are left out."""
    modules: dict[Engine, str] = {"bullet": "pybullet", "drake": "pydrake"}
    find = importlib.util.find_spec
    return ("mujoco", *(e for e in modules if find(modules[e]) is not None))


def _where(config: ReproduceConfig) -> list[str]:
    """Return the options of Snakemake: where the stages run, and how many at once."""
    if config.profile is None:
        return ["--cores", str(config.workers or len(os.sched_getaffinity(0)))]
    jobs = [] if config.workers is None else ["--jobs", str(config.workers)]
    return ["--profile", config.profile, *jobs]


def _write_trainings(root: Path, stages: Sequence[Stage]) -> None:
    for stage in stages:
        if stage.settings:
            folder = stage_folder(root, stage.name)
            folder.mkdir(parents=True, exist_ok=True)
            write_atomic(folder / TRAIN, tomlkit.dumps(dict(stage.settings)))


def _ports(path: Path) -> list[str]:
    """Return the ports of the served twin's client and control, as Snakemake's config.

    They are chosen once: a training that is resumed finds the arm where it was.

    Raises:
        ConfigError: The file is damaged.
    """
    kinds = {"client_port": socket.SOCK_DGRAM, "control_port": socket.SOCK_STREAM}
    if not path.exists():
        free = {name: _free_port(kind) for name, kind in kinds.items()}
        write_atomic(path, json.dumps(free) + "\n")
    kept = read_json(path)
    try:
        return [f"{name}={int(kept[name])}" for name in kinds]
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path} is damaged: remove it") from error


def _free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _load_twins(names: tuple[str, ...]) -> dict[str, Twin]:
    """Return the twins by the names that files and tables give them."""
    twins: dict[str, Twin] = {}
    for name in names:
        stem = Path(name).stem if name.endswith(".toml") else name
        if stem in twins:
            raise ConfigError(f"twin {stem!r} is given twice; give each once")
        twins[stem] = load_twin(name)
    return twins


def _draw_twins(first: int, count: int) -> dict[str, Twin]:
    return {f"sampled-{s}": sample_twin(s) for s in range(first, first + count)}


def _require_installed() -> None:
    """Say what is missing before anything is written."""
    needed = {"sbx": "learn", "cmaes": "identify", "snakemake": "reproduce"}
    missing = [extra for m, extra in needed.items() if not importlib.util.find_spec(m)]
    if missing:
        raise MissingDependencyError(
            f"the experiments need more packages: {install_command(*missing)}"
        )
