"""`dovetail record`: a person shows the task; Episode logs and a LeRobotDataset."""

import shlex
from pathlib import Path
from typing import Annotated

from rich.console import Console

from dovetail.cockpit.choice import NO_POLICY
from dovetail.commands.cockpit import COMMON as _OF_COCKPIT
from dovetail.commands.cockpit import Cockpit
from dovetail.errors import LogError
from dovetail.files import dated_folder
from dovetail.learn.lerobot_folder import require_room, write_lerobot
from dovetail.options import some_paths
from dovetail.settings import settings

COMMON = ("written", *_OF_COCKPIT)
"""Settings that `--help` lists."""
LEROBOT = "lerobot"
"""Folder of the data set, in that of the logs."""


@settings()
class Record(Cockpit):
    """Record demonstrations: the cockpit's page, then a LeRobotDataset of them."""

    written: Annotated[tuple[Path, ...], some_paths("--written", Path)] = ()
    """Episode logs of before, or folders of them. They become the data set, and no page
    is shown."""
    policy: str = NO_POLICY
    """Policy that is corrected: the name of a shipped one, a file, or none."""

    def run(self, console: Console) -> int:
        """Show the page until it is ended, and write what was shown there.

        Raises:
            LogError: Nothing was shown; or logs do not make one data set.
            ConfigError: The folder has a data set already.
        """
        folder = self.logs or dated_folder("demonstrations")
        require_room(folder / LEROBOT, "--logs")
        shown = list(self.written) or self.show(console, folder)
        if not shown:
            raise LogError(
                "no demonstration was recorded: on the page, Lead the tool, then "
                "Demonstration: Begin"
            )
        frames = write_lerobot(shown, folder / LEROBOT)
        logs = self.written or (shown[0].parent,)
        words = ["dovetail", "train", "--demos", *map(str, logs)]
        console.print(
            f"{folder / LEROBOT}: {frames} steps",
            f"\n  next: {shlex.join(words)}",
            markup=False,
            soft_wrap=True,
            highlight=False,
        )
        return 0
