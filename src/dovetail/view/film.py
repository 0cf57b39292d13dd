"""A film of one try: what was measured at each policy step, drawn when it is over."""

import io
from pathlib import Path

from PIL import Image

from dovetail.arms.arm import ArmState
from dovetail.control.period import POLICY_PERIOD
from dovetail.files import write_atomic
from dovetail.poses import Pose
from dovetail.types import Vec3, Vec7
from dovetail.view.marks import BELIEVED_COLOUR, FORCE_COLOUR, PATH_COLOUR
from dovetail.view.renderer import Renderer

_END = 20
"""Frames for which the last picture stays."""
_COLOURS, _PATCH = 160, 80  # colours of a film; width of a colour's patch [pixels]


class Film:
    """Remembers a try while it runs, as the arm must not wait for pictures."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._frames: list[tuple[Vec7, Pose, Pose, Vec3]] = []
        self._path: list[Vec3] = []

    def add(self, state: ArmState, fixture: Pose, believed: Pose) -> None:
        """Remember a policy step.

        Args:
            state: What the arm measured.
            fixture: Where the fixture truly is; kept as it is.
            believed: Where it is believed; kept as it is.
        """
        frame = state.q.copy(), fixture, believed, state.contact_force.copy()
        self._frames.append(frame)
        self._path.append(state.tool.position.copy())

    def write(self, file: Path, renderer: Renderer) -> Path:
        """Draw what was remembered, at real time, as an animated GIF.

        Args:
            file: Where to; replaced as a whole.
            renderer: Of the cell in which it was.

        Raises:
            LogError: The disk is full or the folder is not writable.
        """
        count = len(self._frames)
        chosen = (0, count // 2, count - 1)
        palette = _palette([self._draw(i, renderer) for i in chosen])
        pictures = (  # one at a time: all of a long try are more than the memory
            self._draw(i, renderer).quantize(palette=palette, dither=Image.Dither.NONE)
            for i in range(count)
        )
        shown = [1] * (count - 1) + [1 + _END]
        content = io.BytesIO()
        next(pictures).save(
            content,
            "GIF",
            save_all=True,
            append_images=pictures,
            duration=[round(1e3 * POLICY_PERIOD * frames) for frames in shown],
            loop=0,
        )
        return write_atomic(file, content.getvalue())

    def _draw(self, index: int, renderer: Renderer) -> Image.Image:
        """Return the picture of a policy step, with the path until then."""
        q, fixture, believed, force = self._frames[index]
        path = self._path[: index + 1]
        return Image.fromarray(
            renderer.draw(q, fixture, force=force, path=path, believed=believed)
        )


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """Return one palette for all: less to store, and nothing flickers.

    Args:
        pictures: Three of them; a patch is added of each colour that may cover few
            pixels.
    """
    width, height = pictures[0].size
    patches = [
        Image.new("RGB", (_PATCH, height), colour)
        for colour in (FORCE_COLOUR, PATH_COLOUR, BELIEVED_COLOUR)
    ]
    board = Image.new("RGB", (3 * width + len(patches) * _PATCH, height))
    left = 0
    for picture in (*pictures, *patches):
        board.paste(picture, (left, 0))
        left += picture.width
    return board.quantize(colors=_COLOURS, method=Image.Quantize.FASTOCTREE)
