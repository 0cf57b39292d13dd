"""An OpenGL context without a screen: EGL, or OSMesa where there is no EGL."""

import ctypes.util
import importlib
import os
from typing import Protocol

from dovetail.errors import MissingDependencyError

LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
"""Ways to draw without a screen, the faster one first, and the library of each."""


class GlContext(Protocol):
    """Where OpenGL draws to."""

    def make_current(self) -> None:
        """Draw here from now on, in this thread."""
        ...

    def free(self) -> None:
        """Give it back."""
        ...


def find_backend() -> str:
    """Return how to draw without a screen: egl or osmesa.

    `MUJOCO_GL` decides where it names one of them.

    Raises:
        MissingDependencyError: Neither library is there; names the Debian packages.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower()
    for name in [asked] if asked in LIBRARIES else LIBRARIES:
        if ctypes.util.find_library(LIBRARIES[name]):
            return name
    raise MissingDependencyError(
        "pictures need OpenGL without a screen, and neither EGL nor OSMesa is here; "
        "install EGL (Debian: apt install libegl1 libgl1-mesa-dri) or OSMesa (apt "
        "install libosmesa6), or leave the video out"
    )


def open_context(width: int, height: int) -> GlContext:
    """Return a context for pictures of this size [pixels], current in this thread.

    Raises:
        MissingDependencyError: There is no OpenGL that draws without a screen.
    """
    backend = find_backend()
    try:
        context: GlContext = importlib.import_module(f"mujoco.{backend}").GLContext(
            width, height
        )
        context.make_current()
    except Exception as error:  # PyOpenGL's own are known only where it loads
        raise MissingDependencyError(
            f"{backend} is installed and does not draw: {error}; install Mesa's "
            "software device (Debian: apt install libegl1 libgl1-mesa-dri), or try "
            "another one with MUJOCO_GL=egl or MUJOCO_GL=osmesa"
        ) from error
    return context
