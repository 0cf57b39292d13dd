"""The control loop of the cockpit: a thread of its own that no page slows down.

A page reads `moment` and `status`, which are replaced as a whole. It calls `start`,
`stop` and the others, which only leave a command behind. A stop acts within a slice of
10 ms, everything else between two policy steps. After a stop nothing moves the arm
until `resume`, and commands from before the stop are dropped.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dovetail.arms.arm import ArmState, is_simulated, require_simulated
from dovetail.cockpit.choice import Choice, build, describe
from dovetail.cockpit.diary import Diary
from dovetail.cockpit.guide import Guide
from dovetail.cockpit.hand import Hand
from dovetail.cockpit.loop_thread import LoopThread
from dovetail.cockpit.pace import Pace
from dovetail.cockpit.paced_arm import PacedArm
from dovetail.cockpit.shutter import Shutter
from dovetail.cockpit.snapshot import Moment, Status, moment_of
from dovetail.cockpit.space_mouse import SpaceMouse
from dovetail.cockpit.stand import Stand
from dovetail.cockpit.trace import Trace
from dovetail.cockpit.wishes import Wishes
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.led import Led
from dovetail.envs.log_facts import observed_columns
from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_inside
from dovetail.errors import ArmError, ConfigError, DovetailError
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.types import Vec3

RESUME_AFTER = 1.0
"""A resume that comes sooner after a stop [s] is ignored: it was on its way before."""
_AGAIN = 0.03  # [s] after which a stop is repeated


class Session:
    """One arm, one policy, one person's hand, and the thread that runs them."""

    def __init__(
        self,
        choice: Choice,
        *,
        logs: Path | None = None,
        fixture: Sequence[float] | None = None,
    ) -> None:
        """Build everything, and hold the arm: a simulated one at a start.

        Args:
            choice: What runs.
            logs: Where Episode logs go, a folder that need not exist; None keeps none.
            fixture: Where it stands: x y z [m] of its frame and yaw [rad], world axes;
                None is the task's first trial pose.

        Raises:
            DovetailError: See `choice.build`.
        """
        self.pace, self.hand, self.guide = Pace(), Hand(), Guide()
        self.diary, self.trace = Diary(logs), Trace()
        self._wishes = Wishes()
        self._given = fixture
        self._is_running = self._is_paused = self._is_ready = False
        self._is_success = self._was_led = False
        self._doing = ""
        self._steps_left = 0
        self._note = ""
        self._stop_lock = threading.Lock()
        self._is_stopped, self._stops, self._stopped_at = False, 0, 0.0
        self._is_pressed = False
        self.moment: Moment | None = None
        """The newest slice; None before the first reset."""
        self.violations = 0
        """Control cycles that were outside a joint or wall limit, since the begin."""
        self.version = 0
        """Counts the cells that were built: another number, another scene."""
        self._thread = LoopThread(
            begin=lambda: self._install(choice),
            turn=self._take_turn,
            fail=self._fail,
            end=self._release,
        )

    # -- what a person wishes; from any thread -----------------------------------

    def start(self) -> None:
        """Let the policy move the arm; after a success, from a new start."""
        self._wish(self._start)

    def stop(self, *, is_pressed: bool = True) -> None:
        """Hold the arm now, not at the end of the step, and until `resume`.

        Args:
            is_pressed: Whether a person pressed STOP: an arm behind a service then
                stays stopped after this program has ended.
        """
        with self._stop_lock:
            self._is_stopped = True
            self._is_pressed = self._is_pressed or is_pressed
            self._stops += 1
            self._stopped_at = time.monotonic()
        if self._thread.is_ended:
            return
        self.hand.let_go()
        self._hold()
        self._wishes.put(self._rest)
        # The loop may have been about to free the arm, and have done so after the hold.
        time.sleep(_AGAIN)
        if self._is_stopped:
            self.hand.let_go()
            self._hold()

    def resume(self) -> None:
        """End a stop: the arm stays held until it is started, led or reset."""
        with self._stop_lock:
            is_soon = time.monotonic() - self._stopped_at < RESUME_AFTER
            self._is_stopped = self._is_stopped and is_soon
            self._is_pressed = self._is_pressed and is_soon

    @property
    def is_stopped(self) -> bool:
        """True while a stop holds; nothing moves the arm before `resume`."""
        return self._is_stopped

    def _wish(self, act: Callable[[], None]) -> None:
        """Leave a wish that moves the arm; a stop before it is fulfilled ends it."""
        stops = self._stops

        def wish() -> None:
            if not self._is_stopped and self._stops == stops:
                act()

        if not self._is_stopped:
            self._wishes.put(wish)

    def reset(self) -> None:
        """Bring the arm to a new start and hold it there."""
        self._wish(self._begin)

    def pause(self, paused: bool = True) -> None:
        """Let a simulation's time stand still, or go on."""
        self._wishes.put(lambda: self._pause(paused))

    def step(self) -> None:
        """Let one policy step of 50 ms pass, and pause."""
        self._wish(self._step_once)

    def cover(self, covered: bool) -> None:
        """Cover the camera, or uncover it."""
        self._shutter.is_covered = covered

    def pull(self, point: Vec3 | None) -> None:
        """Pull the tool towards a point [m], world axes; None lets go.

        Raises:
            ArmError: Nothing at this end can push the arm.
            ConfigError: The point is none.
        """
        if point is not None:
            require_simulated(self._core.arm)
            if not np.isfinite(point).all():
                raise ConfigError(f"the point to pull towards is {point} m")
            if self._is_stopped:
                return
        self.hand.pull_to = None if point is None else np.array(point, dtype=float)

    def drag(self, position: Vec3, yaw: float) -> None:
        """Drag the fixture to a position [m] and a turn about the vertical [rad].

        Raises:
            ArmError: Nothing at this end can move it.
            ConfigError: The arm could not work there.
        """
        require_simulated(self._core.arm)
        quat = quat_multiply(quat_about_z(yaw), np.array(self._stand.first.facing))
        pose = Pose(np.array(position, dtype=float), quat)
        require_inside(self._core.task, self._core.cell, self._core.arm, pose)
        if not self._is_stopped:
            self.hand.fixture_to = pose

    def demonstrate(self) -> None:
        """Begin a demonstration at a new start; one that runs ends and is kept."""
        self._wish(self._demonstrate)

    def end_demonstration(self, *, is_kept: bool) -> None:
        """Keep the demonstration, or throw it away: the one that runs or has ended.

        One that is kept before it succeeded is marked as unfinished.
        """
        self._wishes.put(lambda: self._end_demonstration(is_kept))

    def use_mouse(self, is_on: bool) -> None:
        """Lead by the 3D mouse of this machine, or no more; says what it lacks."""
        try:
            self.guide.take_mouse(SpaceMouse() if is_on else None)
        except DovetailError as error:
            self.say(str(error))

    def choose(self, choice: Choice) -> None:
        """Build something else; what cannot be built leaves everything as it is."""
        self._wish(lambda: self._rebuild(choice))

    def _hold(self) -> None:
        self.guide.let_go()
        try:
            self._arm.stop()
        except DovetailError as error:
            self.say(f"STOP did not reach the arm: {error}")

    # -- what is to be seen; from any thread --------------------------------------

    @property
    def core(self) -> ContactEnv:
        """The environment; only the loop's thread may change it."""
        return self._core

    @property
    def choice(self) -> Choice:
        """Policy, place and task that run now."""
        return self._choice

    @property
    def can_touch(self) -> bool:
        """True if the arm can be pulled and its fixture dragged."""
        return is_simulated(self._core.arm)

    @property
    def can_pause(self) -> bool:
        """True if time can stand still, and go on by a step."""
        return self.can_touch

    @property
    def can_pace(self) -> bool:
        """True if it can run slower or faster than the wall's clock."""
        return not self._core.arm.facts.traits.is_real_time

    @property
    def is_paused(self) -> bool:
        """True while a simulation's time stands still."""
        return self._is_paused

    def say(self, note: str) -> None:
        """Tell everybody something."""
        self._note = note

    @property
    def is_covered(self) -> bool:
        """True while the camera is covered."""
        return self._shutter.is_covered

    @property
    def status(self) -> Status:
        """Status of the loop."""
        modes = {
            "stopped": self._is_stopped or not self._is_ready,
            "paused": self._is_paused,
            "led": self._was_led,
            "running": self._is_running,
        }
        mode = next((mode for mode, is_so in modes.items() if is_so), "held")
        held = "stopped until Resume is pressed" if self._is_stopped else ""
        return Status(
            mode=self._doing or mode,
            is_stopped=self._is_stopped,
            note="; ".join(filter(None, (held, self._note, self.diary.problem))),
            rate=self.pace.rate,
            success=self._is_success,
            showing=self.diary.describe_demonstrations(),
        )

    def close(self) -> None:
        """Hold the arm, end the loop, write what was recorded, release the arm."""
        if self._thread.is_ended:
            return
        self._hold()
        self._thread.end()
        self.guide.take_mouse(None)
        self.diary.close()

    def _release(self) -> None:
        """Give the arm back, held; a service holds what its learner has left."""
        if not self._is_pressed:
            with contextlib.suppress(DovetailError):
                self._arm.end_hold()
        self._env.close()

    # -- the loop -----------------------------------------------------------------

    def _take_turn(self) -> None:
        """Do what was wished for, and let a policy step pass, or a moment."""
        self._wishes.fulfil(self.say)
        self._doing = ""
        self._follow_lead()
        is_still = self._is_paused and self._steps_left == 0
        is_moved = (self._is_acting and not self._arm.is_held) or self._was_led
        can_step = self._is_ready and (is_moved or self.can_touch)
        if is_still or not can_step:
            self._arm.rest(is_watched=self._is_ready)
            return
        self._steps_left = max(0, self._steps_left - 1)
        self._advance()

    @property
    def _is_acting(self) -> bool:
        """True if a policy or a demonstration goes on without a person who leads."""
        return self._is_running or self.diary.is_demonstration

    def _follow_lead(self) -> None:
        """Free the arm when a person begins to lead; hold it when the lead ends."""
        self._note = self.guide.lost() or self._note
        if self._is_stopped:
            self.guide.let_go()
        is_led = self.guide.is_leading and self._is_ready
        if is_led and not self._was_led:
            self._arm.clear()
        elif self._was_led and not is_led and not self._is_acting:
            self._arm.stop()
        self._was_led = is_led

    def _advance(self) -> None:
        """Let one policy step pass."""
        core = self._core
        action = np.zeros(len(core.commands), dtype=np.float32)
        if self._is_running and self._policy is not None and not self._arm.is_held:
            action = self._policy(self._observation)
        is_shown = self.diary.is_demonstration and not self._arm.is_held
        self.guide.is_teaching = is_shown and not self._is_running
        self._observation, reward, done, _, info = self._env.step(action)
        self._step += 1
        self._reward, self._depth = float(reward), float(info["depth"])
        self.violations += int(info["limit_violations"])
        is_idle = not (self._is_running or self.hand.is_busy or self._was_led)
        if is_shown or not self.diary.is_demonstration:
            self.diary.add(core.state, self._step, self._reward, info, is_idle=is_idle)
        self.diary.follow(core.state.stamp, core.fixture, self.moment)
        if done and self._is_acting:
            self.diary.end(success=True)
            self._is_success = True
            passed = core.state.stamp - self._started
            self._note = f"done, {passed:.1f} s after the start"
            self._hold()
            self._rest()

    def _fail(self, error: Exception) -> None:
        """Say why the arm does not follow any more; a reset begins anew."""
        self._hold()
        self._note = f"{error}. Reset begins anew"
        self._is_running = self._is_ready = self._was_led = False
        self.diary.end()
        if isinstance(error, ArmError) and isinstance(error.state, ArmState):
            self._see(error.state, self._core.fixture)

    def _see(self, state: ArmState, fixture: Pose) -> None:
        """Keep what the page shows; the environment learns where the fixture is."""
        core = self._core
        core.fixture = fixture
        pull = self.hand.force if self.hand.pull_to is not None else np.zeros(3)
        moment = moment_of(state, core, fixture, pull, self._arm.work)
        self.moment = replace(moment, reward=self._reward, depth=self._depth)
        self.trace.add(self.moment)

    # -- wishes; in the loop's thread ----------------------------------------------

    def _start(self) -> None:
        if self._policy is None:
            self._note = "there is no policy to start: choose one, or move the arm"
            return
        if self._is_success or not self._is_ready:
            self._begin()
        self._arm.clear()
        self._core.begin_acting()
        self._note = ""
        self._started = self._core.state.stamp
        self._is_paused = False
        self._is_running = True
        self.pace.begin()

    def _rest(self) -> None:
        self._is_running = False

    def _pause(self, paused: bool) -> None:
        self._is_paused = paused and self.can_pause
        self._steps_left = 0
        self.pace.begin()

    def _step_once(self) -> None:
        self._is_paused = self.can_pause
        self._steps_left = 1 if self.can_pause else 0

    def _demonstrate(self) -> None:
        if self.diary.folder is None:
            self._note = "a demonstration needs a folder: give --logs"
            return
        self._begin(is_drawn=self._core.places_fixture and self._given is None)
        self.diary.demonstrate()
        self._arm.clear()
        self._is_paused = False
        self._note = "lead the tool; then keep it, or throw it away"

    def _end_demonstration(self, is_kept: bool) -> None:
        self._note = self.diary.decide(is_kept)
        self._hold()
        self._rest()

    def _begin(self, is_drawn: bool = False) -> None:
        """Start an episode: a new start, the fixture where it is or drawn anew."""
        core = self._core
        self._is_running = self._is_success = False
        self._note = ""
        about, columns = describe(self._env, self._choice), observed_columns(self._env)
        self.diary.begin(about, columns)
        self.guide.reset()
        fixture = None if is_drawn else self._stand.pose(core, self._is_ready)
        self._is_ready, self._doing = False, "resetting"
        self._step, self._reward, self._depth = 0, 0.0, 0.0
        options = {"fixture": fixture}
        self._observation, info = self._env.reset(seed=self._seed, options=options)
        self._seed = None
        if self._policy is not None:
            self._policy.reset()
        self.diary.see_first(info["observation_raw"])
        self._depth = float(info["depth"])
        self._is_ready = True
        self._started = core.state.stamp
        self._arm.resume_from(core.state)
        if self.can_touch:
            self._arm.stop()
        self.trace.clear()
        self._see(core.state, core.fixture)
        self.diary.follow(core.state.stamp, core.fixture, self.moment)

    def _rebuild(self, choice: Choice) -> None:
        before = self._env
        if self._core.arm.facts.traits.is_real_time:
            self._note = "another choice for this arm needs another dovetail cockpit"
            return
        left = self._core.fixture if self._is_ready else None
        self._doing, self._is_running = "building", False
        try:
            self._install(choice, left)
        finally:
            if self._env is not before:
                before.close()

    def _install(self, choice: Choice, left: Pose | None = None) -> None:
        env, policy = build(choice, self._given)
        self.guide.let_go()
        self._env = Led(env, self.guide.action)
        self._policy, self._choice = policy, choice
        self._core = core = require_contact_env(env)
        was_covered = self.version > 0 and self._shutter.is_covered
        self._shutter = Shutter(core.tracker)
        self._shutter.is_covered = was_covered
        core.tracker = self._shutter
        core.arm = self._arm = PacedArm(
            core.arm, self.hand, self.pace, self._see, lambda: self._is_stopped
        )
        self._stand = Stand(core, self._given, left)
        self._seed: int | None = 0
        self._is_ready = False
        self.version += 1
        if self.can_touch:
            self._begin()
        else:
            self._note = "reset brings the arm to its start: it will move"
