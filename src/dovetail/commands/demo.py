"""`dovetail demo`: the main job with the policy that ships in the package."""

from dataclasses import replace
from pathlib import Path

from rich.console import Console

from dovetail.commands.evaluate import print_files
from dovetail.commands.unproven import warn_of_arm
from dovetail.evaluation.cover import compare
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.files import dated_folder
from dovetail.options import Period
from dovetail.settings import settings, values_of
from dovetail.tasks.shipped import DEFAULT_POLICY, TRUSTING_POLICY
from dovetail.workcell.cell_config import CellFile

SEARCHING_POLICY = "search_square"
"""The shipped policy that learned to search."""
DEFAULT_TWIN = "medium"
"""The twin where none is said."""


@settings()
class DemoPolicyOptions:
    """Policy and tries."""

    policy: str = DEFAULT_POLICY
    """Policy: the name of a shipped one, or a file."""
    tries: int = 20
    """Tries at each of the three fixture poses."""
    cover: bool = False
    """Cover the camera and move the fixture by 0, 5, 10, 20 and 30 mm. It
    compares a policy without a search, the scripted search, and a learned one."""


@settings()
class DemoPlaceOptions:
    """Twin to try on, and its settings."""

    twin: str = DEFAULT_TWIN
    """Twin to try on: the name of a shipped one, or a .toml file."""
    tracker: str = "twin"
    """Tracker of the fixture: twin is the camera of the twin's file, late and beside
    the truth; or truth, or another (dovetail evaluate --help)."""
    robot: str | None = None
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    Default the policy's."""
    period: Period | None = None
    """Control period: 1ms, 2ms, 2.5ms or 5ms; default that of the policy's training."""
    cell: CellFile = None
    """Cell file: table, tool, walls, and where fixtures stand; default that of the
    policy's training."""


@settings()
class DemoResultsOptions:
    """The results."""

    out: Path | None = None
    """Folder for the results; default a new one, by the time, in demo-results."""
    video: bool = False
    """Film the first try at each pose: an animated GIF beside the report, and in it."""
    workers: int = 1
    """Processes that share the tries."""


@settings()
class Demo(DemoPolicyOptions, DemoPlaceOptions, DemoResultsOptions):
    """Try the shipped policy 20 times at each of 3 fixture poses on a twin."""

    def run(self, console: Console) -> int:
        """Evaluate and say where everything is."""
        given = values_of(self)
        warn_of_arm(console, self.twin)
        del given["cover"]
        given["out"] = self.out or dated_folder("demo-results")
        config = EvaluationConfig(**given)
        if self.cover:
            return self._compare(config, console)
        print_files(evaluate(config, console), console)
        return 0

    def _compare(self, config: EvaluationConfig, console: Console) -> int:
        """Say who finds a fixture that was moved unseen."""
        # Told the truth, and then covered.
        config = replace(config, tracker=None, keep_logs=False, video=False)
        actors = [
            ("no search", replace(config, policy=TRUSTING_POLICY)),
            ("script", replace(config, search="corner")),
            ("learned search", replace(config, policy=SEARCHING_POLICY)),
        ]
        folder = config.out or dated_folder("demo-results")
        compare(actors, folder, console)
        console.print(f"written to {folder}: cover.html, cover.json, a report for each")
        return 0
