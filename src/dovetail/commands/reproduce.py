"""`dovetail reproduce`: the paper's experiments in one command."""

from dataclasses import dataclass

from rich.console import Console

from dovetail.reproduce.folder import LOG, stage_folder
from dovetail.reproduce.run import ReproduceConfig, Reproduction, reproduce


@dataclass(frozen=True, kw_only=True)
class Reproduce(ReproduceConfig):
    """Run the paper's experiments; the same command again goes on where it stopped."""

    def run(self, console: Console) -> int:
        """Run and say where everything is; 1 where a stage failed."""
        try:
            result = reproduce(self, console)
        except KeyboardInterrupt:
            console.print(f"stopped; {_AGAIN}", soft_wrap=True, highlight=False)
            raise
        console.print(f"written to {result.root}:", soft_wrap=True, highlight=False)
        for path in result.files:
            console.print(f"  {path.relative_to(result.root)}", highlight=False)
        if not result.tally.failed:
            return 0
        console.print(describe_failures(result), soft_wrap=True, highlight=False)
        return 1


_AGAIN = "the same command goes on where it stopped"


def describe_failures(result: Reproduction) -> str:
    """Say which stages failed and why, where to read more, and how to go on."""
    tally = result.tally
    lines = [f"{len(tally.failed)} stages failed:"]
    for name, reason in tally.failed.items():
        log = stage_folder(result.root, name) / LOG
        lines += [f"  {name}: {reason}", f"    log: {log}"]
    if tally.left_out:
        names = ", ".join(tally.left_out)
        lines.append(
            f"{len(tally.left_out)} stages that need them were left out: {names}"
        )
    return "\n".join([*lines, f"the report says what is missing; {_AGAIN}"])
