"""An arm in the cockpit: stepped in slices, at the wall's pace, disturbed and held.

The environment steps it as any other arm. A policy step of 50 ms is cut into slices of
10 ms where the arm is a simulation, so that a user's disturbance or stop acts soon.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmFacts, ArmState, is_simulated, require_simulated
from dovetail.cockpit.disturbance import UserDisturbance
from dovetail.cockpit.pace import Pace
from dovetail.errors import ArmError
from dovetail.poses import Pose
from dovetail.types import Vec3

SLICE = 0.01
"""Duration of one step of a simulation [s]: a multiple of each control period."""
_NAP = 0.02  # [s] of a rest
_LOOK = 0.5  # [s] between two checks of an arm that another process moves


class PacedArm:
    """Wraps an arm: a user disturbs and stops it, and `pace` sets its speed."""

    fixture: Pose
    """Pose of the fixture; `reset` sets it first."""
    work = 0.0
    """Computing time of the last slice [s]."""

    def __init__(
        self,
        arm: Arm,
        disturbance: UserDisturbance,
        pace: Pace,
        on_slice: Callable[[ArmState, Pose], None],
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Wrap an arm.

        Args:
            arm: The arm; closed with this one.
            disturbance: Acts on it, where it is a simulation.
            pace: Limits the speed of simulated time.
            on_slice: Called after each slice with the arm's state and the fixture's
                pose; it must not take long.
            is_stopped: Returns whether a STOP holds: then `clear` does nothing.
        """
        self._arm, self._disturbance, self._pace = arm, disturbance, pace
        self._on_slice, self._is_stopped = on_slice, is_stopped
        self._hold: _core.Target | None = None
        self._is_held = False
        self._state: ArmState | None = None
        self._looked = 0.0

    @property
    def facts(self) -> ArmFacts:
        """Constants of the arm."""
        return self._arm.facts

    def reset(self, q: np.ndarray, fixture: Pose) -> ArmState:
        """Go to q [rad], at rest, with the fixture at its pose, undisturbed.

        Raises:
            ArmError: A STOP holds; or as the arm's own.
        """
        self._disturbance.let_go()
        if self._is_stopped():
            raise ArmError("STOP was pressed before the arm was reset", "stopped")
        if self._is_held:  # a service that was stopped refuses a reset
            self.clear()
        self.fixture = fixture
        self._state = state = self._arm.reset(q, fixture)
        self._pace.begin()
        return state

    def resume_from(self, state: ArmState) -> None:
        """Go on from a state that the arm returned elsewhere, as in a tare."""
        self._state = state

    def step(self, target: _core.Target, duration: float = 0.05) -> ArmState:
        """Follow the target for a duration [s], or hold where `stop` was called.

        Raises:
            ConfigError: The duration is not a whole number of slices.
            ArmError: As the arm's own.
        """
        if not is_simulated(self._arm):
            return self._slice(self._commanded(target, 0.0), duration)
        is_whole = self.facts.traits.is_real_time  # it keeps its own time, step by step
        count = 1 if is_whole else max(1, round(duration / SLICE))
        length = SLICE if count > 1 else duration
        parts = []
        for i in range(count):
            state, before = self._state, self.fixture
            if self._disturbance.is_active and state is not None:
                arm = require_simulated(self._arm)
                self.fixture = self._disturbance.act(
                    arm, state.tool.position, before, length
                )
            parts.append(self._slice(self._commanded(target, i * length), length))
        return _joined(parts)

    def rest(self, *, is_watched: bool) -> None:
        """Wait 20 ms without a step.

        Args:
            is_watched: Check every half second that an arm elsewhere still answers.

        Raises:
            ArmError: It does not: without a step nothing else tells.
        """
        time.sleep(_NAP)
        self._pace.begin()
        now = time.monotonic()
        if not is_watched or now < self._looked + _LOOK:
            return
        self._looked = now
        if problem := self._arm.statistics().get("problem"):
            raise ArmError(f"the held arm follows no more: {problem}", "lost")

    def _slice(self, target: _core.Target, duration: float) -> ArmState:
        begin = time.perf_counter()
        self._state = state = self._arm.step(target, duration)
        self.work = time.perf_counter() - begin
        if not self.facts.traits.is_real_time:
            self._pace.wait(duration)
        self._on_slice(state, self.fixture)
        return state

    def _commanded(self, target: _core.Target, age: float) -> _core.Target:
        """Return the target of a slice: the one given, or the hold's."""
        hold = self._hold
        command = _core.Target(target)
        if hold is None:
            command.age = target.age + age
            return command
        # The tare goes on holding the weight, and the plane near contact stays.
        command.f_star = np.array(target.f_tare)
        command.stay = 0b111
        command.position_d, command.quat_wxyz_d = hold.position_d, hold.quat_wxyz_d
        return command

    def stop(self) -> None:
        """Hold the arm where it is from the next slice on, until `clear` or `reset`.

        Raises:
            ArmError: An arm elsewhere cannot be reached.
        """
        self._is_held = True
        if self._state is not None:  # None until the first reset has come to its end
            hold, tool = _core.Target(), self._state.tool
            hold.position_d, hold.quat_wxyz_d = tool.position, tool.quat_wxyz
            self._hold = hold
        if not is_simulated(self._arm):
            self._arm.stop()

    def clear(self) -> None:
        """End a stop, unless a STOP of the user holds."""
        if not self._is_stopped():
            self.end_hold()

    def end_hold(self) -> None:
        """End a stop, also a STOP of the user."""
        self._arm.clear()
        self._hold, self._is_held = None, False

    @property
    def is_held(self) -> bool:
        """True while a stop holds the arm."""
        return self._is_held

    def push(self, force: Vec3, duration: float) -> None:
        """Push the TCP with a force [N], world axes, for a duration [s]."""
        require_simulated(self._arm).push(force, duration)

    def move_fixture(self, fixture: Pose, velocity: Vec3) -> None:
        """Put the fixture at a pose; it then moves at a velocity [m/s], world axes."""
        require_simulated(self._arm).move_fixture(fixture, velocity)

    def grasp(self, offset: Pose) -> None:
        """Displace the held part in the fingers, from the next reset on."""
        require_simulated(self._arm).grasp(offset)

    def seed(self, seed: int) -> None:
        """Start a simulation's noise again."""
        self._arm.seed(seed)

    def statistics(self) -> dict[str, Any]:
        """Return the arm's counters and times."""
        return self._arm.statistics()

    def close(self) -> None:
        """Release the arm."""
        self._arm.close()


def _joined(parts: list[ArmState]) -> ArmState:
    """Return the slices of a step as one state: the last, with the largest force."""
    flags = 0
    for part in parts:
        flags |= part.flags
    sizes = [float(np.linalg.norm(part.contact_force)) for part in parts]
    force = parts[int(np.argmax(sizes))].contact_force
    log = np.vstack([part.log for part in parts])
    return parts[-1]._replace(contact_force=force, flags=flags, log=log)
