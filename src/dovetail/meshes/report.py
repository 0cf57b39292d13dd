"""The report on a pair of meshes: one HTML page with pictures, and JSON."""

import json
from collections.abc import Callable, Sequence

import numpy as np

from dovetail.errors import MissingDependencyError
from dovetail.meshes.check import Check
from dovetail.meshes.figures import draw_clearance, draw_hold, draw_sections
from dovetail.meshes.scene import NOTE, draw_scene
from dovetail.meshes.slices import Slicer
from dovetail.meshes.words import numbers
from dovetail.page import figure, finite, page, text
from dovetail.types import Array
from dovetail.workcell.near_mouth import sections_at

_PICTURED = 5
"""Heights of which there is a picture."""


def to_html(
    check: Check,
    facts: Sequence[tuple[str, str]],
    command: str,
    begin: Callable[[str], None],
) -> str:
    """Return the report as one HTML page without a single outside link.

    Args:
        check: The pair.
        facts: Name and text of each fact.
        command: Commands to try it and to train on it.
        begin: Called with the name of each part of the work, as it begins.
    """
    begin("draw")
    pair = check.conversion
    name = f"{pair.plug.name} in {pair.socket.name}"
    if pair.name != pair.plug.name:
        name = f"{pair.name}: {name}"
    word, lead = ("go", "it can be trained") if check.is_go else ("no go", "see below")
    lines = "\n".join(
        f"<tr><td>{text(key)}</td><td>{text(value)}</td></tr>" for key, value in facts
    )
    pictures = [
        figure("Sections, and the smallest gap at each", _sections(check)),
        figure("Gap over the height", draw_clearance(check.clearance, check.pieces)),
        figure("Place to hold it", draw_hold(check.plug, check.socket, check.hold)),
    ]
    parts = [
        f"<h1>{text(name)}</h1>",
        f'<p class="lead"><span class="rate">{word}</span>{text(lead)}</p>',
        *(f"<p>{text(problem)}.</p>" for problem in check.problems),
        f'<table class="facts">\n{lines}\n</table>',
        *pictures,
        *_scene(check),
        *(["<h2>Next</h2>", f"<pre>{text(command)}</pre>"] if check.is_go else []),
    ]
    return page(name, parts)


def to_json(check: Check) -> str:
    """Return the facts as JSON."""
    return json.dumps(finite(numbers(check)), indent=2, allow_nan=False) + "\n"


def _scene(check: Check) -> list[str]:
    """Return the picture in 3D, or what it needs."""
    try:
        drawn = draw_scene(check.plug, check.socket, check.hold)
    except MissingDependencyError as error:
        return [f'<p class="note">{text(error)}</p>']
    return ["<h2>The pair in 3D</h2>", drawn, f'<p class="note">{NOTE}</p>']


def _sections(check: Check) -> bytes:
    """Draw sections at heights that are spread out, the tightest among them."""
    levels = [level for level in check.clearance.levels if len(level.gaps)]
    levels = levels or list(check.clearance.levels)
    spread = np.linspace(0, len(levels) - 1, _PICTURED).round().astype(int)
    chosen = [levels[i].z for i in dict.fromkeys(spread.tolist())]
    if check.clearance.is_measured:
        tight = check.clearance.tightest[0].z
        nearest = int(np.argmin(np.abs(np.array(chosen) - tight)))
        chosen[nearest] = tight
    meshes = [Slicer(one.vertices, one.faces) for one in (check.plug, check.socket)]

    def pieces(z: float) -> list[Array]:
        return [line for part in check.parts for line in sections_at(part, z)]

    drawn = [(z, meshes[0].at(z), meshes[1].at(z), pieces(z)) for z in reversed(chosen)]
    return draw_sections(drawn, check.clearance)
