"""The control loop of the cockpit: a thread of its own that no page slows down.

Whoever shows it reads `moment` and `status`, which are replaced as a whole; whoever
drives it calls `start`, `stop` and the others, which only leave a wish behind. A stop
acts within a slice of 10 ms, everything else between two policy steps.
"""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dovetail.arms.arm import ArmState, is_simulated, require_simulated
from dovetail.cockpit.choice import Choice, build, describe, require_place
from dovetail.cockpit.diary import Diary
from dovetail.cockpit.hand import Hand
from dovetail.cockpit.pace import Pace
from dovetail.cockpit.paced_arm import PacedArm
from dovetail.cockpit.shutter import Shutter
from dovetail.cockpit.snapshot import Moment, Status, known_force, used_limits
from dovetail.cockpit.trace import Trace
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.unwrapped import require_contact_env
from dovetail.envs.workspace import require_inside
from dovetail.errors import ArmError, ConfigError, DovetailError
from dovetail.poses import Pose, quat_about_z, quat_multiply
from dovetail.tasks.fixture_pose import FixturePose
from dovetail.types import Vec3, Vec4
from dovetail.workcell.workcell import Workcell

_NAP = 0.02  # [s] between two looks at the wishes while nothing moves


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
        self.pace, self.hand = Pace(), Hand()
        self.diary, self.trace = Diary(logs), Trace()
        self._wishes: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._given = fixture
        self._left: Pose | None = None  # where it stood in the cell before
        self._is_ended = threading.Event()
        self._is_running = self._is_paused = self._is_ready = False
        self._is_success = self._is_building = False
        self._steps_left = 0
        self._note = ""
        self.moment: Moment | None = None
        """The newest slice; None before the first reset."""
        self.violations = 0
        """Control cycles that were outside a joint or wall limit, since the begin."""
        self.version = 0
        """Counts the cells that were built: another number, another scene."""
        self._install(choice)
        self._thread = threading.Thread(target=self._loop, name="cockpit", daemon=True)
        self._thread.start()

    # -- what a person wishes; from any thread -----------------------------------

    def start(self) -> None:
        """Let the policy move the arm; after a success, from a new start."""
        self._wishes.put(self._start)

    def stop(self) -> None:
        """Hold the arm: now, not at the end of the step."""
        self._arm.stop()
        self._wishes.put(self._hold)

    def reset(self) -> None:
        """Bring the arm to a new start and hold it there."""
        self._wishes.put(self._begin)

    def pause(self, paused: bool = True) -> None:
        """Let a simulation's time stand still, or go on."""
        self._wishes.put(lambda: self._pause(paused))

    def step(self) -> None:
        """Let one policy step of 50 ms pass, and pause."""
        self._wishes.put(self._step_once)

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
        self.hand.pull_to = None if point is None else np.array(point, dtype=float)

    def drag(self, position: Vec3, yaw: float) -> None:
        """Drag the fixture to a position [m] and a turn about the vertical [rad].

        Raises:
            ArmError: Nothing at this end can move it.
            ConfigError: The arm could not work there.
        """
        require_simulated(self._core.arm)
        quat = quat_multiply(quat_about_z(yaw), np.array(self._first.facing))
        pose = Pose(np.array(position, dtype=float), quat)
        require_inside(self._core.task, self._core.cell, self._core.arm, pose)
        self.hand.fixture_to = pose

    def choose(self, choice: Choice) -> None:
        """Build something else; what cannot be built leaves everything as it is."""
        self._wishes.put(lambda: self._rebuild(choice))

    # -- what is to be seen; from any thread --------------------------------------

    @property
    def cell(self) -> Workcell:
        """What stands around the arm."""
        return self._core.cell

    @property
    def core(self) -> ContactEnv:
        """The environment; only the loop's thread may change it."""
        return self._core

    @property
    def choice(self) -> Choice:
        """What runs."""
        return self._choice

    @property
    def can_touch(self) -> bool:
        """Whether the arm can be pulled and its fixture dragged."""
        return is_simulated(self._core.arm)

    @property
    def facing(self) -> Vec4:
        """Rotation of the fixture that is not turned."""
        return np.array(self._first.facing)

    @property
    def near_plane(self) -> tuple[Vec3, float]:
        """Normal, and where along it contact is near [m], by the believed fixture."""
        goal = self._core.task.goal(self._core.tracker.estimate().pose)
        return goal.normal, goal.surface + self._core.config.approach.near_distance

    def say(self, note: str) -> None:
        """Tell everybody something."""
        self._note = note

    @property
    def is_covered(self) -> bool:
        """Whether the camera is covered."""
        return self._shutter.is_covered

    @property
    def status(self) -> Status:
        """What the loop is doing."""
        mode = "held"
        if self._is_building:
            mode = "building"
        elif not self._is_ready:
            mode = "stopped"
        elif self._is_paused:
            mode = "paused"
        elif self._is_running:
            mode = "running"
        return Status(
            mode=mode,
            note=self._note,
            rate=self.pace.rate,
            success=self._is_success,
        )

    def close(self) -> None:
        """Hold the arm, end the loop, write what was recorded, release the arm."""
        if self._is_ended.is_set():
            return
        self._arm.stop()
        self._is_ended.set()
        self._wishes.put(lambda: None)
        self._thread.join()
        self.diary.close()
        self._env.close()

    # -- the loop -----------------------------------------------------------------

    def _loop(self) -> None:
        while not self._is_ended.is_set():
            self._obey()
            is_still = self._is_paused and self._steps_left == 0
            can_step = self._is_ready and (self._is_running or self.can_touch)
            if is_still or not can_step:
                time.sleep(_NAP)
                self.pace.begin()
                continue
            self._steps_left = max(0, self._steps_left - 1)
            try:
                self._advance()
            except DovetailError as error:
                self._fail(error)

    def _obey(self) -> None:
        """Do what was wished for, in order; a wish that fails is said and forgotten."""
        while True:
            try:
                wish = self._wishes.get_nowait()
            except queue.Empty:
                return
            try:
                wish()
            except DovetailError as error:
                self._note = str(error)

    def _advance(self) -> None:
        """Let one policy step pass."""
        core = self._core
        action = np.zeros(len(core.commands), dtype=np.float32)
        if self._is_running and self._policy is not None and not self._arm.is_held:
            action = self._policy(self._observation)
        self._observation, reward, done, _, info = self._env.step(action)
        self._step += 1
        self._reward, self._depth = float(reward), float(info["depth"])
        self.violations += int(info["limit_violations"])
        is_idle = not (self._is_running or self.hand.is_busy)
        raw = info["observation_raw"]
        self.diary.add(core.state, self._step, action, self._reward, raw, is_idle)
        self.diary.follow(core.state.stamp, core.fixture)
        if done and self._is_running:
            self._is_success = True
            passed = core.state.stamp - self._started
            self._note = f"done, {passed:.1f} s after the start"
            self._arm.stop()
            self._hold()

    def _fail(self, error: DovetailError) -> None:
        """Say why the arm does not follow any more; a reset begins anew."""
        self._is_running = self._is_ready = False
        self._note = f"{error}. Reset begins anew"
        if isinstance(error, ArmError) and isinstance(error.state, ArmState):
            self._see(error.state, self._core.fixture)

    def _see(self, state: ArmState, fixture: Pose) -> None:
        """Keep what the page shows; the environment learns where the fixture is."""
        core = self._core
        core.fixture = fixture
        self.moment = Moment(
            stamp=state.stamp,
            q=state.q,
            position=state.position,
            fixture=fixture,
            seen=core.tracker.estimate().pose,
            force=known_force(state),
            pull=self.hand.force if self.hand.pull_to is not None else np.zeros(3),
            used=used_limits(state, core.arm.facts),
            reward=self._reward,
            depth=self._depth,
            work=self._arm.work,
        )
        self.trace.add(self.moment)

    # -- wishes; in the loop's thread ----------------------------------------------

    def _start(self) -> None:
        if self._policy is None:
            self._note = "there is no policy to start: choose one, or move the arm"
            return
        if self._is_success or not self._is_ready:
            self._begin()
        self._arm.clear()
        self._note = ""
        self._started = self._core.state.stamp
        self._is_paused = False
        self._is_running = True
        self.pace.begin()

    def _hold(self) -> None:
        self._is_running = False

    def _pause(self, paused: bool) -> None:
        self._is_paused = paused and self.can_touch
        self._steps_left = 0
        self.pace.begin()

    def _step_once(self) -> None:
        self._is_paused = self.can_touch
        self._steps_left = 1 if self.can_touch else 0

    def _begin(self) -> None:
        """Start an episode: a new start, the fixture where it is."""
        core = self._core
        self._is_running = self._is_success = False
        self._note = ""
        self.diary.begin(describe(self._env, self._choice))
        options: dict[str, Any] = {"fixture": self._fixture()}
        self._step, self._reward, self._depth = 0, 0.0, 0.0
        self._observation, info = self._env.reset(seed=self._seed, options=options)
        self._seed = None
        if self._policy is not None:
            self._policy.reset()
        self._depth = float(info["depth"])
        self._is_ready = True
        self._arm.resume_from(core.state)
        if self.can_touch:
            self._arm.stop()
        self.trace.clear()
        self._see(core.state, core.fixture)
        self.diary.follow(core.state.stamp, core.fixture)

    def _fixture(self) -> Pose:
        """Return where the fixture stands: dragged there, given, or the task's own."""
        if self._is_ready:
            return self._core.fixture
        if self._left is not None:
            return self._left
        if self._given is not None:
            return FixturePose.given(self._given, self._first.facing).pose()
        return self._first.pose()

    def _rebuild(self, choice: Choice) -> None:
        before = self._env
        if self._core.arm.facts.is_real_time:
            self._note = "another choice for this arm needs another dovetail cockpit"
            return
        left = self._core.fixture if self._is_ready else None
        self._is_building, self._is_running = True, False
        try:
            self._install(choice, left)
        finally:
            self._is_building = False
            if self._env is not before:
                before.close()

    def _install(self, choice: Choice, left: Pose | None = None) -> None:
        env, policy = build(choice)
        try:
            require_place(env, self._given)
        except DovetailError:
            env.close()
            raise
        self._env, self._policy, self._choice = env, policy, choice
        self._core = core = require_contact_env(env)
        was_covered = self.version > 0 and self._shutter.is_covered
        self._shutter = Shutter(core.tracker)
        self._shutter.is_covered = was_covered
        core.tracker = self._shutter
        core.arm = self._arm = PacedArm(core.arm, self.hand, self.pace, self._see)
        self._first, self._left = core.task.trial_poses[0], left
        if left is not None:
            try:
                require_inside(core.task, core.cell, core.arm, left)
            except ConfigError:  # where it was left, this task cannot be done
                self._left = None
        self._seed: int | None = 0
        self._is_ready = False
        self.version += 1
        if self.can_touch:
            self._begin()
        else:
            self._note = "reset brings the arm to its start: it will move"
