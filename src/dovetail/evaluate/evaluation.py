"""One evaluation from its settings to the written report."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from dovetail.errors import ConfigError, DovetailError, PolicyError
from dovetail.evaluate.config import (
    EvaluationConfig,
    environment_of,
    environment_options,
    fixture_poses,
    require_place,
)
from dovetail.evaluate.figures import draw_forces, draw_paths
from dovetail.evaluate.origin import (
    command_line,
    describe_settings,
    name_ground,
    other_period,
    provenance,
    shared_engine,
)
from dovetail.evaluate.outcome import Outcome
from dovetail.evaluate.perturbation import make_perturbed
from dovetail.evaluate.report import Report
from dovetail.evaluate.transfer import COLUMNS, Row, cells, summarise
from dovetail.evaluate.trials import plan_trials, run_trials
from dovetail.files import claim_output_folder, dated_folder, write_atomic
from dovetail.learn.policy import Policy, find_policy
from dovetail.tasks.task import Outline, Task


class Evaluation(NamedTuple):
    """What an evaluation gave and where it is."""

    rows: list[Row]
    outcomes: list[Outcome]
    report: Report
    folder: Path
    files: list[Path]


def evaluate(config: EvaluationConfig, console: Console) -> Evaluation:
    """Try the policy, print the table, and write everything into the folder.

    Args:
        config: What to do.
        console: Where the progress bar and the table go.

    Raises:
        DovetailError: A setting, the policy or the disk; see its message.
    """
    if config.workers < 1:
        raise ConfigError(f"workers is {config.workers}; needs at least 1")
    file = find_policy(config.policy)
    policy = Policy.load(file)
    poses = fixture_poses(config, policy.metadata)
    jobs = plan_trials(len(poses), config.tries, config.seed)
    options = environment_options(config, policy.metadata)
    perturbation = config.perturbation()
    env_id = environment_of(config, policy.metadata)
    make_env = partial(make_perturbed, env_id, perturbation, options)
    with closing(_inspect(config, make_env, policy)) as env:
        task: Task = env.unwrapped.task  # type: ignore[attr-defined]
        folder = claim_output_folder(config.out or dated_folder("results"))
        logs = folder / "logs" if config.keep_logs else None
        if logs is not None:
            logs.mkdir()
        started = datetime.now(UTC)
        # One process tries on the environment that is there: it may hold the only arm.
        make = make_env if config.workers > 1 else lambda: env
        load: Any = partial(Policy.load, file)
        trials = run_trials(
            make, load, jobs, poses=poses, logs=logs, workers=config.workers
        )
        ground = name_ground(config)
        parts = [
            file.stem,
            *task.describe(),
            *perturbation.describe(),
            f"on {ground}",
            f"control period {1e3 * options['period']:g} ms",
        ]
        title, names = ", ".join(parts), [pose.name for pose in poses]
        outcomes = _show(trials, len(jobs), title, names, console)
    rows = summarise(outcomes, names)
    report = Report(
        title=title,
        ground=ground,
        period=options["period"],
        note="; ".join(
            filter(
                None,
                (
                    other_period(options["period"], policy.metadata),
                    shared_engine(config, policy.metadata),
                ),
            )
        ),
        rows=rows,
        outcomes=outcomes,
        config=describe_settings(replace(config, out=folder), options, poses),
        policy=policy.metadata,
        provenance=provenance(started),
        command=command_line(config),
    )
    _print(report, options["tare"], console)
    files = write_report(report, folder, task.outline())
    return Evaluation(
        rows, outcomes, report, folder, [*files, *([logs] if logs else [])]
    )


def _print(report: Report, is_tared: bool, console: Console) -> None:
    if report.note:
        console.print(f"note: {report.note}", soft_wrap=True)
    console.print(report.title, soft_wrap=True)  # a table's title would be broken
    console.print(render_table(report.rows))
    outcomes = report.outcomes
    if tares := [o.tare[:3] for o in outcomes if is_tared and any(o.tare)]:
        x, y, z = np.mean(tares, axis=0)
        console.print(f"mean tare: f* {x:.2f} {y:.2f} {z:.2f} m/s2 along x y z")
    if stopped := Counter(o.stopped for o in outcomes if o.stopped):
        reasons = ", ".join(f"{reason} ({n})" for reason, n in stopped.most_common())
        console.print(f"the arm ended {stopped.total()} tries itself: {reasons}")


def _inspect(
    config: EvaluationConfig, make_env: Callable[[], gym.Env], policy: Policy
) -> gym.Env:
    """Return an environment; says what is wrong before anything is written."""
    try:
        env = make_env()
    except (TypeError, gym.error.Error) as error:
        raise PolicyError(
            f"the policy's JSON file does not describe a known environment: {error}"
        ) from error
    try:
        require_place(config, can_place=env.unwrapped.places_fixture)  # type: ignore[attr-defined]
        pose = fixture_poses(config, policy.metadata)[0].pose()
        observation, _ = env.reset(seed=config.seed, options={"fixture": pose})
        env.unwrapped.scaling.require_same(policy.metadata.get("observation", {}))  # type: ignore[attr-defined]
        action = policy(observation)
        if action.shape != env.action_space.shape:
            raise PolicyError(
                f"the policy gives actions of shape {action.shape}, its environment "
                f"takes {env.action_space.shape}: it was trained for another task"
            )
    except BaseException:
        env.close()
        raise
    return env


def _show(
    trials: Iterator[Outcome],
    count: int,
    title: str,
    names: list[str],
    console: Console,
) -> list[Outcome]:
    """Run the tries under a progress bar; if they are cut short, show what there is."""
    outcomes: list[Outcome] = []
    try:
        _collect(trials, count, outcomes, console)
    except (DovetailError, KeyboardInterrupt):
        if outcomes:
            rows = summarise(outcomes, names[: outcomes[-1].pose + 1])
            part = f"partial: {len(outcomes)} of {count} tries, no report"
            console.print(f"{title} ({part})", soft_wrap=True)
            console.print(render_table(rows))
        raise
    return outcomes


def _collect(
    trials: Iterator[Outcome], count: int, outcomes: list[Outcome], console: Console
) -> None:
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[inserted]} inserted"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as progress:
        bar = progress.add_task("tries", total=count, inserted=0)
        for outcome in trials:
            outcomes.append(outcome)
            progress.update(bar, advance=1, inserted=sum(o.success for o in outcomes))


def render_table(rows: Sequence[Row]) -> Table:
    """Return the transfer table for a terminal, without its title."""
    table = Table(box=SIMPLE_HEAD)
    table.pad_edge = False
    lines = [cells(row) for row in rows]
    for name, *entries in zip(COLUMNS, *lines, strict=True):
        words = [*name.split(), *entries]  # headings wrap, numbers do not
        side = "left" if name == COLUMNS[0] else "right"
        table.add_column(name, justify=side, width=max(map(len, words)))
    for line in lines[:-1]:
        table.add_row(*line)
    table.add_section()
    table.add_row(*lines[-1], style="bold")
    return table


def write_report(report: Report, folder: Path, outline: Outline | None) -> list[Path]:
    """Write figures, JSON and HTML, the HTML last.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    labels = [row.label for row in report.rows[:-1]]
    paths = draw_paths(report.outcomes, labels, outline=outline, title=report.title)
    captions = {"Paths of the peg's tip": paths}
    files = [write_atomic(folder / "paths.png", paths)]
    if not math.isnan(report.rows[-1].force_peak):
        forces = captions["Contact force"] = draw_forces(report.outcomes)
        files.append(write_atomic(folder / "forces.png", forces))
    return [
        *files,
        write_atomic(folder / "report.json", report.to_json()),
        write_atomic(folder / "report.html", report.to_html(captions)),
    ]
