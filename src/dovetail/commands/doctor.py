"""`dovetail doctor`: is this installation sound, is this arm to be trusted."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

from rich.console import Console

from dovetail.arms.address import parse_address
from dovetail.arms.franka.arm import FrankaAddress
from dovetail.arms.fri_arm import FriAddress
from dovetail.arms.local_address import LocalAddress
from dovetail.commands.asking import ask
from dovetail.commands.unproven import cell_of, warn_of_arm
from dovetail.control.limits import DeclaredErrors
from dovetail.control.period import DEFAULT_PERIOD, require_period
from dovetail.control.proven import DECLARED
from dovetail.doctor.check import Check
from dovetail.doctor.installation import run_checks
from dovetail.envs.registered import find_cell
from dovetail.errors import ConfigError
from dovetail.options import Delay, Period
from dovetail.printable import printable
from dovetail.robots.find import DEFAULT_ROBOT
from dovetail.workcell.cell_config import CellFile

_HERE = "it belongs to the checks of an arm: give --arm ADDRESS with it"
_CAMERA = "it belongs to the checks of an arm, without --tracker"
_OWN = "the arm's address has its own: fri://HOST:PORT?period=1ms, franka:// 1 ms"
_COLOURS = {"ok": "green", "missing": "yellow", "broken": "red"}


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Check this installation, or with --arm a robot at its first power-on."""

    arm: str | None = None
    """Arm to check in place of the installation: fri://HOST:PORT?KEY=VALUE&...,
    franka://HOST, or a simulated one, as mujoco or twin:medium."""
    tracker: str | None = None
    """Camera file to check: pictures, exposure, rate, and its delay by moving the arm a
    little; a simulated camera needs no --arm."""
    yes: bool = False
    """Ask nothing before the arm is moved; only a simulated cabinet is pushed."""
    robot: str = DEFAULT_ROBOT
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION."""
    cell: CellFile = None
    """Cell file of the arm: table, tool and walls."""
    delay: Delay = DECLARED["delay"]
    """Largest delay of the loop that is declared for this arm, with its unit."""
    payload_error: float = DECLARED["payload_error"]
    """Largest mass that its load data are declared to miss [kg]."""
    period: Period = DEFAULT_PERIOD
    """Control period of a simulated arm: 1ms, 2ms, 2.5ms or 5ms; fri:// has its own
    key."""

    def run(self, console: Console) -> int:
        """Print every check; return 1 if something essential is broken.

        Raises:
            ConfigError: An option that these checks do not use, or a wrong one.
        """
        self._require_used()
        warn_of_arm(console, None, self.arm, cell_of(self))
        if self.tracker is not None:
            checks = self._check_camera(self.tracker)
        else:
            checks = run_checks() if self.arm is None else self._check_arm(self.arm)
        is_broken = False
        for check in checks:
            colour = _COLOURS[check.status]
            console.print(
                f"[{colour}]{check.status:8}[/] {check.name:24} ",
                end="",
                markup=True,
                highlight=False,
            )
            detail = printable(check.detail)
            console.print(detail, markup=False, highlight=False, soft_wrap=True)
            is_broken |= check.is_essential and check.status != "ok"
        if is_broken:
            console.print("something essential is broken, see above")
        return int(is_broken)

    def _require_used(self) -> None:
        """Refuse an option that would be ignored."""
        unused: dict[str, str] = {}
        if self.tracker is not None:
            unused = dict.fromkeys(("delay", "payload_error"), _CAMERA)
        elif self.arm is None:
            names = ("robot", "cell", "delay", "payload_error", "period")
            unused = dict.fromkeys(names, _HERE)
        address = None if self.arm is None else parse_address(self.arm)
        if isinstance(address, FriAddress | FrankaAddress):
            unused["period"] = _OWN
        usual = {field.name: field.default for field in fields(self)}
        for name, why in unused.items():
            if vars(self)[name] != usual[name]:
                raise ConfigError(f"--{name.replace('_', '-')} would be ignored: {why}")

    def _check_arm(self, text: str) -> Iterator[Check]:
        from dovetail.doctor.franka_arm import run_franka_checks
        from dovetail.doctor.fri_arm import run_fri_checks
        from dovetail.doctor.simulated_arm import run_simulated_checks

        address = parse_address(text)
        declared = self._declared()
        asks = None if self.yes else ask
        if isinstance(address, FriAddress):
            return run_fri_checks(address, asks, declared, self.robot, self.cell)
        if isinstance(address, FrankaAddress):
            return run_franka_checks(address, asks, declared, self.robot, self.cell)
        period = require_period(self.period, "--period")
        if not isinstance(address, LocalAddress):
            raise ConfigError(
                "the doctor checks arms behind FRI and FCI, and simulated ones, not "
                f"{text!r}; run it where the arm is served, with fri://HOST:PORT?KEY=VALUE&..."
            )
        plant = address.make_plant(find_cell(robot=self.robot, cell=self.cell))
        return run_simulated_checks(plant, period, declared)

    def _check_camera(self, file: str) -> Iterator[Check]:
        from dovetail.doctor.camera import run_camera_checks
        from dovetail.perceive.camera import load_camera

        return run_camera_checks(
            load_camera(file),
            None if self.arm is None else parse_address(self.arm),
            find_cell(robot=self.robot, cell=self.cell),
            None if self.yes else ask,
            require_period(self.period, "--period"),
        )

    def _declared(self) -> dict[str, float]:
        given = {"delay": self.delay, "payload_error": self.payload_error}
        declared = DeclaredErrors(**DECLARED | given)
        if problems := declared.beyond_proven():
            raise ConfigError("; ".join(problems))
        return vars(declared)
