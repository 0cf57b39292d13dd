"""The cabinet without its network: what happens in one send period, and on request.

Each period is `begin` (what the monitoring message says), any number of `receive`
(commands that arrived), and `finish` (quality, the command's effect, the physics).
"""

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.cabinet.body import ArmBody
from dovetail.cabinet.command_policy import CommandPolicy
from dovetail.cabinet.config import CabinetConfig
from dovetail.cabinet.protocol import (
    CommandMode,
    DriveState,
    Quality,
    SafetyState,
    SessionState,
)
from dovetail.cabinet.quality import LinkQuality
from dovetail.cabinet.session import Application, SessionInputs, next_state
from dovetail.cabinet.signals import SignalTable
from dovetail.cabinet.stops import StopCategory
from dovetail.poses import Pose
from dovetail.types import Vec3, Vec7

if TYPE_CHECKING:
    from collections.abc import Callable

    from dovetail.plants.plant import DrivenPlant

_COMMANDING = (SessionState.COMMANDING_WAIT, SessionState.COMMANDING_ACTIVE)
_CATEGORIES = {
    SafetyState.STOP_0: StopCategory.BRAKES,
    SafetyState.STOP_1: StopCategory.RAMP,
    SafetyState.STOP_2: StopCategory.HOLD,
}
_WRAP = 1 << 32
"""Counters on the wire are unsigned, 32 bit."""


class RobotController:
    """Session, quality, motion and arm; no socket, no clock."""

    def __init__(
        self,
        plant: "DrivenPlant",
        config: CabinetConfig,
        report: "Callable[..., None] | None" = None,
    ) -> None:
        """Begin in IDLE, with the session about to be opened.

        Args:
            plant: The arm, reset.
            config: Settings.
            report: Called as report(event, **facts) for the log.
        """
        self.config = config
        self.body = ArmBody(plant, config)
        self.quality = LinkQuality(config)
        delay, period = config.restart_delay, config.period
        self.application = Application(
            config.ready_slots, None if delay is None else round(delay / period)
        )
        self.policy = CommandPolicy(config, plant.robot)
        self.signals = SignalTable(config.io)
        self.transformations: dict[str, Any] = {}
        """Last answer to each requested transformation."""
        self.counts: Counter[str] = Counter()
        """Number of events of each kind since the cabinet was started."""
        self._report = report or (lambda event, **facts: None)
        self.state = SessionState.IDLE
        self.sequence = 0
        """Sequence counter of the last monitoring message."""
        self.reflected = 0
        """Sequence counter of the last command received."""
        self.safety = SafetyState.NORMAL_OPERATION
        self._safety_left = 0
        self._drives = 0
        self._phase = 0
        """Messages of the current receive slot, this one included."""
        self._slot_start = 0
        self.command: Any = None
        """The command received in this receive slot."""
        self.is_abandoned = False
        """A request has made the current period void."""
        self.next_sequence = 0
        self.application.open()

    # -- one period --------------------------------------------------------------

    @property
    def quality_value(self) -> Quality:
        """The link's quality now."""
        return self.quality.value

    @property
    def drive_state(self) -> DriveState:
        """State of all drives."""
        if not self.application.has_motion or self.safety:
            return DriveState.OFF
        if self._drives < self.config.drive_slots:
            return DriveState.TRANSITIONING
        return DriveState.ACTIVE

    def begin(self) -> None:
        """Move the session on and number the next message."""
        if self._safety_left:
            self._safety_left -= 1
            if not self._safety_left:
                self.safety = SafetyState.NORMAL_OPERATION
                self._report("safety", state=self.safety.name)
        application = self.application
        situation = SessionInputs(
            application.is_open,
            self.quality.value,
            application.has_motion,
            self.policy.is_synchronised,
            self.drive_state is DriveState.ACTIVE,
        )
        state = next_state(self.state, situation)
        if state is not self.state:
            self._enter(state)
        if application.has_motion:
            self._drives += 1
        # A motion starts from rest, and not while the safety controller stops it.
        if application.has_motion or (self.body.is_braked and not self.safety):
            application.tick(state)
        self.sequence = self.next_sequence
        self.next_sequence = (self.sequence + 1) % _WRAP
        if self._phase == 0:
            self._slot_start = self.sequence
            self.command = None
        self._phase += 1
        self.is_abandoned = False
        self.counts["sent"] += 1

    def _enter(self, state: SessionState) -> None:
        last, self.state = self.state, state
        if state is SessionState.COMMANDING_WAIT:
            self.policy.begin(self.body.q.tolist())
            self._drives = 0
        elif state is SessionState.COMMANDING_ACTIVE:
            self.body.release()
        elif last is SessionState.COMMANDING_ACTIVE:
            self.body.stop()
        if state is SessionState.MONITORING_WAIT and last in _COMMANDING:
            self.application.end_motion("connection quality lost")
        if state is SessionState.MONITORING_WAIT and last is SessionState.IDLE:
            self.quality.reset()
        reason = self.application.stop_reason if last in _COMMANDING else ""
        self._report("state", state=state.name, last=last.name, reason=reason)

    @property
    def is_slot_end(self) -> bool:
        """True if this message is the last of its receive slot."""
        return self._phase >= self.config.receive_multiplier

    def receive(self, command: Any) -> bool:
        """Take a command that arrived now; one counts in each receive slot.

        Returns:
            Whether it counts: it answers a message of this slot, and is the first.
        """
        self.counts["received"] += 1
        behind = (self.sequence - command.reflected) % _WRAP
        if behind > (self.sequence - self._slot_start) % _WRAP:
            self.counts["late" if behind < _WRAP // 2 else "ahead"] += 1
            return False
        if self.command is not None:
            self.counts["duplicates"] += 1
            return False
        self.command = command
        self.reflected = command.sequence
        self._take_signals(command)
        return True

    def _take_signals(self, command: Any) -> None:
        for write in command.io:
            if not self.signals.write(*write):
                self._report("io", refused=self.signals.last_refusal)
        for name, values in command.transformations:
            if name in self.config.transformations:
                self.transformations[name] = values
            else:
                self.counts["unknown_transformations"] += 1

    def finish(self) -> None:
        """Judge the receive slot, and let the arm pass one period."""
        if self.is_abandoned:
            self._phase = 0
            return
        reason = ""
        if self.is_slot_end:
            self._phase = 0
            reason = self._judge()
        if self.state is SessionState.COMMANDING_ACTIVE and not reason:
            policy = self.policy
            if policy.is_silent:
                self.body.slow_down()
            else:
                self.body.drive(policy.q, policy.tau, policy.wrench)
            reason = self.body.failure or policy.check_joints(
                self.body.q.tolist(), self.body.dq.tolist()
            )
            if reason:  # the arm is where no ramp may lead it on
                self.stop_motion(reason, StopCategory.BRAKES)
        elif reason:
            self.stop_motion(reason)
            self.body.hold()
        else:
            self.body.hold()

    def _judge(self) -> str:
        """Count the reply of this slot, and return why it stops the motion."""
        command = self.command
        self.counts["due"] += 1
        if command is None:
            self.counts["missed"] += 1
        self.quality.add(command is not None)
        if self.state is SessionState.COMMANDING_WAIT:
            self.policy.mirror(command)
        elif self.state is SessionState.COMMANDING_ACTIVE:
            self.counts["active_due"] += 1
            self.counts["active_missed"] += command is None
            q, gravity = self.body.q.tolist(), self.body.gravity.tolist()
            return self.policy.act(command, q, gravity)
        return ""

    def stop_motion(
        self, reason: str, category: StopCategory = StopCategory.RAMP
    ) -> None:
        """End the motion with an error."""
        self.body.stop(category)
        if self.application.has_motion:
            self.counts["stops"] += 1
            time = self.body.time
            self._report("stop", reason=reason, category=int(category), time=time)
        self.application.end_motion(reason, is_error=True)

    # -- requests ----------------------------------------------------------------

    def place(self, q: Vec7, fixture: Pose, seed: int | None) -> None:
        """Put the arm at rest at q [rad], the fixture at its pose; restart the motion.

        Raises:
            ConfigError: The fixture is out of reach, or q is not seven finite numbers.
        """
        if seed is not None:
            self.body.plant.seed(seed)
        self.body.place(q, fixture)
        self._restart("placed")

    def _restart(self, what: str) -> None:
        self.application.restart()
        self.is_abandoned = True
        if self.state in _COMMANDING:
            # At once: the message after this request belongs to no motion.
            self.application.stop_reason = what
            self._enter(SessionState.MONITORING_READY)

    def pause(self) -> None:
        """End the motion in good order and start none until `resume`."""
        self.application.pause()
        self.is_abandoned = True

    def resume(self) -> None:
        """Allow motions again, and open a session where none is."""
        self.application.resume()

    def stop(self) -> None:
        """Dispose of the session."""
        self.application.close()
        self.is_abandoned = True

    def stop_safely(self, level: SafetyState, duration: float) -> None:
        """Stop the arm as the safety controller does, for a duration [s]."""
        self.safety = level
        self._safety_left = max(1, round(duration / self.config.period))
        self._report("safety", state=level.name)
        name = level.name.lower().replace("_", " ")
        self.stop_motion(f"safety stop, {name}", _CATEGORIES[level])

    def push(self, force: Vec3, duration: float) -> None:
        """Push the TCP with a force [N], world axes, for a duration [s]."""
        self.body.push(force, duration)

    @property
    def command_mode(self) -> CommandMode:
        """Command that the running motion expects from the client."""
        return self.policy.mode if self.state in _COMMANDING else CommandMode.NONE

    @property
    def q_ipo(self) -> list[float] | None:
        """The interpolator's position [rad]; None outside commanding."""
        return self.policy.q_ipo if self.state in _COMMANDING else None

    @property
    def q_commanded(self) -> list[float]:
        """Commanded configuration [rad]."""
        if self.state in _COMMANDING:
            return self.policy.q
        return self.body.q.tolist()

    @property
    def tracking(self) -> float:
        """Tracking performance on the wire: share of commands in time, while active."""
        if self.state is SessionState.COMMANDING_ACTIVE:
            return self.quality.ratio
        return 0.0

    def truth(self) -> dict[str, Any]:
        """Return what only the simulation knows; for tables of tests."""
        pose = self.body.plant.tool_pose()
        return {
            "time": self.body.time,
            "motion": self.application.motions,
            "tool": {
                "position": pose.position.tolist(),
                "quat_wxyz": np.asarray(pose.quat_wxyz).tolist(),
            },
            "contact_force_peak": list(self.body.take_contact_peak()),
        }

    def status(self) -> dict[str, Any]:
        """Return state, quality and counts."""
        application = self.application
        return {
            "state": self.state.name,
            "quality": self.quality.value.name,
            "ratio": round(self.quality.ratio, 4),
            "safety": self.safety.name,
            "drives": self.drive_state.name,
            "braked": self.body.is_braked,
            "category": self.body.category,
            "sequence": self.sequence,
            "session": application.sessions,
            "motion": application.motions,
            "paused": application.is_paused,
            "waits_for": (
                self.policy.waits_for
                if self.state is SessionState.COMMANDING_WAIT
                else ""
            ),
            "stop_reason": application.stop_reason,
            "time": self.body.time,
            "counts": dict(self.counts),
            "io": dict(self.signals.values),
            "io_refused": self.signals.last_refusal,
            "transformations": dict(self.transformations),
        }
