"""`dovetail doctor`: is this installation sound, is this arm to be trusted."""

from collections.abc import Iterator
from dataclasses import dataclass

from rich.console import Console

from dovetail.arms.address import FriAddress, parse_address
from dovetail.doctor import Check, run_checks
from dovetail.errors import ConfigError

_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red"}


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check this installation, or with --arm a robot at its first power-on."""

    arm: str | None = None
    """Arm to check in place of the installation: fri://HOST:PORT?KEY=VALUE&..."""
    yes: bool = False
    """Ask nothing before the arm is moved; only a simulated cabinet is pushed."""

    def run(self, console: Console) -> int:
        """Print every check; return 1 if something essential is broken."""
        checks = run_checks() if self.arm is None else self._check_arm(self.arm)
        is_broken = False
        for check in checks:
            colour = _COLOURS[check.status]
            console.print(
                f"[{colour}]{check.status:8}[/] {check.name:24} ",
                end="",
                highlight=False,
            )
            console.print(check.detail, markup=False, highlight=False, soft_wrap=True)
            is_broken |= check.is_essential and check.status != "ok"
        if is_broken:
            console.print("something essential is broken, see above")
        return int(is_broken)

    def _check_arm(self, text: str) -> Iterator[Check]:
        from dovetail.arm_checks import run_arm_checks

        address = parse_address(text)
        if not isinstance(address, FriAddress):
            raise ConfigError(
                f"the doctor checks arms behind FRI, not {text!r}; give "
                "fri://HOST:PORT?KEY=VALUE&..."
            )
        return run_arm_checks(address, None if self.yes else _ask)


def _ask(question: str) -> bool:
    """Ask at the terminal; an empty answer goes on, anything else ends the checks."""
    try:
        return input(f"{question}. Enter goes on, n ends: ").strip() == ""
    except EOFError as error:
        raise ConfigError(
            "nobody answers: run the doctor in a terminal, or with --yes"
        ) from error
