"""`dovetail compare`: several policies from the same starts."""

from typing import Annotated

import tyro
from rich.console import Console

from dovetail.commands.unproven import warn_of_arm
from dovetail.evaluation.compare import ComparisonConfig, compare
from dovetail.settings import settings


@settings()
class Compare(ComparisonConfig):
    """Say which of several policies is better, with as few tries as that needs."""

    policies: Annotated[
        tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="POLICY ...")
    ]
    """Two or more policies: files, a training's folder, or shipped names."""

    def run(self, console: Console) -> int:
        """Compare and say where everything is."""
        warn_of_arm(console, self.twin, self.arm, declared=self)
        result = compare(self, console)
        console.print(f"written to {result.folder}:", soft_wrap=True)
        for path in result.files:
            console.print(f"  {path.relative_to(result.folder)}", highlight=False)
        return 0


COMMON = (
    *("policies", "twin", "arm", "plant", "env", "task_options", "tracker", "fixture"),
    *("cell", "tries", "error_rate", "seed", "fixture_shift", "push"),
    *("tare", "period", "accept_contact", "out"),
)
"""Settings that `--help` lists."""
