"""`dovetail train`: from settings to a policy file."""

import argparse
import shlex
from pathlib import Path
from typing import Any

from rich.console import Console

from dovetail.commands.unproven import cell_of, warn_of_arm
from dovetail.control.limits import DeclaredErrors
from dovetail.envs.registered import task_class
from dovetail.errors import ConfigError
from dovetail.learn.config import TrainConfig
from dovetail.learn.config_file import find_recipe, read_settings
from dovetail.learn.run_folder import run_config
from dovetail.learn.train import TrainResult, train
from dovetail.options import option_words
from dovetail.plugins import named_modules
from dovetail.settings import defaults_of, names_in, settings, values_of
from dovetail.tasks.shipped import DEFAULT_ENV


@settings()
class Train(TrainConfig):
    """Train a policy in a simulation or on an arm, and evaluate and export it."""

    recipe: str | None = None
    """Settings to begin with: the name of a shipped recipe, such as search, or a file
    of your own. What `config` and the command line say goes before it."""
    config: Path | None = None
    """Settings in a TOML file, or those of a run by its folder. The command line goes
    before it."""

    def run(self, console: Console) -> int:
        """Train and say what came out and where it is."""
        warn_of_arm(console, self.model, self.arm, cell_of(self), self)
        for result in train(self, console):
            console.print(_describe(result, self), soft_wrap=True, highlight=False)
        return 0


COMMON = (
    *("recipe", "config", "env", "task_options", "robot", "cell", "plant", "model"),
    "arm",
    *("from_policy", "demos", "steps", "seed", "out", "resume", "period", "tracker"),
    *("max_steps", "near_speed", "near_press", "doubt", "algorithm"),
)
"""Settings that `--help` lists."""
_OF_ARM = ("arm", "approach", "fixture", *names_in(DeclaredErrors))
"""Options of a training on an arm that its evaluation needs, too."""
_TAUGHT = ("teacher", "teacher_noise", "teacher_share")
"""Settings of a recipe that a policy to start from takes the place of."""


def given_before(words: list[str]) -> dict[str, Any]:
    """Return the settings that a command line changes.

    They are those of the run that it resumes: what else it says is then compared with
    them. Or what the task needs beside the usual settings, then its recipe and its
    file. A recipe's teacher is left out where the run starts from a policy.

    Raises:
        ConfigError: See `read_settings`; or a recipe or a file beside a run.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--resume", action="store_true")
    for name in ("--out", "--arm", "--recipe", "--config", "--env", "--from-policy"):
        parser.add_argument(name, nargs="?")
    found, _ = parser.parse_known_args(words)
    if found.resume and (found.recipe or found.config):
        raise ConfigError(
            "a run that is resumed has its own settings: leave --recipe and --config "
            "out, or leave --resume out and choose another --out",
            name="resume",
        )
    if found.resume and found.out is not None:
        folder = Path(found.out).expanduser().absolute()
        return values_of(run_config(folder, found.arm)) | {"out": Path(found.out)}
    given: dict[str, Any] = {}
    if found.recipe is not None:
        given |= read_settings(find_recipe(found.recipe), found.arm)
        if found.from_policy is not None:  # what it knows needs no teacher
            given = {name: given[name] for name in given if name not in _TAUGHT}
    if found.config is not None:
        given |= read_settings(Path(found.config), found.arm)
    task = task_class(found.env or given.get("env", DEFAULT_ENV))
    return {**task.training, **given}


def _describe(result: TrainResult, config: TrainConfig) -> str:
    lines = [f"{result.policy}: {result.steps} steps in {result.wall_time:.0f} s"]
    lines += [f"  ended by {result.end}"] if result.end else []
    if result.evaluation is not None:
        successes, episodes = (result.evaluation[k] for k in ("successes", "episodes"))
        low, high = result.evaluation["wilson_95"]
        arm, done = config.arm, config.task_class.done_word
        place = f"on {arm}" if arm else "in the training simulation"
        lines.append(
            f"  {successes}/{episodes} {done} {place} "
            f"(Wilson 95 %: {100 * low:.1f}-{100 * high:.1f} %)"
        )
    lines.append(f"  next: {shlex.join(next_words(result.policy, config))}")
    return "\n".join(lines)


def next_words(policy: Path, config: TrainConfig) -> list[str]:
    """Return the command that tries a policy: what its file alone may not choose."""
    given = values_of(config)
    words = ["dovetail", "evaluate", str(policy), *named_modules(given)]
    if given["arm"] is None:
        return [*words, "--twin", "medium"]
    usual = defaults_of(TrainConfig)
    for name in _OF_ARM:
        if given[name] != usual[name]:
            words += option_words(name, given[name])
    return words
