"""MuJoCo's import, which fails where MUJOCO_GL names what is not on this machine."""

import ctypes.util
import importlib
import os
import sys

LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
"""Ways to draw without a screen, the faster one first, and the library of each."""
PACKAGES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}
"""Their Debian packages."""
_NAME = "MUJOCO_GL"
_OFF = "disabled"  # MuJoCo then looks for nothing that draws
_OTHERS = (
    *("", "disable", _OFF, "off", "false", "0", "enable", "enabled", "on", "true"),
    *("1", "glfw"),
    *{"linux": ("glx",), "darwin": ("cgl",), "win32": ("wgl",)}.get(sys.platform, ()),
)


def asked_backend() -> str:
    """Return what MUJOCO_GL names; empty for nothing."""
    return os.environ.get(_NAME, "").lower().strip()


def is_here(backend: str) -> bool:
    """Say whether the library of one of `LIBRARIES` is on this machine."""
    return ctypes.util.find_library(LIBRARIES[backend]) is not None


def import_without_drawing() -> None:
    """Import MuJoCo now, without what draws, where MUJOCO_GL would fail its import.

    So everything goes on that draws nothing; what draws says what there is not.
    """
    asked = asked_backend()
    if is_here(asked) if asked in LIBRARIES else asked in _OTHERS:
        return
    before = os.environ[_NAME]
    os.environ[_NAME] = _OFF
    try:
        importlib.import_module("mujoco")
    finally:
        os.environ[_NAME] = before
