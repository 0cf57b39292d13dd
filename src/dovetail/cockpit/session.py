"""The control loop of the cockpit: a thread of its own that no page slows down.

A page reads `snapshot` and `status`, which are replaced as a whole. It calls `start`,
`stop` and the others, which only queue a command. A stop acts within a slice of 10 ms,
everything else between two policy steps. After a stop nothing moves the arm until
`resume`, and commands from before the stop are dropped.
"""

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from dovetail.arms.arm import ArmState, is_simulated, require_simulated
from dovetail.cockpit.choice import Choice, build, describe
from dovetail.cockpit.disturbance import UserDisturbance
from dovetail.cockpit.episode_logger import EpisodeLogger
from dovetail.cockpit.occlusion import Occlusion
from dovetail.cockpit.pace import Pace
from dovetail.cockpit.paced_arm import PacedArm
from dovetail.cockpit.page_log import LOG
from dovetail.cockpit.snapshot import LoopStatus, Snapshot, Trace, take_snapshot
from dovetail.cockpit.space_mouse import SpaceMouse
from dovetail.cockpit.teleoperator import Teleoperator
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.log_facts import observed_columns, part_columns
from dovetail.envs.teleop import TeleopWrapper
from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_inside
from dovetail.errors import ArmError, ConfigError, DovetailError
from dovetail.poses import Pose, quat_about_z, quat_multiply, theta_about_vertical
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.types import Vec3

RESUME_AFTER = 1.0
"""A resume that comes sooner after a stop [s] is ignored: it was on its way before."""
_AGAIN = 0.03  # [s] after which a stop is repeated


class Session:
    """One arm, one policy, one user, and the thread that runs them."""

    core: ContactEnv
    """The environment; only the loop's thread may change it."""
    choice: Choice
    """Policy, place and task that run now."""

    def __init__(
        self,
        choice: Choice,
        *,
        logs: Path | None = None,
        fixture: Sequence[float] | None = None,
    ) -> None:
        """Build everything, and hold the arm: a simulated one at a start.

        Args:
            choice: Policy, place and task.
            logs: Folder of the Episode logs, which need not exist; None keeps none.
            fixture: Place of the fixture: x y z [m] of its frame, yaw and perhaps
                tilts B C [rad], world axes; None is the task's first trial pose.

        Raises:
            DovetailError: See `choice.build`.
        """
        self.pace, self.disturbance = Pace(), UserDisturbance()
        self.teleoperator = Teleoperator()
        self.logger, self.trace = EpisodeLogger(logs), Trace()
        self._commands: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._given = fixture
        self._is_running = self._is_paused = self._is_ready = False
        self._is_success = self._was_led = False
        self._doing = ""
        self._steps_left = 0
        self._note = ""
        self._stop_lock = threading.Lock()
        self._is_stopped, self._stops, self._stopped_at = False, 0, 0.0
        self._is_pressed = False
        self.snapshot: Snapshot | None = None
        """The newest slice; None before the first reset."""
        self.violations = 0
        """Control cycles outside a joint or wall limit, since the begin."""
        self.version = 0
        """Number of cells that were built: another number, another scene."""
        self._install(choice)
        self._is_ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="cockpit", daemon=True)
        self._thread.start()

    # -- commands; from any thread -------------------------------------------------

    def start(self) -> None:
        """Let the policy move the arm; after a success, from a new start."""
        self._post_motion(self._start)

    def stop(self, *, is_pressed: bool = True) -> None:
        """Hold the arm now, not at the end of the step, and until `resume`.

        Args:
            is_pressed: Whether the user pressed STOP: an arm behind a service then
                stays stopped after this program has ended.
        """
        with self._stop_lock:
            self._is_stopped = True
            self._is_pressed = self._is_pressed or is_pressed
            self._stops += 1
            self._stopped_at = time.monotonic()
        if self._is_ended.is_set():
            return
        self.disturbance.let_go()
        self._hold()
        self._commands.put(self._end_run)
        # The loop may have been about to free the arm, and have done so after the hold.
        time.sleep(_AGAIN)
        if self._is_stopped:
            self.disturbance.let_go()
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

    def _post_motion(self, act: Callable[[], None]) -> None:
        """Queue a command that moves the arm; a stop before its turn cancels it."""
        stops = self._stops

        def command() -> None:
            if not self._is_stopped and self._stops == stops:
                act()

        if not self._is_stopped:
            self._commands.put(command)

    def reset(self) -> None:
        """Bring the arm to a new start and hold it there."""
        self._post_motion(self._begin)

    def pause(self, paused: bool = True) -> None:
        """Let a simulation's time stand still, or go on."""
        self._commands.put(lambda: self._pause(paused))

    def step(self) -> None:
        """Let one policy step of 50 ms pass, and pause."""
        self._post_motion(self._step_once)

    def cover(self, covered: bool) -> None:
        """Cover the camera, or uncover it."""
        self._occlusion.is_covered = covered

    def pull(self, point: Vec3 | None) -> None:
        """Pull the tool towards a point [m], world axes; None lets go.

        Raises:
            ArmError: The arm is elsewhere and cannot be disturbed from here.
            ConfigError: The point is not finite.
        """
        if point is not None:
            require_simulated(self.core.arm)
            if not np.isfinite(point).all():
                raise ConfigError(f"the point to pull towards is {point} m")
            if self._is_stopped:
                return
        pull_to = None if point is None else np.array(point, dtype=float)
        self.disturbance.pull_to = pull_to

    def drag(self, position: Vec3, yaw: float) -> None:
        """Drag the fixture to a position [m] and a turn about the vertical [rad].

        Raises:
            ArmError: The arm is elsewhere and its fixture cannot be moved from here.
            ConfigError: The arm could not work there.
        """
        require_simulated(self.core.arm)
        facing = np.array(self.core.task.trial_poses[0].facing)
        now = self.core.fixture.quat_wxyz  # it may be tilted, and stays so
        turn = yaw - theta_about_vertical(now, facing)
        quat = quat_multiply(quat_about_z(turn), now)
        pose = Pose(np.array(position, dtype=float), quat)
        require_inside(self.core.task, self.core.cell, self.core.arm, pose)
        if not self._is_stopped:
            self.disturbance.fixture_to = pose

    def demonstrate(self) -> None:
        """Begin a demonstration at a new start; one that runs ends and is kept."""
        self._post_motion(self._demonstrate)

    def end_demonstration(self, *, is_kept: bool) -> None:
        """Keep the demonstration, or throw it away: the one that runs or has ended.

        One that is kept before it succeeded is marked as unfinished.
        """
        self._commands.put(lambda: self._end_demonstration(is_kept))

    def use_mouse(self, is_on: bool) -> None:
        """Lead by the 3D mouse of this machine, or no more; notes why it cannot."""
        try:
            self.teleoperator.take_mouse(SpaceMouse() if is_on else None)
        except DovetailError as error:
            self.say(str(error))

    def choose(self, choice: Choice) -> None:
        """Build another choice; one that cannot be built leaves everything as it is."""
        self._post_motion(lambda: self._rebuild(choice))

    def say(self, note: str) -> None:
        """Show a note to all viewers."""
        self._note = note

    def close(self) -> None:
        """Hold the arm, end the loop, write the log that runs, release the arm."""
        if self._is_ended.is_set():
            return
        self._hold()
        self._is_ended.set()
        self._thread.join()
        self.teleoperator.take_mouse(None)
        self.logger.close()

    def _hold(self) -> None:
        self.teleoperator.let_go()
        try:
            self._arm.stop()
        except DovetailError as error:
            self.say(f"STOP did not reach the arm: {error}")

    # -- state; from any thread ----------------------------------------------------

    @property
    def can_touch(self) -> bool:
        """True for a simulation: it can be pulled, its fixture dragged, time paused."""
        return is_simulated(self.core.arm)

    @property
    def can_pace(self) -> bool:
        """True if it can run slower or faster than the wall's clock."""
        return not self.core.arm.facts.traits.is_real_time

    @property
    def is_paused(self) -> bool:
        """True while a simulation's time stands still."""
        return self._is_paused

    @property
    def is_covered(self) -> bool:
        """True while the camera is covered."""
        return self._occlusion.is_covered

    @property
    def status(self) -> LoopStatus:
        """Status of the loop."""
        modes = {
            "stopped": self._is_stopped or not self._is_ready,
            "paused": self._is_paused,
            "led": self._was_led,
            "running": self._is_running,
        }
        mode = next((mode for mode, is_so in modes.items() if is_so), "held")
        held = "stopped until Resume is pressed" if self._is_stopped else ""
        return LoopStatus(
            mode=self._doing or mode,
            is_stopped=self._is_stopped,
            note="; ".join(filter(None, (held, self._note, self.logger.problem))),
            rate=self.pace.rate,
            success=self._is_success,
            demonstrations=self.logger.describe_demonstrations(),
        )

    # -- the loop ------------------------------------------------------------------

    def _run(self) -> None:
        """Take turns until the session is closed; then give the arm back, held."""
        while not self._is_ended.is_set():
            try:
                self._take_turn()
            except Exception as error:  # a task of one's own may raise anything
                self._fail(error)
                if not isinstance(error, DovetailError):
                    LOG.exception("page: a turn of the control loop failed")
        if not self._is_pressed:  # after a STOP a service stays stopped
            with contextlib.suppress(DovetailError):
                self._arm.end_hold()
        self._env.close()

    def _take_turn(self) -> None:
        """Carry out the commands, and let a policy step or a rest pass."""
        self._do_commands()
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

    def _do_commands(self) -> None:
        """Carry out the commands in order; one that fails is noted and dropped."""
        with contextlib.suppress(queue.Empty):
            while True:
                command = self._commands.get_nowait()
                try:
                    command()
                except DovetailError as error:
                    self.say(str(error))

    @property
    def _is_acting(self) -> bool:
        """True if a policy or a demonstration goes on while the user does not lead."""
        return self._is_running or self.logger.is_demonstration

    def _follow_lead(self) -> None:
        """Free the arm when the user begins to lead; hold it when the lead ends."""
        self._note = self.teleoperator.drop_lost_mouse() or self._note
        if self._is_stopped:
            self.teleoperator.let_go()
        is_led = self.teleoperator.is_leading and self._is_ready
        if is_led and not self._was_led:
            self._arm.clear()
        elif self._was_led and not is_led and not self._is_acting:
            self._arm.stop()
        self._was_led = is_led

    def _advance(self) -> None:
        """Let one policy step pass."""
        core = self.core
        action = np.zeros(len(core.commands), dtype=np.float32)
        if self._is_running and self._policy is not None and not self._arm.is_held:
            action = self._policy(self._observation)
        is_shown = self.logger.is_demonstration and not self._arm.is_held
        self.teleoperator.is_teaching = is_shown and not self._is_running
        self._observation, reward, done, _, info = self._env.step(action)
        self._step += 1
        self._reward, self._depth = float(reward), float(info["depth"])
        self.violations += int(info["limit_violations"])
        is_idle = not (self._is_running or self.disturbance.is_active or self._was_led)
        if is_shown or not self.logger.is_demonstration:
            self.logger.add(core.state, self._step, self._reward, info, is_idle=is_idle)
        self.logger.follow(core.state.stamp, core.fixture, self.snapshot)
        if done and self._is_acting:
            self.logger.end(success=True)
            self._is_success = True
            passed = core.state.stamp - self._started
            self._note = f"done, {passed:.1f} s after the start"
            self._hold()
            self._end_run()

    def _fail(self, error: Exception) -> None:
        """Note why the arm does not follow any more; a reset begins anew."""
        self._hold()
        self._note = f"{error}. Reset begins anew"
        self._is_running = self._is_ready = self._was_led = False
        self.logger.end()
        if isinstance(error, ArmError) and isinstance(error.state, ArmState):
            self._see(error.state, self.core.fixture)

    def _see(self, state: ArmState, fixture: Pose) -> None:
        """Take a snapshot of a slice; the environment learns the fixture's pose."""
        self.core.fixture = fixture
        is_pulled = self.disturbance.pull_to is not None
        self.snapshot = take_snapshot(
            self.core,
            state,
            fixture=fixture,
            pull=self.disturbance.force if is_pulled else np.zeros(3),
            reward=self._reward,
            depth=self._depth,
            work=self._arm.work,
        )
        self.trace.add(self.snapshot)

    # -- commands; in the loop's thread --------------------------------------------

    def _start(self) -> None:
        if self._policy is None:
            self._note = "there is no policy to start: choose one, or move the arm"
            return
        if self._is_success or not self._is_ready:
            self._begin()
        self._arm.clear()
        self.core.begin_acting()
        self._note = ""
        self._started = self.core.state.stamp
        self._is_paused = False
        self._is_running = True
        self.pace.begin()

    def _end_run(self) -> None:
        self._is_running = False

    def _pause(self, paused: bool) -> None:
        self._is_paused = paused and self.can_touch
        self._steps_left = 0
        self.pace.begin()

    def _step_once(self) -> None:
        self._is_paused = self.can_touch
        self._steps_left = 1 if self.can_touch else 0

    def _demonstrate(self) -> None:
        if self.logger.folder is None:
            self._note = "a demonstration needs a folder: give --logs"
            return
        self._begin(is_drawn=self.core.places_fixture and self._given is None)
        self.logger.begin_demonstration()
        self._arm.clear()
        self._is_paused = False
        self._note = "lead the tool; then keep it, or throw it away"

    def _end_demonstration(self, is_kept: bool) -> None:
        self._note = self.logger.end_demonstration(is_kept)
        self._hold()
        self._end_run()

    def _begin(self, is_drawn: bool = False) -> None:
        """Start an episode: a new start, the fixture where it is or drawn anew."""
        core = self.core
        self._is_running = self._is_success = False
        self._note = ""
        about, columns = describe(self._env, self.choice), observed_columns(self._env)
        self.logger.begin(about, columns, part_columns(self._env))
        self.teleoperator.reset()
        fixture = None if is_drawn else self._fixture_pose()
        self._is_ready, self._doing = False, "resetting"
        self._step, self._reward, self._depth = 0, 0.0, 0.0
        options = {"fixture": fixture}
        self._observation, info = self._env.reset(seed=self._seed, options=options)
        self._seed = None
        if self._policy is not None:
            self._policy.reset()
        self.logger.see_first(info["observation_raw"])
        self._depth = float(info["depth"])
        self._is_ready = True
        self._started = core.state.stamp
        self._arm.resume_from(core.state)
        if self.can_touch:
            self._arm.stop()
        self.trace.clear()
        self._see(core.state, core.fixture)
        self.logger.follow(core.state.stamp, core.fixture, self.snapshot)

    def _fixture_pose(self) -> Pose:
        """Return the fixture's pose for a reset: where it stands, or its first place.

        The first place is the one in the cell before, if this task can be done there,
        the one given, or the task's own.
        """
        core, left = self.core, self._left
        if self._is_ready:
            return core.fixture
        if left is not None:
            with contextlib.suppress(ConfigError):
                require_inside(core.task, core.cell, core.arm, left)
                return left
        first = core.task.trial_poses_in(core.cell)[0]
        if self._given is not None:
            return FixturePose.given(self._given, first.facing).pose()
        return first.pose()

    def _rebuild(self, choice: Choice) -> None:
        before = self._env
        if self.core.arm.facts.traits.is_real_time:
            self._note = "another choice for this arm needs another dovetail cockpit"
            return
        left = self.core.fixture if self._is_ready else None
        self._doing, self._is_running = "building", False
        try:
            self._install(choice, left)
        finally:
            if self._env is not before:
                before.close()

    def _install(self, choice: Choice, left: Pose | None = None) -> None:
        """Build a choice in place of the one that runs.

        Args:
            choice: Policy, place and task.
            left: Pose of the fixture in the cell before; None is unknown.
        """
        env, policy = build(choice, self._given)
        self.teleoperator.let_go()
        self._env = TeleopWrapper(env, self.teleoperator.action)
        self._policy, self.choice = policy, choice
        self.core = core = require_contact_env(env)
        was_covered = self.version > 0 and self._occlusion.is_covered
        self._occlusion = core.tracker = Occlusion(core.tracker)
        self._occlusion.is_covered = was_covered
        core.arm = self._arm = PacedArm(
            core.arm,
            self.disturbance,
            self.pace,
            self._see,
            lambda: self._is_stopped,
        )
        self._left = left
        self._seed: int | None = 0
        self._is_ready = False
        self.version += 1
        if self.can_touch:
            self._begin()
        else:
            self._note = "reset brings the arm to its start: it will move"
