"""A film of one try: what was measured at each policy step, drawn when it is over."""

import io
from pathlib import Path

from PIL import Image

from dovetail.arms.arm import ArmState
from dovetail.control.period import POLICY_PERIOD
from dovetail.files import write_atomic
from dovetail.poses import Pose
from dovetail.types import Vec3, Vec7
from dovetail.view.renderer import BLUE, RED, Renderer

_END = 20
"""Frames for which the last picture stays."""
_COLOURS, _PATCH = 160, 80  # colours of a film; width of a colour's patch [pixels]


class Film:
    """Remembers a try while it runs, as the arm must not wait for pictures."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._frames: list[tuple[Vec7, Pose, Vec3]] = []
        self._path: list[Vec3] = []

    def add(self, state: ArmState, fixture: Pose) -> None:
        """Remember a policy step.

        Args:
            state: What the arm measured.
            fixture: Where the fixture is.
        """
        self._frames.append((state.q.copy(), fixture, state.contact_force.copy()))
        self._path.append(state.position.copy())

    def write(self, file: Path, renderer: Renderer) -> Path:
        """Draw what was remembered, at real time, as an animated GIF.

        Args:
            file: Where to; replaced as a whole.
            renderer: Of the cell in which it was.

        Raises:
            LogError: The disk is full or the folder is not writable.
        """
        pictures = [
            Image.fromarray(
                renderer.draw(q, fixture, force=force, path=self._path[: i + 1])
            )
            for i, (q, fixture, force) in enumerate(self._frames)
        ]
        palette = _palette(pictures)
        pictures = [
            picture.quantize(palette=palette, dither=Image.Dither.NONE)
            for picture in pictures
        ]
        pictures += [pictures[-1]] * _END
        content = io.BytesIO()
        pictures[0].save(
            content,
            "GIF",
            save_all=True,
            append_images=pictures[1:],
            duration=round(1e3 * POLICY_PERIOD),
            loop=0,
        )
        return write_atomic(file, content.getvalue())


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """Return one palette for all: less to store, and nothing flickers.

    It is made of three pictures and a patch of each colour that may cover few pixels.
    """
    width, height = pictures[0].size
    patches = [
        Image.new("RGB", (_PATCH, height), tuple(round(255 * c) for c in colour[:3]))
        for colour in (RED, BLUE)
    ]
    shown = [pictures[0], pictures[len(pictures) // 2], pictures[-1], *patches]
    board = Image.new("RGB", (3 * width + 2 * _PATCH, height))
    left = 0
    for picture in shown:
        board.paste(picture, (left, 0))
        left += picture.width
    return board.quantize(colors=_COLOURS)
