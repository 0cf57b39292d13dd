"""An OpenGL context without a screen: EGL, or OSMesa where there is no EGL.

It lives in a thread of its own. A thread can draw in one context at a time, and a
program may have a window: pygame's would be refused by the X server where a context of
EGL is current, and the other way round.
"""

import importlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import cache, partial
from queue import SimpleQueue
from threading import Thread
from typing import Any, ParamSpec, Protocol, TypeVar

from dovetail.errors import MissingDependencyError
from dovetail.mujoco_gl import LIBRARIES, PACKAGES, asked_backend, is_here

_TRY = "import mujoco.{0} as gl; c = gl.GLContext(8, 8); c.make_current(); c.free()"
_TRY_TIMEOUT = 30.0  # s
_Given = ParamSpec("_Given")
_Made = TypeVar("_Made")


class GlContext(Protocol):
    """Context that OpenGL draws in."""

    def make_current(self) -> None:
        """Draw here from now on, in this thread."""
        ...

    def free(self) -> None:
        """Give it back."""
        ...


class GlThread:
    """A thread with a context that stays current in it."""

    def __init__(self, width: int, height: int) -> None:
        """Start the thread and open its context, for pictures of this size [pixels].

        Raises:
            MissingDependencyError: There is no OpenGL that draws without a screen.
        """
        self._asked: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None]
        self._asked = SimpleQueue()
        # A daemon, as others are ended before what is registered with atexit.
        Thread(target=self._serve, name="renderer", daemon=True).start()
        try:
            self._context = self.do(open_context, width, height)
        except BaseException:
            self._asked.put(None)
            raise

    def _serve(self) -> None:
        while (asked := self._asked.get()) is not None:
            given, act = asked
            try:
                given.set_result(act())
            except BaseException as error:
                given.set_exception(error)
            del asked, given, act  # an error holds this frame

    def do(
        self,
        act: Callable[_Given, _Made],
        *args: _Given.args,
        **options: _Given.kwargs,
    ) -> _Made:
        """Return what a function gives that is called in the thread."""
        given: Future[_Made] = Future()
        self._asked.put((given, partial(act, *args, **options)))
        try:
            return given.result()
        finally:
            del given

    def close(self, last: Callable[[], object]) -> None:
        """Give the context back and end the thread.

        Args:
            last: What is done in the context before.
        """
        try:
            self.do(self._free, last)
        finally:
            self._asked.put(None)

    def _free(self, last: Callable[[], object]) -> None:
        last()
        self._context.free()


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
        library = importlib.import_module(f"mujoco.{backend}")
        if backend == "egl":
            _initialise(library)
        context: GlContext = _freed_quietly(library.GLContext)(width, height)
        context.make_current()
    except Exception as error:  # PyOpenGL's own are known only where it loads
        raise MissingDependencyError(
            f"{backend} is installed and does not draw: {error}; install Mesa's "
            "software device (Debian: apt install libegl1 libgl1-mesa-dri), or try "
            "another one with MUJOCO_GL=egl or MUJOCO_GL=osmesa"
        ) from error
    return context


def _initialise(egl: Any) -> None:
    """Initialise EGL again, if another library has ended it for the whole process.

    Without an X display pygame's windows are EGL's, too, and end it when they close.
    """
    if egl.EGL_DISPLAY is not None:
        egl.EGL.eglInitialize(egl.EGL_DISPLAY, None, None)


def _freed_quietly(kind: type[Any]) -> type[Any]:
    """Return MuJoCo's class of contexts, for one that may be gone when it is freed."""

    class Context(kind):
        def free(self) -> None:
            with suppress(Exception):
                super().free()

    return Context
