"""Result of a calibration: go with a camera file, or no-go without one."""

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from dovetail.files import write_atomic

if TYPE_CHECKING:
    from dovetail.perceive.camera import Camera


def decide(
    console: Console, objections: list[str], file: Path, camera: "Camera"
) -> int:
    """Write the camera file where nothing speaks against it."""
    for objection in objections:
        console.print(f"no-go: {objection}", highlight=False, soft_wrap=True)
    if objections:
        console.print(f"{file} is not written")
        return 1
    write_atomic(file, camera.to_toml())
    console.print(f"go: written to {file}", highlight=False, soft_wrap=True)
    return 0


def now() -> str:
    """Return the time for a file's `made_on`."""
    return datetime.now().astimezone().isoformat(timespec="seconds")
