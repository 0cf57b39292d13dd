"""`dovetail evaluate`: any policy, any plant or twin, any held part."""

from typing import Annotated

import tyro
from rich.console import Console

from dovetail.commands.unproven import warn_of_arm
from dovetail.evaluation.each import evaluate_each
from dovetail.evaluation.evaluate import Evaluation, EvaluationConfig, evaluate
from dovetail.settings import names_in, settings


@settings()
class Evaluate(EvaluationConfig):
    """Try a policy at three fixture poses; write table, figures, report and logs."""

    policy: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="POLICY")]
    """Policy: a file (.safetensors or .json), a training's folder, or the name of a
    shipped one; `dovetail export` makes one of a model.zip."""

    vary: str | None = None
    """Option of the task and values to try one after the other, NAME=A,B.
    Of parts, part=FOLDER is every part in a folder. There is a row for each."""

    def run(self, console: Console) -> int:
        """Evaluate and say where everything is."""
        warn_of_arm(console, self.twin, self.arm, declared=self)
        names = names_in(EvaluationConfig)
        config = EvaluationConfig(**{name: vars(self)[name] for name in names})
        if self.vary is None:
            print_files(evaluate(config, console), console)
        else:
            each = evaluate_each(config, self.vary, console)
            console.print(f"written to {each.folder}", soft_wrap=True)
            return 1 if each.refused else 0
        return 0


COMMON = (
    *("policy", "twin", "arm", "plant", "env", "task_options", "tracker", "fixture"),
    *("cell", "tries", "seed", "fixture_shift", "push", "search"),
    *("tare", "period", "video", "out"),
)
"""Settings that `--help` lists."""


def print_files(evaluation: Evaluation, console: Console) -> None:
    """Say where everything was written."""
    console.print(f"written to {evaluation.folder}:", soft_wrap=True)
    for path in evaluation.files:
        console.print(f"  {path.relative_to(evaluation.folder)}", highlight=False)
