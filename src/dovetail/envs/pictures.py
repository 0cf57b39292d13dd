"""Pictures of an environment's episode: what `render` draws, and remembers for it."""

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dovetail.arms.arm import ArmState
from dovetail.errors import ArmError, ConfigError
from dovetail.poses import Pose
from dovetail.types import Vec3
from dovetail.workcell.workcell import Workcell

if TYPE_CHECKING:
    from dovetail.view.renderer import Renderer

LONGEST_PATH = 600
"""Policy steps of the tool's path that are drawn, the last ones: 30 s."""


class EpisodePictures:
    """Remembers an episode's path, and draws it; OpenGL is opened by the first picture.

    Where no pictures are wanted, nothing is remembered.
    """

    def __init__(
        self, cell: Workcell, mode: str | None, metadata: dict[str, Any]
    ) -> None:
        """Take the cell and what `gymnasium.make` was asked for.

        Args:
            cell: What is drawn.
            mode: The `render_mode`; None is no pictures.
            metadata: Of the environment, with the modes that it knows.

        Raises:
            ConfigError: The mode is not known.
        """
        known = metadata["render_modes"]
        if mode not in (None, *known):
            raise ConfigError(
                f"render_mode is {mode!r}; known: {', '.join(known)}, and human by way "
                "of gymnasium.make"
            )
        self._cell, self._is_wanted, self._is_closed = cell, mode is not None, False
        self._renderer: Renderer | None = None
        self._path: deque[Vec3] = deque(maxlen=LONGEST_PATH + 1)

    def begin(self, state: ArmState) -> None:
        """Forget the last episode's path, and begin this one's."""
        self._path.clear()
        self.add(state)

    def add(self, state: ArmState) -> None:
        """Remember where the tool's end was measured."""
        if self._is_wanted:
            self._path.append(state.tool.position.copy())

    def draw(
        self, state: ArmState, fixture: Pose, believed: Pose
    ) -> NDArray[np.uint8] | None:
        """Return a picture, shape (480, 640, 3), or None where none are wanted.

        Args:
            state: What was measured last.
            fixture: Where the fixture truly is.
            believed: Where it is believed.

        Raises:
            MissingDependencyError: There is no OpenGL that draws without a screen.
            ArmError: The environment is closed.
        """
        if not self._is_wanted:
            return None
        if self._is_closed:
            raise ArmError("this environment is closed: render before close")
        if self._renderer is None:
            from dovetail.view.renderer import Renderer

            self._renderer = Renderer(self._cell)
        return self._renderer.draw(
            state.q,
            fixture,
            force=state.contact_force,
            path=self._path,
            believed=believed,
            parts=state.parts,
        )

    def close(self) -> None:
        """Give OpenGL back; again is no harm."""
        self._is_closed = True
        if self._renderer is not None:
            self._renderer.close()
