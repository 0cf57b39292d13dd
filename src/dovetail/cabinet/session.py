"""The session's state, and the Java program that moves it: pure logic, no clock.

A real session is driven by a Java application on the cabinet. `Application` plays a
common one: it opens the session, starts a position hold with a torque overlay once the
link is good, and starts it again a while after it has ended.
"""

from typing import NamedTuple

from dovetail.cabinet.protocol import Quality, SessionState
from dovetail.errors import ConfigError


class SessionInputs(NamedTuple):
    """Inputs that decide the session's next state."""

    is_open: bool
    """The application holds a session."""
    quality: Quality
    """Quality of the link."""
    has_motion: bool
    """A motion with the overlay is running."""
    is_synchronised: bool
    """The client has mirrored the interpolator's position for long enough."""
    are_drives_active: bool
    """All drives are active and nothing has stopped them."""


def next_state(state: SessionState, now: SessionInputs) -> SessionState:
    """Return the session's state in the next message: at most one step on."""
    if not now.is_open:
        return SessionState.IDLE
    if state is SessionState.IDLE or now.quality < Quality.GOOD:
        return SessionState.MONITORING_WAIT
    if state is SessionState.MONITORING_WAIT or not now.has_motion:
        return SessionState.MONITORING_READY
    if state is SessionState.MONITORING_READY:
        return SessionState.COMMANDING_WAIT
    if state is SessionState.COMMANDING_ACTIVE:
        # Drives that fail end the motion; the session never steps back by itself.
        return SessionState.COMMANDING_ACTIVE
    if now.is_synchronised and now.are_drives_active:
        return SessionState.COMMANDING_ACTIVE
    return SessionState.COMMANDING_WAIT


class Application:
    """The Java application: opens the session, starts and restarts the motion."""

    def __init__(self, ready_slots: int, restart_slots: int | None) -> None:
        """Begin without a session.

        Args:
            ready_slots: Messages in MONITORING_READY before a motion starts.
            restart_slots: Messages after a motion that ended with an error before the
                next may start; None waits for `resume`.
        """
        self._ready_slots = ready_slots
        self._restart_slots = restart_slots
        self._ready = 0
        self._delay: int | None = 0  # messages still to wait; None is for ever
        self.is_open = False
        self.is_paused = False
        self.has_motion = False
        self.motions = 0
        """Motions started since the cabinet was."""
        self.sessions = 0
        """Sessions opened since the cabinet was."""
        self.stop_reason = ""
        """Reason why the last motion ended; empty while one runs."""

    def open(self) -> None:
        """Create the FRI session.

        Raises:
            ConfigError: One is open.
        """
        if self.is_open:
            raise ConfigError("a session is open: stop it first")
        self.is_open = True
        self.sessions += 1
        self._ready, self._delay = 0, 0

    def close(self) -> None:
        """Dispose of the session, and of the motion with it."""
        self.end_motion("session closed")
        self.is_open = False

    def pause(self) -> None:
        """End the motion and start none until `resume`."""
        self.end_motion("paused")
        self.is_paused = True

    def resume(self) -> None:
        """Allow motions again at once, and open a session where none is."""
        self.is_paused = False
        if not self.is_open:
            self.open()
        self._delay = 0

    def restart(self) -> None:
        """End the motion in good order, to start another; forget an earlier error."""
        self.end_motion("restarted")
        self._delay = 0

    def end_motion(self, reason: str, *, is_error: bool = False) -> None:
        """End the motion, if one runs.

        Args:
            reason: Why, for status and log.
            is_error: The next motion waits longer, or for `resume`.
        """
        if not self.has_motion:
            return
        self.has_motion = False
        self.stop_reason = reason
        self._ready = 0
        self._delay = self._restart_slots if is_error else 0

    def tick(self, state: SessionState) -> None:
        """Count one message in a state; start the motion when it is time."""
        if self.has_motion:
            if state is SessionState.MONITORING_WAIT:
                self.end_motion("connection quality lost")
            return
        if self._delay:
            self._delay -= 1
        is_ready = state is SessionState.MONITORING_READY
        self._ready = self._ready + 1 if is_ready else 0
        is_ready = is_ready and self._ready >= self._ready_slots
        if is_ready and self._delay == 0 and not self.is_paused:
            self.has_motion = True
            self.motions += 1
            self.stop_reason = ""
