"""Film of one trial: measured at each policy step, drawn when it is over."""

import io
from pathlib import Path

from PIL import Image

from dovetail.arms.arm import ArmState
from dovetail.control.period import POLICY_PERIOD
from dovetail.files import write_atomic
from dovetail.poses import Pose
from dovetail.types import Array, Vec3, Vec7
from dovetail.view.marks import BELIEVED_COLOUR, FORCE_COLOUR, PATH_COLOUR
from dovetail.view.renderer import Renderer

_END = 20
"""Frames for which the last picture stays."""
_COLOURS, _PATCH = 160, 80  # colours of a film; width of a colour's patch [pixels]


class Film:
    """Keeps the states of a trial while it runs: the arm must not wait for pictures."""

    def __init__(self) -> None:
        """Begin empty."""
        self._frames: list[tuple[Vec7, Pose, Pose, Vec3, Array]] = []
        self._path: list[Vec3] = []

    def add(self, state: ArmState, fixture: Pose, believed: Pose) -> None:
        """Add a policy step.

        Args:
            state: Measured state of the arm.
            fixture: True pose of the fixture; kept without a copy.
            believed: Its believed pose; likewise.
        """
        force, parts = state.contact_force.copy(), state.parts.copy()
        frame = state.q.copy(), fixture, believed, force, parts
        self._frames.append(frame)
        self._path.append(state.tool.position.copy())

    def write(self, file: Path, renderer: Renderer) -> Path:
        """Draw the trial, at real time, as an animated GIF.

        Args:
            file: Output; replaced as a whole.
            renderer: Renderer of its cell.

        Raises:
            LogError: The disk is full or the folder is not writable.
        """
        count = len(self._frames)
        chosen = (0, count // 2, count - 1)
        palette = _palette([self._draw(i, renderer) for i in chosen])
        pictures = (  # one at a time: all of a long trial are more than the memory
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
        q, fixture, believed, force, parts = self._frames[index]
        path = self._path[: index + 1]
        return Image.fromarray(
            renderer.draw(
                q, fixture, force=force, path=path, believed=believed, parts=parts
            )
        )


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """Return one palette for all: less to store, and nothing flickers.

    Args:
        pictures: Three; a patch of each colour that may cover few pixels is added.
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
