"""One evaluation for each value of a task's option, and a table with a row for each."""

import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from dovetail.envs.registered import make_task, task_class
from dovetail.errors import ConfigError, LimitError, PlantError
from dovetail.evaluation.config import EvaluationConfig
from dovetail.evaluation.evaluate import Evaluation, evaluate
from dovetail.evaluation.terminal import render_table
from dovetail.evaluation.transfer import Row, summarise
from dovetail.files import claim_output_folder, dated_folder, write_atomic
from dovetail.learn.policy import Policy, find_policy
from dovetail.learn.policy_env import known_env_id
from dovetail.learn.variation import varied_values
from dovetail.page import finite


class Each(NamedTuple):
    """Results for each value."""

    rows: list[Row]
    """One for each value, all its poses together; the last is the sum."""
    evaluations: list[Evaluation]
    """One for each value, in the same order."""
    folder: Path
    """A folder for each value is in it."""
    refused: dict[str, str]
    """Labels of values that could not be tried, and why."""


def evaluate_each(
    config: EvaluationConfig, vary: str, console: Console | None = None
) -> Each:
    """Evaluate a policy once for each value, and print a row for each.

    A value that its cell refuses, such as a part too deep for it, is named and left
    out.

    Args:
        config: What to do with each.
        vary: Option and its values, see `varied_values`.
        console: Where bars and tables go; None is the standard error.

    Raises:
        DovetailError: See `evaluate`; all values are read before the first try. Or
            every value is refused.
    """
    console = console or Console(stderr=True)
    policy = Policy.load(find_policy(config.policy))
    env_id = known_env_id(policy.metadata, config.env)
    values = varied_values(vary.split("&"), task_class(env_id))
    options = [config.task_options | each for each in values]
    labels = _labels([make_task(env_id, each).describe() for each in options])
    folder = claim_output_folder(config.out or dated_folder("results"))
    done: dict[str, Evaluation] = {}
    refused: dict[str, str] = {}
    for index, given in enumerate(options):
        label = labels[index]
        console.rule(label)
        each = replace(config, task_options=given, out=folder / f"{index:03d}")
        try:
            done[label] = evaluate(each, console)
        except (ConfigError, LimitError, PlantError) as error:
            refused[label] = str(error)
            console.print(f"not tried: {error}", soft_wrap=True)
    if not done:
        label, reason = next(iter(refused.items()))
        raise ConfigError(f"no value could be tried; {label}: {reason}")
    rows = [replace(one.rows[-1], label=label) for label, one in done.items()]
    outcomes = [outcome for one in done.values() for outcome in one.outcomes]
    names = [row.label for row in next(iter(done.values())).rows[:-1]]
    rows.append(summarise(outcomes, names)[-1])
    console.rule("all")
    console.print(render_table(rows))
    table = finite([row.numbers() for row in rows])  # no try may have succeeded
    write_atomic(folder / "table.json", json.dumps(table, allow_nan=False))
    if refused:
        console.print(f"not tried: {', '.join(refused)}", soft_wrap=True)
    return Each(rows, list(done.values()), folder, refused)


def _labels(described: list[list[str]]) -> list[str]:
    """Return a label for each task: its first words, if those tell them apart.

    If all its words do not either, the number of its folder stands before them.
    """
    short = [words[0] for words in described]
    whole = [", ".join(words) for words in described]
    numbered = [f"{index:03d} {words}" for index, words in enumerate(whole)]
    return next(
        labels for labels in (short, whole, numbered) if len(set(labels)) == len(labels)
    )
