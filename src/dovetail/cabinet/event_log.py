"""Log of the cabinet's events, as JSON lines."""

import json
import time
from pathlib import Path
from typing import Any, TextIO

from dovetail.errors import LogError
from dovetail.page import finite


class EventLog:
    """Writes one JSON object per line; a full disk ends the log, not the cabinet."""

    def __init__(self, path: Path | None) -> None:
        """Open the file, or none.

        Raises:
            LogError: The file cannot be written.
        """
        self.path = path
        self.failure = ""
        """Reason why the log ended early; empty while it goes on."""
        self._start = time.monotonic()
        self._file: TextIO | None = None
        if path is not None:
            try:
                self._file = path.open("a", encoding="utf-8")
            except OSError as error:
                raise LogError(f"log {path} cannot be written: {error}") from error

    def write(self, event: str, **facts: Any) -> None:
        """Add a line: what happened, Unix time and time since the start [s], facts."""
        if self._file is None:
            return
        now = time.monotonic() - self._start
        line = {"event": event, "unix": time.time(), "since_start": round(now, 6)}
        try:
            # A request may hold nan, which is no JSON.
            self._file.write(json.dumps(finite(line | facts), allow_nan=False) + "\n")
            self._file.flush()
        except (OSError, ValueError) as error:
            self.failure = f"log {self.path} ended: {error}"
            self._file = None

    def close(self) -> None:
        """Close the file; harmless when repeated."""
        if self._file is not None:
            self._file.close()
            self._file = None
