"""Exceptions of dovetail: each says what is wrong, where, and what to do next."""

import difflib
import importlib.util
import shlex
import sys
from collections.abc import Iterable
from pathlib import Path

from dovetail.distribution import requirements_of
from dovetail.printable import printable


def install_command(*extras: str) -> str:
    """Return the command that adds the packages of extras to this Python.

    It names the packages themselves, so it builds nothing of dovetail again.
    """
    packages = requirements_of(*extras)
    if not packages:
        python = ".".join(map(str, sys.version_info[:2]))
        return f"the extra {', '.join(extras)} has no packages for Python {python}"
    return shlex.join([*_installer(), *packages])


def _installer() -> list[str]:
    """Return the words that install into this Python, from the current folder."""
    python, here = Path(sys.executable), Path.cwd()
    name = str(python.relative_to(here) if python.is_relative_to(here) else python)
    if importlib.util.find_spec("pip"):
        return [name, "-m", "pip", "install"]
    return ["uv", "pip", "install", "--python", name]  # uv's environments have no pip


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return " (did you mean X?)" with the known name that is nearest, or nothing."""
    near = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {near[0]}?)" if near else ""


class DovetailError(Exception):
    """Base of every error that dovetail raises on purpose."""

    def __str__(self) -> str:
        """Return the message; what it quotes of others steers no terminal."""
        return printable(super().__str__(), keep="\n")


class ConfigError(DovetailError, ValueError):
    """A setting, argument or configuration file is wrong.

    Attributes:
        name: The setting, an element of an array as x_min[Y]; empty if it is not one.
        value: Its value.
        unit: Unit of the value; 1 for none.
        allowed: Smallest and largest value, or the known words.
    """

    def __init__(
        self,
        message: str,
        *,
        name: str = "",
        value: object = None,
        unit: str = "1",
        allowed: tuple[object, ...] = (),
    ) -> None:
        super().__init__(message)
        self.name = name
        self.value = value
        self.unit = unit
        self.allowed = allowed


class TorqueError(ConfigError):
    """A joint has less torque than it needs to hold or to brake the arm."""

    def __init__(
        self, message: str, joint: str, cause: str, shares: dict[str, float]
    ) -> None:
        super().__init__(message)
        self.joint = joint
        """Name of the joint."""
        self.cause = cause
        """Largest share of its torque: speed, damping, payload, gravity or inertia."""
        self.shares = shares
        """Torque that each of these takes [Nm]."""


class LimitError(DovetailError, ValueError):
    """A state or command lies outside a limit."""


class UnprovenWarning(UserWarning):
    """Something lies outside that for which the limits were shown to hold."""


class ReachError(LimitError):
    """A pose lies outside the reachable workspace."""

    def __init__(
        self,
        message: str,
        position_error: float,
        rotation_error: float,
        joints: tuple[int, ...] = (),
    ) -> None:
        super().__init__(message)
        self.position_error = position_error
        """Distance of the closest configuration [m]."""
        self.rotation_error = rotation_error
        """Angle by which it is turned away [rad]."""
        self.joints = joints
        """Joints, counted from 0, at a limit on the way there."""


class PlantError(DovetailError, RuntimeError):
    """A simulated plant cannot be built or has failed."""


class GripperError(DovetailError, RuntimeError):
    """A gripper cannot be reached, refuses a command, or failed at it."""

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code
        """The gripper's own error code; None where it sent none."""


class PolicyError(DovetailError, ValueError):
    """A policy file is damaged or does not fit the task."""


class LogError(DovetailError, OSError):
    """An Episode log cannot be written or is not valid."""


class MissingDependencyError(DovetailError, ImportError):
    """An optional package is needed and not installed."""


class TrackerError(DovetailError, RuntimeError):
    """Nobody knows where the fixture is, or will any more."""


class ArmError(DovetailError, RuntimeError):
    """An arm cannot be reached, or does not follow any more.

    Attributes:
        reason: One word for programs, such as "external_torque" or "no_cabinet".
        state: What the arm last knew of itself, an `ArmState`, or None.
    """

    def __init__(self, message: str, reason: str = "", state: object = None) -> None:
        super().__init__(message)
        self.reason = reason
        self.state = state
