"""`dovetail replay`: recorded episodes in the browser, with a time line."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dovetail.cockpit.recorded import Recorded
from dovetail.cockpit.server import PORT, open_server
from dovetail.commands.cockpit import serve_page
from dovetail.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Replay:
    """Show an Episode log in the browser; two of them side by side."""

    episode: Annotated[Path, tyro.conf.Positional]
    """Episode log, .npz or .parquet. A folder's logs are listed."""
    other: Annotated[Path | None, tyro.conf.Positional] = None
    """Another one, shown beside it at the same time since its begin."""
    env: str | None = None
    """Environment of the logs, where they do not say it; MODULE:ID of your own."""
    robot: str | None = None
    """Robot: a name, .urdf or .xml file, menagerie:NAME or MODULE:FUNCTION.
    Where the logs do not say it."""
    port: int = PORT
    """Port of the page, on this machine alone; 0 is any free one."""

    def run(self, console: Console) -> int:
        """Show the page until Ctrl-C or SIGTERM."""
        from dovetail.cockpit.replay_page import ReplayPage

        files = [path for path in (self.episode, self.other) if path is not None]
        for folder in filter(Path.is_dir, files):
            raise ConfigError(f"{folder} is a folder{_logs_in(folder)}")
        logs = tuple(
            Recorded.load(path, env=self.env, robot=self.robot) for path in files
        )
        server = open_server(self.port)
        try:
            page = ReplayPage(server, logs)
            serve_page(server, console, is_driven=False)
            page.close()
        finally:
            server.stop()
        return 0


def _logs_in(folder: Path) -> str:
    """Return which logs a folder holds, for a message."""
    inside = [*folder.glob("*"), *folder.glob("*/*")]
    logs = sorted(path for path in inside if path.suffix in (".npz", ".parquet"))
    more = f" and {len(logs) - 5} more" if len(logs) > 5 else ""
    if not logs:
        return " without a log"
    words = shlex.join(["dovetail", "replay", str(logs[-1])])
    shown = ", ".join(map(str, logs[:5]))
    return f" of {len(logs)} logs: {shown}{more}; name one: {words}"
