"""One evaluation from its settings to the written report."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from rich.console import Console

from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_inside
from dovetail.evaluation.config import (
    EvaluationConfig,
    environment_options,
    fixture_poses,
    other_cell,
    require_place,
)
from dovetail.evaluation.figures import draw_forces, draw_paths
from dovetail.evaluation.measured import outside_measured
from dovetail.evaluation.origin import (
    describe_origin,
    lacking_inertia,
    name_ground,
    other_period,
    other_robot,
    shared_engine,
)
from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.perturbation import make_perturbed
from dovetail.evaluation.report import Report
from dovetail.evaluation.search_figure import draw_search
from dovetail.evaluation.terminal import print_notes, render_table, run_shown
from dovetail.evaluation.transfer import Row, summarise
from dovetail.evaluation.trials import film_name, plan_trials, run_trials
from dovetail.files import claim_output_folder, dated_folder, write_atomic
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import known_env_id, require_contact_accepted
from dovetail.learn.spaces import require_spaces
from dovetail.robots.find import DEFAULT_ROBOT, robot_label
from dovetail.search.script import CornerScript
from dovetail.settings import in_count
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.tasks.task import Task
from dovetail.view.renderer import Renderer
from dovetail.workcell.parts import Part
from dovetail.workcell.workcell import Workcell

_WORKERS_MAX = 256


class Evaluation(NamedTuple):
    """Result of an evaluation, and its files."""

    rows: list[Row]
    outcomes: list[Outcome]
    report: Report
    folder: Path
    files: list[Path]


def evaluate(config: EvaluationConfig, console: Console | None = None) -> Evaluation:
    """Try the policy, print the table, and write everything into the folder.

    Args:
        config: What to do.
        console: Where the progress bar and the table go; None is the standard error.

    Raises:
        DovetailError: A setting, the policy or the disk; see its message.
    """
    console = console or Console(stderr=True)
    in_count("workers", config.workers, 1, _WORKERS_MAX, "processes")
    file = find_policy(config.policy)
    policy = Policy.load(file)
    poses = fixture_poses(config, policy.metadata)
    jobs = plan_trials(len(poses), config.tries, config.seed)
    options = environment_options(config, policy.metadata)
    perturbation = config.perturbation
    lax = require_contact_accepted(options, config.arm, is_given=config.accept_contact)
    env_id = known_env_id(policy.metadata, config.env)
    make_env = partial(make_perturbed, env_id, perturbation, options)
    with closing(_inspect(config, make_env, policy)) as env:
        core = require_contact_env(env)
        task = core.task
        measured = outside_measured(file, config, options)
        found = _notes(config, options, policy.metadata, core.cell)
        notes = [lax, measured, *found]
        print_notes(notes, console)  # before anything moves
        folder = claim_output_folder(config.out or dated_folder("results"))
        logs = folder / "logs" if config.keep_logs else None
        if logs is not None:
            logs.mkdir()
        started = datetime.now(UTC)
        # One process tries on the environment that is there: it may hold the only arm.
        make = make_env if config.workers > 1 else lambda: env
        is_script = config.search != "none"
        load: Any = CornerScript if is_script else partial(Policy.load, file)
        trials = run_trials(
            make,
            load,
            jobs,
            poses=poses,
            logs=logs,
            films=folder if config.video else None,
            workers=config.workers,
        )
        title = _title(file.stem, task, config, options)
        names = [pose.name for pose in poses]
        outcomes = run_shown(trials, len(jobs), title, names, task.done_word, console)
    rows = summarise(outcomes, names)
    unfilmed = dict.fromkeys(o.files.film_error for o in outcomes)
    print_notes(unfilmed, console)
    report = Report(
        title=title,
        ground=name_ground(config),
        period=options["period"],
        notes=[note for note in (*notes, *unfilmed) if note],
        rows=rows,
        outcomes=outcomes,
        done_word=task.done_word,
        origin=describe_origin(
            replace(config, out=folder), options, poses, policy.metadata, started
        ),
    )
    _print(report, console)
    made = _write(config, report, folder, poses, task.fixture(0.0))
    return Evaluation(
        rows, outcomes, report, folder, [*made, *([logs] if logs else [])]
    )


def _write(
    config: EvaluationConfig,
    report: Report,
    folder: Path,
    poses: Sequence[FixturePose],
    fixture: Part,
) -> list[Path]:
    """Write the report with the figures and films that were asked for."""
    films = [folder / film_name(pose) for pose in poses] if config.video else []
    searched = None
    if config.perturbation.fixture_shift:
        searched = draw_search(report, poses, fixture)
    return write_report(report, folder, fixture, films, searched)


def _title(
    policy: str, task: Task, config: EvaluationConfig, options: Mapping[str, Any]
) -> str:
    robot = robot_label(options.get("robot", DEFAULT_ROBOT))
    parts = [
        policy,
        *([] if robot == DEFAULT_ROBOT else [f"robot {robot}"]),
        *task.describe(),
        *config.perturbation.describe(),
        f"on {name_ground(config)}",
        f"control period {1e3 * options['period']:g} ms",
    ]
    return ", ".join(parts)


def _notes(
    config: EvaluationConfig,
    options: Mapping[str, Any],
    policy: Mapping[str, Any],
    cell: Workcell,
) -> list[str]:
    """Return what a reader of the numbers must know; an empty text for nothing."""
    return [
        other_period(options["period"], policy),
        shared_engine(config, policy, cell),
        other_cell(config, policy),
        other_robot(options, policy),
        lacking_inertia(config, cell.robot),
        *cell.notes,
    ]


def _print(report: Report, console: Console) -> None:
    console.print(report.title, soft_wrap=True)  # a table's title would be broken
    console.print(render_table(report.rows))
    told = [o.conditions.tare for o in report.outcomes]
    if tares := [t[:3] for t in told if any(t)]:
        x, y, z = np.mean(tares, axis=0)
        console.print(f"mean tare: f* {x:.2f} {y:.2f} {z:.2f} m/s2 along x y z")
    stops = [o.stop for o in report.outcomes if o.stop.reason]
    if stopped := Counter(stop.reason for stop in stops):
        reasons = ", ".join(f"{reason} ({n})" for reason, n in stopped.most_common())
        console.print(f"{stopped.total()} tries ended before their time: {reasons}")
        console.print(f"  the first: {stops[0].text}", soft_wrap=True)


def _inspect(
    config: EvaluationConfig, make_env: Callable[[], gym.Env], policy: Policy
) -> gym.Env:
    """Return an environment; says what is wrong before anything is written."""
    env = make_env()
    try:
        if config.video:
            Renderer(require_contact_env(env).cell).close()
        core = require_contact_env(env)
        require_place(config, can_place=core.places_fixture)
        for pose in fixture_poses(config, policy.metadata):
            require_inside(core.task, core.cell, core.arm, pose.pose())
        if config.search != "none":
            CornerScript().take(require_contact_env(env))
            return env
        seen = np.zeros(env.observation_space.shape or ())
        policy.require_size(seen, env.action_space.shape or ())
        require_spaces(policy.metadata, env)
    except BaseException:
        env.close()
        raise
    return env


def write_report(
    report: Report,
    folder: Path,
    fixture: Part,
    films: Sequence[Path] = (),
    searched: bytes | None = None,
) -> list[Path]:
    """Write figures, JSON and HTML, the HTML last.

    Args:
        report: What was found.
        folder: Where to.
        fixture: In its own frame.
        films: Animated GIFs that are there; one that is not, as its try never began,
            is left out.
        searched: Figure of the part's paths over a fixture that was moved unseen.

    Raises:
        LogError: The disk is full or the folder is not writable.
    """
    labels = [row.label for row in report.rows[:-1]]
    paths = draw_paths(
        report.outcomes,
        labels,
        fixture=fixture,
        title=report.title,
        done_word=report.done_word,
    )
    captions = {"Paths of the tool": paths}
    files = [write_atomic(folder / "paths.png", paths)]
    if searched is not None:
        captions["Where it searched, from above"] = searched
        files.append(write_atomic(folder / "search.png", searched))
    if not math.isnan(report.rows[-1].force.peak):
        forces = captions["Contact force"] = draw_forces(report.outcomes)
        files.append(write_atomic(folder / "forces.png", forces))
    for film in filter(Path.is_file, films):
        captions[f"First try at {film.stem}"] = film.read_bytes()
        files.append(film)
    return [
        *files,
        write_atomic(folder / "report.json", report.to_json()),
        write_atomic(folder / "report.html", report.to_html(captions)),
    ]
