"""`dovetail identify`: record scripted motions, fit a model to them, report on it."""

from pathlib import Path
from shlex import quote
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dovetail.commands.unproven import cell_of, warn_of_arm
from dovetail.identify.fit import FitConfig, FitResult, fit
from dovetail.identify.fit_folder import MODEL
from dovetail.identify.recorder import RecordConfig, record
from dovetail.identify.recording import Recording
from dovetail.settings import settings


@settings()
class IdentifyRecord(RecordConfig):
    """Play scripted motions on an arm, in free air or in contact, and log them."""

    def run(self, console: Console) -> int:
        """Record, and say what to do with it."""
        warn_of_arm(console, None, self.arm, cell_of(self), self)
        recording = record(self, console)
        cycles = sum(len(s.log) for s in recording.sequences)
        console.print(
            f"{self.out}: {len(recording.sequences)} sequences, {cycles} control "
            f"cycles of {1e3 * recording.period:g} ms, from {self.arm}\n"
            f"  next: dovetail identify fit {quote(str(self.out))} --out identified",
            soft_wrap=True,
            highlight=False,
        )
        return 0


@settings()
class IdentifyFit(FitConfig):
    """Fit gravity, masses and friction to a recording; write a model file."""

    log: Annotated[Path, tyro.conf.Positional]
    """Recording to fit, made by `dovetail identify record`."""

    def run(self, console: Console) -> int:
        """Fit, and say what came out and where it is."""
        result = fit(self, console)
        console.print(_table(result))
        for estimate in result.contact:
            console.print(
                f"contact: {estimate.sentence()}", soft_wrap=True, highlight=False
            )
        console.print(
            f"TCP's RMS error on the log: {1e3 * result.rms_before:.2f} mm before, "
            f"{1e3 * result.rms_after:.2f} mm after ({result.evaluations} simulated "
            f"logs, {result.wall_time:.0f} s)\n"
            f"  {self.out / MODEL}: for --twin of evaluate and demo, --model of train\n"
            f"  next: dovetail identify report {quote(str(self.out))} --held-out LOG",
            soft_wrap=True,
            highlight=False,
        )
        return 0


@settings()
class IdentifyReport:
    """Write figures, error and identifiability of a fit, and a go / no-go line."""

    fit: Annotated[Path, tyro.conf.Positional]
    """Folder of the fit."""
    held_out: Path | None = None
    """Recording that was not fitted, made with another --seed."""
    out: Path | None = None
    """Folder for the report; default `report` in the fit's folder."""

    def run(self, console: Console) -> int:
        """Write the report."""
        from dovetail.identify.report import write_identification_report

        held_out = None if self.held_out is None else Recording.load(self.held_out)
        out = self.out or self.fit / "report"
        write_identification_report(self.fit, held_out, out, console)
        return 0


def _table(result: FitResult) -> Table:
    table = Table()
    for name in ("parameter", "model", "fitted", "unit"):
        side = "left" if name in ("parameter", "unit") else "right"
        table.add_column(name, justify=side)
    for p, value in zip(result.parameters.parameters, result.vector, strict=True):
        table.add_row(p.name, f"{p.start:.4g}", f"{value:.4g}", p.unit)
    return table


Identify = (
    Annotated[IdentifyRecord, tyro.conf.subcommand("record")]
    | Annotated[IdentifyFit, tyro.conf.subcommand("fit")]
    | Annotated[IdentifyReport, tyro.conf.subcommand("report")]
)
