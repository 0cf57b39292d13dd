"""`dovetail demo`: the main job with the policy that ships in the package."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from rich.console import Console

from dovetail.commands.evaluate import print_files
from dovetail.commands.help_page import sections_of
from dovetail.commands.unproven import warn_of_arm
from dovetail.control.period_option import Period
from dovetail.control.sections import Section, Sectioned
from dovetail.evaluation.cover import compare
from dovetail.evaluation.evaluate import EvaluationConfig, evaluate
from dovetail.files import dated_folder
from dovetail.tasks.shipped import DEFAULT_POLICY, TRUSTING_POLICY

SEARCHING_POLICY = "search_square"
"""The shipped policy that learned to search."""
DEFAULT_TWIN = "medium"
"""The twin where none is said."""


@dataclass(frozen=True, kw_only=True)
class DemoPolicyOptions(Section):
    """What is tried."""

    policy: str = DEFAULT_POLICY
    """Policy: the name of a shipped one, or a file."""
    tries: int = 20
    """Tries at each of the three fixture poses."""
    cover: bool = False
    """Cover the camera and move the fixture by 0, 5, 10, 20 and 30 mm. Who finds it:
    the policy without a search, the scripted one, the shipped one that learned it."""


@dataclass(frozen=True, kw_only=True)
class DemoPlaceOptions(Section):
    """Where."""

    twin: str = DEFAULT_TWIN
    """Twin to try on: the name of a shipped one, or a .toml file."""
    tracker: str = "twin"
    """What tells where the fixture is: twin, as the twin's file says of its camera,
    late and beside the truth; or truth, or another (dovetail evaluate --help)."""
    robot: str | None = None
    """Robot that the twin is: one of dovetail's, or MODULE:FUNCTION of your own;
    default the policy's."""
    period: Period | None = None
    """Control period: 1ms, 2ms, 2.5ms or 5ms; default that of the policy's training."""


@dataclass(frozen=True, kw_only=True)
class DemoResultsOptions(Section):
    """The results."""

    out: Path | None = None
    """Folder for the results; default a new one, by the time, in demo-results."""
    video: bool = False
    """Film the first try at each pose: an animated GIF beside the report, and in it."""
    workers: int = 1
    """Processes that share the tries."""


@dataclass(frozen=True, kw_only=True)
class Demo(Sectioned):
    """Try the shipped policy 20 times at each of 3 fixture poses on a twin."""

    whose: ClassVar[str] = "the command demo"

    tried: DemoPolicyOptions = field(default_factory=DemoPolicyOptions)
    """What is tried."""
    place: DemoPlaceOptions = field(default_factory=DemoPlaceOptions)
    """Where."""
    results: DemoResultsOptions = field(default_factory=DemoResultsOptions)
    """The results."""

    def run(self, console: Console) -> int:
        """Evaluate and say where everything is."""
        given = self.flat()
        warn_of_arm(console, self.place.twin)
        del given["cover"]
        given["out"] = self.results.out or dated_folder("demo-results")
        config = EvaluationConfig.of(**given)
        if self.tried.cover:
            return self._compare(config, console)
        print_files(evaluate(config, console), console)
        return 0

    def _compare(self, config: EvaluationConfig, console: Console) -> int:
        """Say who finds a fixture that was moved unseen."""
        # Told the truth, and then covered.
        config = config.having(tracker=None, keep_logs=False, video=False)
        actors = [
            ("no search", config.having(policy=TRUSTING_POLICY)),
            ("script", config.having(search="corner")),
            ("learned search", config.having(policy=SEARCHING_POLICY)),
        ]
        folder = config.trials.out or dated_folder("demo-results")
        compare(actors, folder, console)
        console.print(f"written to {folder}: cover.html, cover.json, a report for each")
        return 0


GROUPS = sections_of(Demo)
