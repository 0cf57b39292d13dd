"""The simulated fingers: where they are at any time, and what they meet."""

import time

from dovetail.gripper.facts import WIDTH_MAX, Code, GripState

_HOME_SPEED = 0.1
_CLAMPING_TRAVEL = 0.003
_WIDTH_TOLERANCE = 0.002


class Fingers:
    """Two fingers on one axis, and perhaps a part between them.

    One motion at a time; `finish` tells what came of it.
    """

    def __init__(self, *, part_width: float | None, speed_up: float = 1.0) -> None:
        """Start open half way, not homed.

        Args:
            part_width: Width of the part [m]; None is no part.
            speed_up: How much faster than real motions are.
        """
        self.part_width = part_width
        self.is_homed = False
        self.is_fast_stopped = False
        self.state = GripState.IDLE
        self.force = 0.0
        self.tolerance = _WIDTH_TOLERANCE
        self.clamping_travel = _CLAMPING_TRAVEL
        self.motion: str | None = None
        self._speed_up = speed_up
        self._start = self._goal = 0.5 * WIDTH_MAX
        self._began = 0.0
        self._speed = 0.0
        self._wanted: float | None = None
        self._grip_force = 0.0
        self._is_on_part = False

    def width(self) -> float:
        """Return the opening now [m]."""
        if self.motion is None:
            return self._goal
        way = self._speed * self._speed_up * (time.monotonic() - self._began)
        if self._goal >= self._start:
            return min(self._start + way, self._goal)
        return max(self._start - way, self._goal)

    def speed(self) -> float:
        """Return the speed now [m/s], positive when opening."""
        if self.motion is None or self.width() == self._goal:
            return 0.0
        return self._speed if self._goal > self._start else -self._speed

    def refuse(self, command: str) -> Code | None:
        """Return why a motion cannot begin now, or None."""
        if self.is_fast_stopped:
            return Code.ACCESS_DENIED
        if not self.is_homed and command != "HOME":
            return Code.NOT_INITIALISED
        if self.motion is not None:
            return Code.ALREADY_RUNNING
        if command == "GRIP" and self.state == GripState.HOLDING:
            return Code.ALREADY_RUNNING
        if command == "RELEASE" and self.state not in (
            GripState.HOLDING,
            GripState.PART_LOST,
            GripState.NO_PART,
        ):
            return Code.FAILED
        return None

    def home(self, is_open: bool) -> None:
        """Begin the reference run."""
        self.is_homed = False
        self._begin("HOME", WIDTH_MAX if is_open else 0.0, _HOME_SPEED)
        self.state = GripState.POSITIONING

    def move(self, width: float, speed: float) -> None:
        """Begin to move to a width [m] at a speed [m/s]."""
        self._begin("MOVE", width, speed)
        self.state = GripState.POSITIONING

    def grip(self, force: float, width: float | None, speed: float) -> None:
        """Begin to close with a force [N], for a part of a width [m] or of any."""
        self._wanted, self._grip_force = width, force
        goal = 0.0 if width is None else max(0.0, width - self.clamping_travel)
        self._begin("GRIP", goal, speed)
        self.state = GripState.GRASPING

    def release(self, pullback: float, speed: float) -> None:
        """Begin to open by a way [m]."""
        self.force = 0.0
        self._begin("RELEASE", min(WIDTH_MAX, self.width() + pullback), speed)
        self.state = GripState.RELEASING

    def stop(self) -> None:
        """Stand still here; a motion under way ends as aborted."""
        self._start = self._goal = self.width()
        self._speed = 0.0

    def fast_stop(self) -> None:
        """Stand still, and refuse to move until acknowledged."""
        self.stop()
        self.motion = None
        self.force = 0.0
        self.is_fast_stopped = True
        self.state = GripState.ERROR

    def acknowledge(self) -> None:
        """End a fast stop."""
        self.is_fast_stopped = False
        if self.state == GripState.ERROR:
            self.state = GripState.IDLE

    def remove_part(self) -> None:
        """Take the part away; a grip loses it."""
        self.part_width = None
        if self.state == GripState.HOLDING:
            self.state, self.force = GripState.PART_LOST, 0.0

    def finish(self) -> tuple[str, Code | None] | None:
        """End a motion that has arrived.

        Returns:
            The motion's name and what went wrong, or None while it is under way.
        """
        if self.motion is None or self.width() != self._goal:
            return None
        name, self.motion = self.motion, None
        if self._speed == 0.0:
            self.state = GripState.IDLE
            return name, Code.ABORTED
        if name == "GRIP":
            return name, self._finish_grip()
        is_blocked = self._is_on_part
        self.state = GripState.IDLE
        self.is_homed |= name == "HOME" and not is_blocked
        return name, Code.AXIS_BLOCKED if is_blocked else None

    def _finish_grip(self) -> Code | None:
        if self._wanted is None or self._is_within_tolerance():
            self.state, self.force = GripState.HOLDING, self._grip_force
            return None
        if self._is_on_part and self.width() > self._wanted:
            self.state = GripState.ERROR
            return Code.AXIS_BLOCKED
        self.state = GripState.NO_PART
        return Code.FAILED

    def _is_within_tolerance(self) -> bool:
        return (
            self._is_on_part
            and self._wanted is not None
            and abs(self.width() - self._wanted) <= self.tolerance
        )

    def _begin(self, name: str, goal: float, speed: float) -> None:
        """Head for a goal; the part is in the way of fingers that close."""
        start = self.width()
        part = self.part_width
        self._is_on_part = part is not None and start >= part > goal
        self._start = start
        self._goal = part if part is not None and self._is_on_part else goal
        self._speed, self._began, self.motion = speed, time.monotonic(), name
