"""Deflection of a 3D mouse's cap, read by a thread of its own.

A device that is unplugged leads nowhere: the arm is held, and the page says why.
"""

import threading
import warnings
from typing import Any

import numpy as np

from dovetail.errors import ConfigError, MissingDependencyError, install_command
from dovetail.types import Vec6

DEAD = 0.08
"""Deflection below which the cap rests [1]."""
_INTERVAL = 0.005  # [s] between two reads; the devices report 60 times a second


def open_device() -> Any:
    """Return the first 3D mouse of this machine.

    Raises:
        MissingDependencyError: The extra `teach` is not installed, or no HID library.
        ConfigError: There is no such device, or this user may not read it.
    """
    try:
        import pyspacemouse
    except (ImportError, OSError, AttributeError) as error:
        raise MissingDependencyError(
            f"a 3D mouse needs pyspacemouse and the library hidapi ({error}): "
            f"{install_command('teach')}, and on Debian apt install libhidapi-hidraw0"
        ) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            convention = pyspacemouse.AxisConvention.HID_Z_UP
            return pyspacemouse.open(axis_convention=convention)
    except Exception as error:  # its driver's may be of any kind
        raise ConfigError(
            f"there is no 3D mouse that can be read here: {error}; plug one in, and "
            "let this user read it (Debian: apt install libhidapi-hidraw0, and a udev "
            "rule for hidraw, vendor 256f)"
        ) from error


class SpaceMouse:
    """The newest deflection of a device, until it is closed or unplugged."""

    def __init__(self, device: Any = None) -> None:
        """Open the device and begin to read it.

        Args:
            device: Has `read`, which returns x y z roll pitch yaw in [-1, 1], and
                `close`; None is the first one of this machine.

        Raises:
            DovetailError: See `open_device`.
        """
        self._device = open_device() if device is None else device
        self.problem = ""
        """Reason why it no longer leads; empty while it works."""
        self._deflection: Vec6 = np.zeros(6)
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._read, name="3D mouse", daemon=True)
        self._thread.start()

    @property
    def deflection(self) -> Vec6:
        """Deflection of the cap, shift then turn [1], each in [-1, 1]; 0 at rest.

        Axes of both: to the right, away from the person, up.
        """
        return self._deflection

    def _read(self) -> None:
        while not self._is_closed.wait(_INTERVAL):
            try:
                s = self._device.read()
                raw = np.array([s.x, s.y, s.z, s.roll, s.pitch, s.yaw], dtype=float)
            except Exception as error:  # its driver's may be of any kind
                self._deflection = np.zeros(6)
                self.problem = (
                    f"the 3D mouse cannot be read any more ({error}); it leads "
                    "nowhere: plug it in and switch it on again"
                )
                return
            self._deflection = without_rest(raw)

    def close(self) -> None:
        """Let go of the device."""
        self._is_closed.set()
        self._thread.join()
        self._deflection = np.zeros(6)
        try:
            self._device.close()
        except Exception as error:  # an unplugged one may fail at that, too
            self.problem = self.problem or str(error)


def without_rest(raw: Vec6) -> Vec6:
    """Return a deflection that begins at 0 where the cap leaves its rest.

    Not-a-number counts as rest.
    """
    raw = np.where(np.isfinite(raw), raw, 0.0).clip(-1.0, 1.0)
    size = np.maximum(np.abs(raw) - DEAD, 0.0) / (1.0 - DEAD)
    return np.copysign(size, raw)
