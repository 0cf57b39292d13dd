"""An OpenGL context without a screen: EGL, or OSMesa where there is no EGL."""

import importlib
import os
import subprocess
import sys
from functools import cache
from typing import Protocol

from dovetail.errors import MissingDependencyError
from dovetail.mujoco_gl import LIBRARIES, PACKAGES, asked_backend, is_here

_TRY = "import mujoco.{0} as gl; c = gl.GLContext(8, 8); c.make_current(); c.free()"
_TRY_TIMEOUT = 30.0  # s


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

    `MUJOCO_GL` decides where it names one of them. Where both are there and the first
    one does not draw, it is the second one.

    Raises:
        MissingDependencyError: Neither library is there, or not the one that is asked
            for; names the Debian packages.
    """
    asked = asked_backend()
    names = [asked] if asked in LIBRARIES else list(LIBRARIES)
    found = [name for name in names if is_here(name)]
    if len(found) > 1 and not draws(found[0]) and draws(found[1]):
        return found[1]
    if found:
        return found[0]
    if asked in LIBRARIES:
        raise MissingDependencyError(
            f"MUJOCO_GL is {asked}, and {LIBRARIES[asked]} is not here: install it "
            f"(Debian: apt install {PACKAGES[asked]}), unset MUJOCO_GL, or leave the "
            "pictures out"
        )
    raise MissingDependencyError(
        "pictures need OpenGL without a screen, and neither EGL nor OSMesa is here; "
        f"install EGL (Debian: apt install {PACKAGES['egl']}) or OSMesa (apt "
        f"install {PACKAGES['osmesa']}), or leave the video out"
    )


@cache
def draws(name: str) -> bool:
    """Try one of the ways, in a process of its own: OpenGL is loaded only once in one.

    Args:
        name: egl or osmesa.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", _TRY.format(name)],
            env={**os.environ, "MUJOCO_GL": name, "PYOPENGL_PLATFORM": name},
            capture_output=True,
            timeout=_TRY_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


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
