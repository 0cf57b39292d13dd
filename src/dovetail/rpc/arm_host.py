"""The arm that a service owns: built anew for each learner's settings, held when told.

Who may move it is the lease's business; whether it can be moved is decided here.
"""

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from dovetail.arms.arm import Arm, ArmState
from dovetail.control.settings import ControllerSettings
from dovetail.errors import ArmError
from dovetail.poses import Pose
from dovetail.rpc.offered_arm import OfferedArm
from dovetail.types import Array, Vec7

if TYPE_CHECKING:
    from dovetail import _core

ROWS_KEPT = 120_000
"""Control cycles of a motion that are kept for its log: 10 min at 5 ms, 40 MB."""


class Stop(NamedTuple):
    """Reason why the arm may not move."""

    reason: str
    """In words."""
    is_ordered: bool
    """True if it was asked for: then only `clear` ends it, not a reset."""


class StatusReport(NamedTuple):
    """State of the arm, as it is sent to watchers."""

    serial: int
    """Grows with every report."""
    state: ArmState | None
    """Newest state; None before the first reset."""
    stop: Stop | None
    """Reason why the arm may not move; None if it may."""


class ArmHost:
    """One arm, one motion at a time, its log, and the report to its watchers."""

    def __init__(self, offered: OfferedArm) -> None:
        """Own the arm; nothing is built before `configure`."""
        self.offered = offered
        self.settings: ControllerSettings | None = None
        self._configured = b""
        self._arm: Arm | None = None
        self.on_news: Callable[[], None] = lambda: None
        """Called, in any thread, when `report` has changed; it must not block."""
        self._turn = threading.Lock()
        self._news = threading.Lock()
        self._report = StatusReport(0, None, None)
        self._ending: Stop | None = None
        self._in_motion = False
        self._blocks: deque[tuple[int, Array]] = deque()
        self._rows = 0
        self._steps = 0

    @property
    def report(self) -> StatusReport:
        """The newest report for watchers."""
        return self._report

    @property
    def stop_reason(self) -> str:
        """Reason why the arm may not move; empty if it may."""
        stop = self._report.stop
        return "" if stop is None else stop.reason

    def configure(self, settings: ControllerSettings, key: bytes) -> bool:
        """Build the arm with new settings.

        Args:
            settings: Checked.
            key: Equal for equal settings; nothing is rebuilt for the same again.

        Returns:
            Whether an arm was built.

        Raises:
            ArmError: The arm is moving.
            ConfigError: The settings do not fit the arm, which stays as it is.
        """
        if not self._turn.acquire(blocking=False):
            raise ArmError(
                "settings cannot change while the arm moves: a step or reset is under "
                "way; wait for its answer, or stop the arm"
            )
        try:
            if self._arm is not None and key == self._configured:
                return False
            is_held = self._report.stop is not None
            if self.offered.address.is_real_time and self._in_motion and not is_held:
                raise ArmError(
                    "settings cannot change while the arm follows a target in real "
                    "time; stop it first"
                )
            self.offered.require_fit(settings)
            self._arm, self._configured = None, b""
            self._in_motion = False
            self._arm = self.offered.build(settings)
            self.settings, self._configured = settings, key
            return True
        finally:
            self._turn.release()

    def reset(
        self,
        q: Vec7,
        fixture: Pose,
        seed: int | None,
        require: Callable[[], object] = lambda: None,
    ) -> ArmState:
        """Go to q [rad], at rest; the log begins again.

        Args:
            q: Joint positions [rad].
            fixture: Pose of the fixture.
            seed: Of a simulation's noise; None lets it go on.
            require: Raises where the caller has lost the arm while it waited: the stop
                that its loss brought must not be ended by it.

        Raises:
            ArmError: Not configured, or stopped by someone's order.
        """
        with self._turn:
            arm = self._require_arm()
            stop = self._report.stop
            require()
            if stop is not None and stop.is_ordered:
                raise ArmError(f"the arm is stopped ({stop.reason}): clear it first")
            with self._ends(stop):  # the arm ends it, unless it refuses
                if seed is not None:
                    arm.seed(seed)
                state = arm.reset(q, fixture)
            self._in_motion = True
            self._blocks.clear()
            self._rows = self._steps = 0
            # Only this stop: one that came during the reset is newer than the reset.
            self._publish(state, ended=stop)
            return state

    def step(self, target: "_core.Target", duration: float) -> ArmState:
        """Follow a target for a duration [s].

        Raises:
            ArmError: Not reset, or stopped; says why.
        """
        with self._turn:
            arm = self._require_arm()
            if (stop := self._report.stop) is not None:
                raise ArmError(
                    f"the arm is stopped ({stop.reason}): "
                    + ("clear it" if stop.is_ordered else "clear or reset it")
                )
            if not self._in_motion:
                raise ArmError("the arm has not been reset since it was configured")
            state = arm.step(target, duration)
            self._keep(state.log)
            self._publish(state)
            return state

    def stop(self, reason: str, *, is_ordered: bool) -> None:
        """Hold the arm now, also while a step is under way in another thread."""
        with self._news:
            before = self._report.stop
            if before is None or is_ordered or not before.is_ordered:
                stop = Stop(reason, is_ordered)
                self._report = StatusReport(
                    self._report.serial + 1, self._report.state, stop
                )
        self.on_news()
        self._hold()

    def clear(self, require: Callable[[], object] = lambda: None) -> None:
        """Let the arm move again; `require` as in `reset`."""
        with self._turn:
            stop = self._report.stop
            require()
            if stop is not None:
                with self._ends(stop):
                    if self._arm is not None:
                        self._arm.clear()
                    self.hold_if_stopped()
                self._publish(self._report.state, ended=stop)

    def hold_if_stopped(self) -> None:
        """Hold the arm again if a stop is in force, except one that is being ended.

        An arm ends its stop when a reset or a clear begins; a stop that came a moment
        earlier would end, too.
        """
        stop = self._report.stop
        if stop is not None and stop is not self._ending:
            self._hold()

    def notes(self) -> list[str]:
        """Return what the arm wants a person to know, such as refused priorities."""
        arm = self._arm  # read once, as in `_hold`
        return [] if arm is None else list(arm.statistics()["notes"])

    def cycles(self) -> list[tuple[int, Array]]:
        """Return step numbers and cycle logs of the motion since its reset."""
        with self._turn:
            return list(self._blocks)

    def close(self) -> None:
        """Hold the arm, then release it."""
        self.stop("the service has closed", is_ordered=False)
        with self._turn:
            self._arm = None
            self.offered.close()

    @contextmanager
    def _ends(self, stop: Stop | None) -> Iterator[None]:
        """Mark a stop as being ended."""
        self._ending = stop
        try:
            yield
        finally:
            self._ending = None

    def _hold(self) -> None:
        arm = self._arm  # read once: another thread may put another arm, or none
        if arm is not None:
            arm.stop()

    def _require_arm(self) -> Arm:
        if self._arm is None:
            raise ArmError("the arm has no settings yet: configure it first")
        return self._arm

    def _keep(self, log: Array) -> None:
        self._blocks.append((self._steps, log))
        self._steps += 1
        self._rows += len(log)
        while self._rows > ROWS_KEPT and len(self._blocks) > 1:
            self._rows -= len(self._blocks.popleft()[1])

    def _publish(self, state: ArmState | None, ended: Stop | None = None) -> None:
        """Publish a state; a stop stays unless it is the one that has ended."""
        with self._news:
            stop = self._report.stop
            stop = None if stop is ended else stop
            self._report = StatusReport(self._report.serial + 1, state, stop)
        self.on_news()
