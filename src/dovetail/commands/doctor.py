"""`dovetail doctor`: is this installation sound, and how fast is it here."""

from dataclasses import dataclass

from rich.console import Console

from dovetail.doctor import run_checks

_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red"}


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check what is installed, that models agree, and how long a cycle takes."""

    def run(self, console: Console) -> int:
        """Print every check; return 1 if something essential is broken."""
        is_broken = False
        for check in run_checks():
            colour = _COLOURS[check.status]
            console.print(
                f"[{colour}]{check.status:8}[/] {check.name:24}",
                end="",
                highlight=False,
            )
            console.print(check.detail, markup=False, highlight=False, soft_wrap=True)
            is_broken |= check.is_essential and check.status != "ok"
        if is_broken:
            console.print("something essential is broken, see above")
        return int(is_broken)
