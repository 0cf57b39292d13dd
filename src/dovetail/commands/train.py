"""`dovetail train`: from settings to a policy file."""

import argparse
import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from dovetail.commands.help_page import sections_of
from dovetail.commands.unproven import warn_of_arm
from dovetail.control.limits import DeclaredErrors
from dovetail.control.sections import option_words, settings_in
from dovetail.learn.config import TrainConfig
from dovetail.learn.run_folder import settings_of
from dovetail.learn.searching import SEARCHING
from dovetail.learn.train import TrainResult, train
from dovetail.strangers import named_modules


@dataclass(frozen=True, kw_only=True)
class Train(TrainConfig):
    """Train a policy in a simulation or on an arm, and evaluate and export it."""

    def run(self, console: Console) -> int:
        """Train and say what came out and where it is."""
        model, env = self.dynamics.model, self.environment.config
        warn_of_arm(console, model, self.place.arm, env.place.robot, env.declared)
        for result in train(self, console):
            console.print(_describe(result, self), soft_wrap=True, highlight=False)
        return 0


GROUPS = sections_of(Train)
_OF_ARM = ("arm", "approach", "fixture", *settings_in(DeclaredErrors))
"""Options of a training on an arm that its evaluation needs, too."""


def defaults(words: list[str]) -> Train | None:
    """Return the settings that a command line changes, or None for the usual ones.

    Those of the run that it resumes: what else it says is then compared with them,
    option by option. Or those of a search, where it says `--doubt`.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--out", type=Path, nargs="?")
    parser.add_argument("--arm", nargs="?")
    parser.add_argument("--doubt", nargs="?")
    parser.add_argument("--teacher", nargs="?", default="corner")
    found, _ = parser.parse_known_args(words)
    if not found.resume or found.out is None:
        usual = dict(SEARCHING)
        if found.teacher not in ("none", "corner"):
            del usual["learning_starts"]  # logs are there already; chance finds nothing
        return None if found.doubt is None else Train.of(**usual)
    folder = found.out.expanduser().absolute()
    return Train.of(**settings_of(folder, found.arm), out=found.out, resume=True)


def _describe(result: TrainResult, config: TrainConfig) -> str:
    lines = [f"{result.policy}: {result.steps} steps in {result.wall_time:.0f} s"]
    if result.evaluation is not None:
        successes, episodes = (result.evaluation[k] for k in ("successes", "episodes"))
        low, high = result.evaluation["wilson_95"]
        arm, done = config.place.arm, config.environment.task_class.done_word
        place = f"on {arm}" if arm else "in the training simulation"
        lines.append(
            f"  {successes}/{episodes} {done} {place} "
            f"(Wilson 95 %: {100 * low:.1f}-{100 * high:.1f} %)"
        )
    lines.append(f"  next: {shlex.join(next_words(result.policy, config))}")
    return "\n".join(lines)


def next_words(policy: Path, config: TrainConfig) -> list[str]:
    """Return the command that tries a policy: what its file alone may not choose."""
    given = config.flat()
    words = ["dovetail", "evaluate", str(policy), *named_modules(given)]
    if given["arm"] is None:
        return [*words, "--twin", "medium"]
    usual = settings_in(TrainConfig)
    for name in _OF_ARM:
        if given[name] != usual[name].default:
            words += option_words(name, given[name])
    return words
