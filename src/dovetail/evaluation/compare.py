"""Comparison of policies: the same tries for each, ended when the answer is clear."""

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from dovetail.arms.address import parse_address
from dovetail.control.limits import DeclaredErrors
from dovetail.envs.unwrapped import require_contact_env
from dovetail.errors import ConfigError, DovetailError
from dovetail.evaluation.config import (
    EvaluationConfig,
    TriedPlaceConfig,
    TriedTaskConfig,
    environment_options,
    fixture_poses,
    require_place,
)
from dovetail.evaluation.measured import outside_measured
from dovetail.evaluation.origin import (
    lacking_inertia,
    name_ground,
    other_robot,
    provenance,
)
from dovetail.evaluation.outcome import Outcome
from dovetail.evaluation.paired_test import (
    TRIES_MAX,
)
from dovetail.evaluation.perturbation import Perturbation, make_perturbed
from dovetail.evaluation.race import PairResult, Race
from dovetail.evaluation.race_report import write_comparison
from dovetail.evaluation.terminal import print_notes, render_rows
from dovetail.evaluation.transfer import Row
from dovetail.evaluation.trials import plan_trials, run_trials
from dovetail.files import claim_output_folder, dated_folder
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import known_env_id, require_contact_accepted
from dovetail.learn.spaces import require_spaces
from dovetail.robots.robot import Robot
from dovetail.robots.same_robot import difference
from dovetail.settings import Range, names_in, settings, values_of
from dovetail.tasks.options import option_types

_BLOCK = 5
"""Tries of one policy before the next one gets an arm that only one can hold."""


@settings()
class ComparedTriesConfig:
    """The tries and their results."""

    tries: Annotated[int, Range(1, TRIES_MAX, "tries")] = 200
    """Most tries of each policy, all poses together."""
    error_rate: Annotated[float, Range(1e-4, 0.5, "1")] = 0.05
    """Chance of naming a better one where all are equally good."""
    seed: int = 0
    """Seed of starts and noise, 0 or more."""
    workers: int = 1
    """Processes for each policy that share the tries."""
    out: Path | None = None
    """Folder for table, figure and report, new or empty. Default a new one, by the
    time, in results."""


@settings()
class ComparisonConfig(
    TriedTaskConfig, TriedPlaceConfig, DeclaredErrors, Perturbation, ComparedTriesConfig
):
    """Settings of a comparison: policies, place, disturbances and tries."""

    policies: tuple[str, ...]
    """Two or more policies: files, a training's folder, or shipped names."""


class Contender(NamedTuple):
    """A policy of a comparison, and the environment that it is tried in."""

    name: str
    """Name in tables: the file's, with its folder where two are alike."""
    file: Path
    config: EvaluationConfig
    policy: Policy
    options: dict[str, Any]
    """Keyword arguments of the environment."""
    env_id: str


class Comparison(NamedTuple):
    """Result of a comparison, and its files."""

    rows: list[Row]
    """Each policy's tries."""
    results: list[PairResult]
    """Every two of the policies, in the order in which they were given."""
    folder: Path
    files: list[Path]


def compare(config: ComparisonConfig, console: Console | None = None) -> Comparison:
    """Try policies from the same starts until it is clear which is better.

    A policy's tries end when it is told apart from every other one, or when the tries
    that are left can tell no more. With k policies each pair has its share of the error
    rate, `error_rate` / (k (k - 1) / 2).

    Args:
        config: What to do.
        console: Where progress and table go; None is the standard error.

    Raises:
        ConfigError: Fewer than two policies, policies of different tasks, or a setting
            that is out of range.
    """
    console = console or Console(stderr=True)
    contenders = _contenders(config)
    checked = {one.name: _check(one, console) for one in contenders}
    _require_same_task({name: task for name, (task, _) in checked.items()})
    robots = {name: robot for name, (_, robot) in checked.items()}
    print_notes(_notes_of(robots, contenders[0].config), console)
    folder = claim_output_folder(config.out or dated_folder("results"))
    started = datetime.now(UTC)
    names = [one.name for one in contenders]
    race = Race(names, config.tries, config.error_rate)
    try:
        _run(race, contenders, config, console)
    except (DovetailError, KeyboardInterrupt):
        if race.has_all():
            console.print(render_rows(race.rows(), "policy"))
            console.print("cut short: no report")
        raise
    ground = name_ground(contenders[0].config)
    done = contenders[0].config.perturbation.describe()
    title = f"{', '.join([*names, *done])} on {ground}"
    console.print(title, soft_wrap=True)
    console.print(render_rows(race.rows(), "policy"))
    for result in race.results():
        console.print(result.sentence(), soft_wrap=True)
    about = provenance(started)
    files = write_comparison(race, title, values_of(config), about, folder)
    return Comparison(race.rows(), race.results(), folder, files)


def _contenders(config: ComparisonConfig) -> list[Contender]:
    """Return the policies, loaded.

    Raises:
        ConfigError: Fewer than two, or one twice.
    """
    if len(config.policies) < 2:
        raise ConfigError(
            f"policies: {len(config.policies)} given; a comparison needs two or more",
            name="policies",
            value=config.policies,
        )
    files = [find_policy(name) for name in config.policies]
    if len(set(files)) < len(files):
        raise ConfigError(
            f"policies: one is given twice in {', '.join(config.policies)}",
            name="policies",
            value=config.policies,
        )
    names = set(names_in(EvaluationConfig)) & set(names_in(ComparisonConfig))
    shared: dict[str, Any] = {n: vars(config)[n] for n in names - {"tries", "out"}}
    contenders = []
    stems = [file.stem for file in files]
    for given, file in zip(config.policies, files, strict=True):
        one = EvaluationConfig(policy=given, **shared)
        policy = Policy.load(file)
        options = environment_options(one, policy.metadata)
        env_id = known_env_id(policy.metadata, config.env)
        name = file.stem if stems.count(file.stem) == 1 else given
        contenders.append(Contender(name, file, one, policy, options, env_id))
    return contenders


def _require_same_task(tasks: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse to compare tries of different tasks.

    Args:
        tasks: For each policy what its task is made of.

    Raises:
        ConfigError: Names what differs, and how to try all on one task.
    """
    (one, known), *others = tasks.items()
    for other, own in others:
        for name, value in known.items():
            if own.get(name) == value:
                continue
            way = f"give --{name.replace('_', '-')} to try both on the same task"
            if name == "env":
                way = "only policies of the same task can be compared"
            raise ConfigError(
                f"{name} is {value} for {one} and {own.get(name)} for {other}; {way}",
                name=name,
                value=own.get(name),
            )


def _notes_of(robots: Mapping[str, Robot], config: EvaluationConfig) -> list[str]:
    """Return the notes about the one robot of all tries.

    Args:
        robots: For each policy the bare robot of its tries.
        config: Settings of the tries of any of them.

    Raises:
        ConfigError: Two of one name are not the same robot.
    """
    (one, robot), *others = robots.items()
    for other, found in others:
        if different := difference(robot, found):
            raise ConfigError(
                f"robot {robot.name} is another one for {other} than for {one}: "
                f"{different}; give --robot to try both on the same",
                name="robot",
                value=found.name,
            )
    return list(filter(None, (lacking_inertia(config, robot), *robot.all_notes)))


def _check(one: Contender, console: Console) -> tuple[dict[str, Any], Robot]:
    """Say before anything moves what is wrong, or lax, with a policy.

    Returns:
        What its task is made of, by the names of options, and the bare robot.

    Raises:
        DovetailError: The policy does not fit its environment, or the arm is missing.
    """
    lax = require_contact_accepted(
        one.options, one.config.arm, is_given=one.config.accept_contact
    )
    measured = outside_measured(one.file, one.config, one.options)
    other = other_robot(one.options, one.policy.metadata)
    said = [f"{one.name}: {text}" for text in (lax, measured, other) if text]
    print_notes(said, console)
    with closing(_make_env(one)()) as env:
        core = require_contact_env(env)
        require_place(one.config, can_place=core.places_fixture)
        require_spaces(one.policy.metadata, env)
        task, robot = core.task, core.cell.robot
        cell = core.cell.own or "the task's own"
        options = {name: vars(task)[name] for name in option_types(type(task))}
    made = {"env": one.env_id, "robot": robot.name, "cell": cell, **options}
    return made, robot


def _make_env(one: Contender) -> partial[Any]:
    return partial(make_perturbed, one.env_id, one.config.perturbation, one.options)


def _run(
    race: Race,
    contenders: Sequence[Contender],
    config: ComparisonConfig,
    console: Console,
) -> None:
    """Try the policies in turn, under one bar for each."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    done = TextColumn("{task.fields[done]} succeeded")
    with ExitStack() as stack, Progress(*columns, done, console=console) as progress:
        bars = [
            progress.add_task(c.name, total=config.tries, done=0) for c in contenders
        ]
        rounds = [stack.enter_context(closing(_rounds(c, config))) for c in contenders]
        while any(race.is_open(index) for index in range(len(contenders))):
            trying = [i for i in range(len(contenders)) if race.is_open(i)]
            for index in trying:
                race.add(index, next(rounds[index]))
                tried = race.outcomes[index]
                succeeded = sum(o.success for o in tried)
                progress.update(bars[index], completed=len(tried), done=succeeded)


def _rounds(one: Contender, config: ComparisonConfig) -> Generator[list[Outcome]]:
    """Yield a policy's tries, one by one in this process.

    An arm elsewhere is held by one environment at a time: it is left after a block.
    """
    poses = fixture_poses(one.config, one.policy.metadata)
    attempts = math.ceil(config.tries / len(poses))
    jobs = plan_trials(len(poses), attempts, config.seed)
    jobs = sorted(jobs, key=lambda job: job.attempt)[: config.tries]
    run = partial(
        run_trials,
        _make_env(one),
        partial(Policy.load, one.file),
        poses=poses,
        workers=config.workers,
    )
    if config.arm is None or parse_address(config.arm).is_here:
        with closing(run(jobs)) as tries:
            yield from ([outcome] for outcome in tries)
        return
    for begin in range(0, len(jobs), _BLOCK):
        yield list(run(jobs[begin : begin + _BLOCK]))
