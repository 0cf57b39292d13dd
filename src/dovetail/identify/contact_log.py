"""Files of the slides of a recording: every control cycle, and which way it was on.

There is one for each strip, `contact-00.npz` and `contact-01.npz`, beside the
sequences of free motion.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dovetail.episode import Episode
from dovetail.errors import LogError
from dovetail.identify.contact_motion import Slide
from dovetail.identify.log_checks import (
    require_gapless,
    require_numbers,
    require_same_facts,
)
from dovetail.identify.plain_strip import STRIPS, Strip
from dovetail.plants.plant import CYCLE_COLUMNS
from dovetail.types import Array, Vec3

_FACTS = ("robot", "task", "period")


class StripLog(NamedTuple):
    """Slides on one strip."""

    along: Vec3
    """Unit vector along it, world axes."""
    normal: Vec3
    """Unit vector out of the surface."""
    slides: tuple[Slide, ...]
    """In the order in which they were played."""


def contact_path(folder: Path, number: int) -> Path:
    """Return where a recording has the slides on a strip."""
    return folder / f"contact-{number:02}.npz"


def save_strip(
    path: Path, metadata: Mapping[str, Any], strip: Strip, slides: Sequence[Slide]
) -> None:
    """Write the slides on a strip.

    Args:
        path: Where.
        metadata: Content of the recording's `recording.json`.
        strip: Where the part slid.
        slides: What came of it.
    """
    facts = {name: metadata[name] for name in _FACTS}
    facts |= {"along": strip.along.tolist(), "normal": strip.normal.tolist()}
    facts["slides"] = [[slide.press, slide.sign] for slide in slides]
    episode = Episode(metadata=facts)
    for number, slide in enumerate(slides):
        episode.append(slide.log, number, (), 0.0)
    episode.save(path)


def load_contact(folder: Path, metadata: Mapping[str, Any]) -> tuple[StripLog, ...]:
    """Read the slides of a recording, none where it has no file of them.

    Args:
        folder: Of the recording.
        metadata: Content of its `recording.json`.

    Raises:
        LogError: A file is missing, damaged, or of another recording.
    """
    paths = [contact_path(folder, number) for number in range(STRIPS)]
    missing = [path for path in paths if not path.is_file()]
    if len(missing) == STRIPS:
        return ()
    if missing:
        raise LogError(
            f"{missing[0]} is missing: the slides are not whole; go on with them by "
            "the command of the recording, with --contact"
        )
    return tuple(_load_strip(path, metadata) for path in paths)


def _load_strip(path: Path, metadata: Mapping[str, Any]) -> StripLog:
    episode = Episode.load(path)
    told = episode.metadata
    require_same_facts(path, told, {name: metadata[name] for name in _FACTS})
    along, normal = (_unit_vector(path, told, name) for name in ("along", "normal"))
    log = episode.data[:, [episode.columns.index(name) for name in CYCLE_COLUMNS]]
    numbers, ways = episode["step"], told.get("slides")
    slides: list[Slide] = []
    for number, way in enumerate(ways if isinstance(ways, list) else []):
        press, sign = require_numbers(path, f"slide {number}", way, 2)
        rows = log[numbers == number]
        if sign not in (-1, 1) or len(rows) < 2:
            raise LogError(
                f"{path} is damaged: slide {number} has the direction {sign:g} and "
                f"{len(rows)} control cycles; allowed are 1 or -1, and 2 or more: "
                "delete the file and record it again"
            )
        require_gapless(path, rows, float(metadata["period"]))
        slides.append(Slide(float(press), int(sign), rows))
    if not slides:
        raise LogError(
            f"{path} is damaged: it names no slides; delete the file and record it "
            "again"
        )
    return StripLog(along, normal, tuple(slides))


def _unit_vector(path: Path, told: Mapping[str, Any], name: str) -> Array:
    vector = require_numbers(path, name, told.get(name), 3)
    length = float(np.linalg.norm(vector))
    if abs(length - 1.0) > 1e-6:
        raise LogError(
            f"{path} is damaged: {name} is {vector.tolist()}, of length {length:g}; "
            "allowed is 1: delete the file and record it again"
        )
    return vector
