"""The one Gymnasium environment: a task, on an arm."""

import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState, ToolState, require_simulated
from dovetail.control.period import POLICY_PERIOD
from dovetail.control.task_spec import FORCE, TaskSpec
from dovetail.envs.arm_setup import build_arm
from dovetail.envs.commands import CommandMap, require_same
from dovetail.envs.config import EnvConfig
from dovetail.envs.contract import read_pose, read_progress, read_reward, require_task
from dovetail.envs.copying import RebuiltOnCopy
from dovetail.envs.fixture_velocity import STANDS, FixtureVelocity
from dovetail.envs.free_start import (
    StartCheck,
    StartError,
    require_room,
    require_within,
)
from dovetail.envs.history_features import HistoryFeatures
from dovetail.envs.observation import Layout, sight
from dovetail.envs.pictures import EpisodePictures
from dovetail.envs.pre_grasp_view import look_from_above
from dovetail.envs.stacking import History
from dovetail.envs.tare import ToolTare, can_tare
from dovetail.envs.violations import BAD_INPUT, ViolationCounter, count_bad_input
from dovetail.envs.workspace import (
    margin_of,
    require_axes,
    require_columns,
    require_inside,
    require_placed,
    require_plausible,
    shown_columns,
)
from dovetail.errors import ConfigError, DovetailError, ReachError
from dovetail.poses import UNMOVED, Pose, compose
from dovetail.robots.find import find_robot
from dovetail.tasks.grasp import Grasp
from dovetail.tasks.region import Region
from dovetail.tasks.task import Goal, Progress, Task
from dovetail.trackers.find import TrackerContext, find_tracker
from dovetail.trackers.tracker import Tracker, close_tracker
from dovetail.types import Array, Vec3, Vec6, Vec7

_STREAM = 0x72AC6
"""Keeps the trackers' seeds apart from the draws of start and fixture."""
_DRAWS = 100
"""Most draws of a start until one is in free air."""
_FIXTURES = 10
"""Most draws of a fixture in a cell's region, until there is a start for it."""


class ContactEnv(
    RebuiltOnCopy, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]
):
    """Bring a held part to a fixture whose pose is known, under a torque-controlled arm.

    All axes are the world's.

    ## Action space

    `Box(-1, 1)`, one number per commanded axis of the task, in the order X Y Z A B C.
    For the axes `XYZ:force A:pose BC:hold`:

    | index | meaning | unit | value at action 1 |
    |---|---|---|---|
    | 0-2 | f* x, y, z: acceleration of the unit-mass operational point | m/s2 | `f_scale` |
    | 3 | theta_des: desired rotation about the vertical, relative to the goal's | rad | `theta_range` |

    B and C are held: the tool points down. Where the fixture tilts they are pose axes,
    as A is, about the world's y and x. On force axes the controller adds
    `-force_damping` x velocity, so that an action is close to a velocity. Less than
    `near_distance` above the fixture's surface, and below it, the tool's speed is
    limited to `near_speed`, so that contact happens at no more than that under any
    policy; and f* towards the fixture to `near_press`.

    ## Observation space

    `Box`, the task's columns but those of `without`, those of `also` and `recall`, then
    `stack` past (observation, action) pairs, newest first. Of a part that goes in from
    above:

    | index | meaning | unit unscaled | scaling | range |
    |---|---|---|---|---|
    | 0-6 | joint angles q1..q7 | rad | (q - middle) / half of the joint's range | +-1.1 |
    | 7-9 | tool minus goal x, y, z | m | symmetric log, s = 2 mm | +-7 |
    | 10 | tool minus goal rotation about the vertical | rad | symmetric log, s = 0.02 rad | +-5.1 |
    | 11-13 | tool velocity x, y, z | m/s | symmetric log, s = 0.02 m/s | +-5 |

    The symmetric log is `sign(x) ln(1 + |x| / s)`; x is counted from the task's
    `zero_offset`. Everything comes from measured joint angles and the tracker, never
    from the simulation's truth.

    ## Reward

    The task's: usually `-(0.6 L2(x) + 0.4 L1(x) + 0.1 |theta|)` per step, x the tool
    minus the goal [m] of the fixture's true pose, and 50 on success. Of a task whose own
    columns have the tilt, theta is the whole angle between tool and goal.

    ## Starting state

    Fixture pose and start pose are the task's to draw. `reset(options={"fixture": Pose,
    "start": q})` fixes either.

    ## Episode end

    Terminated on the task's success. Truncated after `max_steps`; by `gym.make`, whose
    word is `max_episode_steps`, after as many, 200 if nothing is said.

    ## Info

    `success` and `depth` [m] by the fixture's true pose, `position_error` [m] and
    `theta_error` [rad] (tool minus goal, by the tracker), `contact_force_max` [N] of
    the step, `limit_violations` (control cycles of the step outside a joint or wall
    limit, by the measured state), `bad_input` (those in which the controller held the
    arm because its input was invalid), `observation_raw` (the task's columns
    and those of `also`, unscaled) and, from `reset`, `tare` [m/s2, rad/s2]: the f*
    that holds the weight.

    Args:
        task: What is to be done.
        arm: The arm, or its address (see `arms.address`); None is the settings'.
        config: Every other setting; None is the usual ones.
        tracker: Where the fixture is; None is the settings'.
        render_mode: None, or "rgb_array": `render` returns a picture. `gym.make` shows
            it in a window for "human", which needs pygame.

    Raises:
        ConfigError: An unknown name or a number out of range.
    """  # noqa: E501

    metadata: dict[str, Any] = {  # noqa: RUF012  (Gymnasium's name)
        "render_modes": ["rgb_array"],
        "render_fps": round(1.0 / POLICY_PERIOD),
    }

    state: ArmState
    """Newest state of the arm."""
    fixture: Pose
    """The fixture's true pose in this episode."""
    grasp: Pose = UNMOVED
    """The held part's frame in the TCP's in this episode, as a simulation has it."""
    believed: Pose
    """Believed pose of the fixture: the tracker's last, moved on until now."""
    steps: int  # of the episode so far
    is_led: bool = False  # whether a person acts next; set by `TeleopWrapper`

    def __init__(
        self,
        task: Task,
        arm: Arm | str | None = None,
        config: EnvConfig | None = None,
        *,
        tracker: Tracker | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.task, self.config = task, config or EnvConfig()
        action = self.config
        self.cell = task.workcell(find_robot(action.robot), action.cell)
        self._region = Region.of(self.cell)
        self.render_mode = render_mode
        self._pictures = EpisodePictures(self.cell, render_mode, self.metadata)
        self.axes = TaskSpec.parse(task.axes)
        given = self.config.arm if arm is None else arm
        self.arm = build_arm(given, self.cell, self.axes, self.config)
        at = TrackerContext.for_arm(self.cell, self.config.twin, self.arm)
        self.tracker = tracker or find_tracker(self.config.tracker, at)
        self.commands = CommandMap(
            self.axes,
            f_scale=action.f_scale,
            f_scale_angular=action.f_scale_angular,
            theta_range=action.theta_range,
            position_range=action.position_range,
        )
        self._tare = self._find_tare(self.arm.facts.traits.holds_its_weight)
        self._prepare()

    def _find_tare(self, holds_its_weight: bool) -> ToolTare | None:
        """Return the tare where it is asked for, or usual and possible."""
        asked, damping = self.config.tare, self.config.force_damping
        if asked is None:
            asked = not holds_its_weight and can_tare(self.axes, damping)
        return ToolTare(self.arm, self.commands, damping) if asked else None

    def expect_weight(self) -> None:
        """Take a tare at each reset, unless it is refused: the dynamics will change."""
        self._tare = self._tare or self._find_tare(holds_its_weight=False)

    @property
    def is_tared(self) -> bool:
        """True if a reset measures the weight that gravity compensation misses."""
        return self._tare is not None

    def _prepare(self) -> None:
        """Take from the arm and the task what each step needs."""
        require_axes(self.arm, self.axes)
        require_task(self.task, self.arm.facts.robot)
        if self.config.cell is not None:
            self.task.require_region(self.cell, margin_of(self.task, self.arm))
        own = shown_columns(self.task.columns, self.config.without)
        require_columns(self.arm, (*own, *self.config.also))
        self.max_steps = self.config.max_steps
        facts, seen = self.arm.facts, self.config
        also = (name for name in seen.also if name not in own)
        zero, joints = self.task.zero_offset(), self.cell.joints
        self.scaling = Layout((*own, *also), facts.robot, zero, joints)
        self._walls = self.cell.walls
        if (tool := facts.limits).walls:
            self._walls = tuple(tool.x_min), tuple(tool.x_max)
        self.violations = ViolationCounter(facts.robot, *self._walls)
        self.places_fixture = facts.traits.places_fixture
        self._is_tilting = "tilt" in self.task.columns
        self._is_counted = type(self.task).counted is not Task.counted
        self._target = _core.Target()
        size = len(self.commands)
        self._recall = HistoryFeatures(seen.recall, self.scaling, size)
        self.columns = (*self.scaling.columns, *self._recall.columns)
        self._history = History(seen.stack, len(self.columns), size)
        self.remembers = bool(seen.recall or seen.stack)  # what was, see `remember`
        high = self._history.highest(np.append(self.scaling.high, self._recall.high))
        self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), dtype=np.float32)
        self._seeds = np.random.default_rng()
        self._seen = self._true = b"", b""
        self._velocity, self._followed = FixtureVelocity(), STANDS
        error, turn = self.config.grasp_error, self.config.grasp_turn
        usual = self.task.grasp
        self.grasp_range = Grasp(
            usual.error if error is None else error,
            usual.turn if turn is None else turn,
        )
        self._is_force = np.array([m == FORCE for m in self.axes.modes[:3]])
        self._begun: NDArray[np.float32] | None = None
        self._start_check = StartCheck(self.cell)
        self._wrench_held: Vec6 = np.zeros(6)
        self._action = np.zeros(size, dtype=np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Starts the environment's random numbers again.
            options: "fixture": its Pose; "start": the configuration q [rad].

        Raises:
            ConfigError: An unknown option, a fixture out of reach, or a drawn one on an
                arm that cannot move it.
        """
        super().reset(seed=seed)
        self._begun = None
        options = options or {}
        if unknown := ", ".join(sorted(set(options) - {"fixture", "start"})):
            raise ConfigError(
                f"unknown reset options: {unknown}; known: fixture, start"
            )
        fixture, q = self._place(options.get("fixture"), options.get("start"))
        self._draw_grasp()
        self.fixture = fixture
        self.slide_fixture(np.zeros(3))
        if seed is not None:
            self._seeds = np.random.default_rng([_STREAM, seed])
            self.arm.seed(seed)
        self.tracker.reset(fixture, int(self._seeds.integers(1 << 31)))
        look_from_above(self.tracker, self.arm, self.task, fixture, self._walls)
        self._velocity.reset()
        self.state = self.arm.reset(q, fixture)
        self.steps = 0
        raw = self._locate()
        if self._tare is not None:
            plane = self._target.near_plane
            tare = self._tare.take(self.state, fixture, plane, self._walls)
            self._wrench_held = tare.wrench
            self.state = self._without_weight(tare.state)
            raw = self._locate()
        self._pictures.begin(self.state)
        info = {**self._info(raw), "tare": self.commands.tare.copy()}
        return self._history.reset(self._recall.reset(self.scaling.scale(raw))), info

    def _draw_grasp(self) -> None:
        """Displace the held part for the next episode, where a simulation can."""
        grasp = self.grasp_range.draw(self.np_random)
        if grasp is not self.grasp and self.arm.facts.traits.is_simulated:
            require_simulated(self.arm).grasp(grasp)
            self.grasp = grasp

    def _place(self, given: Any, start: Any) -> tuple[Pose, Vec7]:
        """Return the fixture's pose and a start [rad], drawn where not given.

        A fixture that is drawn in a cell file's region, and before which no start can
        be, is drawn again.
        """
        for left in reversed(range(1 if self._region is None else _FIXTURES)):
            fixture = self._draw_fixture()
            if given is not None:
                fixture = Pose(*(np.asarray(p, dtype=float) for p in given))
            else:
                is_fixed = None if self._region is None else self._region.is_one_place
                require_placed(self.task, self.cell, self.arm, is_fixed=is_fixed)
            require_inside(self.task, self.cell, self.arm, fixture)
            try:
                return fixture, self._find_start(fixture, start)
            except StartError:
                if given is not None or start is not None or not left:
                    raise
        raise AssertionError("the last try returns or raises")

    def _draw_fixture(self) -> Pose:
        """Draw the fixture's pose, in the cell file's region if there is one."""
        if self._region is None:
            told, method = self.task.draw_fixture(self.np_random), "draw_fixture"
        else:
            told, method = self.task.draw_in(self.np_random, self._region), "draw_in"
        return read_pose(self.task, method, told)

    def _find_start(self, fixture: Pose, given: Any) -> Vec7:
        """Return the configuration [rad] to start in, in free air.

        A start that is drawn where none can be is drawn again.

        Raises:
            OverlapError: The given one lies in something.
            StartError: None that was drawn can be; says why the last one cannot.
        """
        if given is not None:
            q = np.asarray(given, dtype=float)
            self._start_check.require_free(q, fixture)
            return q
        robot = self.arm.facts.robot
        refused: DovetailError | None = None
        for _ in range(_DRAWS):
            told = self.task.draw_start(self.np_random, fixture)
            start = read_pose(self.task, "draw_start", told)
            try:
                require_within(start, self._walls, self.cell.starts)
                q = robot.inverse_kinematics(start, robot.posture(self.task.posture))
                self._require_led(q, start, fixture)
                return q
            except (StartError, ReachError) as error:
                refused = error
        raise StartError(
            f"none of {_DRAWS} starts that {type(self.task).__name__}.draw_start drew "
            f"can be; the last: {refused}; move the fixture, or let it draw from free "
            "air inside the walls"
        ) from refused

    def _require_led(self, q: Vec7, start: Pose, fixture: Pose) -> None:
        """Refuse a start in something, or from which the tool could not be led.

        Raises:
            StartError: Says what is in the way, or which joint.
            ReachError: A tare would lead the tool out of reach.
        """
        robot, margin = self.arm.facts.robot, self.arm.facts.limits.delta_q
        require_room(q, robot, margin)
        self._start_check.require_free(q, fixture)
        if self._tare is not None:
            plane = self._near_plane(self.task.goal(fixture))
            end = self._tare.far_end(start.position, fixture, plane, self._walls)
            q = robot.inverse_kinematics(start._replace(position=end), q)
            require_room(q, robot, margin)
            self._start_check.require_free(q, fixture)

    def _without_weight(self, state: ArmState) -> ArmState:
        """Return a state whose wrench is what it is beyond that of the tare."""
        return state._replace(wrench=state.wrench - self._wrench_held)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Follow an action for 50 ms.

        Raises:
            ConfigError: The action is not one finite number for each commanded axis, or
                is not the one that `begin_step` was given.
        """
        raw, reward, is_done, is_cut, info = self.follow(action)
        return self.remember(self.scaling.scale(raw)), reward, is_done, is_cut, info

    def follow(
        self, action: NDArray[np.float32]
    ) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Do what `step` does, with an unscaled observation in the place of its own.

        A caller that steps many environments scales all of them at once; `remember`
        does the rest.
        """
        begun = self._begun
        if begun is None:
            self.begin_step(action)
        elif begun is not action:
            require_same(begun, action)
        self._begun = None
        self.state = self.arm.step(self._target, POLICY_PERIOD)
        if self._tare is not None:
            self.state = self._without_weight(self.state)
        self.steps += 1
        if self.render_mode is not None:
            self._pictures.add(self.state)
        raw = self._locate()
        try:
            info = self._info(raw)
            true, is_done = self._by_truth, info["success"]
            force = info["contact_force_max"]
            turn = true.angle() if self._is_tilting else true.theta_error
            error = true.position_error
            if self._is_counted:
                error = self.task.counted(error, true.goal)
            reward = self.task.weigh(error, turn, is_done, force)
            if type(reward) is not float or not math.isfinite(reward):
                reward = read_reward(self.task, reward)
        except Exception:  # of a task of one's own, too
            self.arm.stop()
            raise
        return raw, reward, is_done, self.steps >= self.max_steps and not is_done, info

    def remember(self, scaled: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a step's observation: what is seen, scaled, and what was.

        Args:
            scaled: What `follow` gave first, scaled by `scaling`.
        """
        if not self.remembers:
            return scaled
        return self._history.push(self._action, self._recall.push(self._action, scaled))

    def begin_step(self, action: NDArray[np.float32]) -> _core.Target:
        """Do what a step does before its control cycles.

        `BatchVectorEnv` calls this first and hands the Target to the arm's threads;
        `step` with the same action goes on from there.

        Returns:
            What the arm is to follow; the environment's own.

        Raises:
            ConfigError: The action is not one finite number for each commanded axis.
        """
        self._action = self.commands.usable(action)
        goal = self._goal
        self.commands.fill(self._target, self._action, goal.position, goal.quat_wxyz)
        if self._is_sliding:
            self._slide()
        self._begun = action
        return self._target

    def begin_acting(self) -> None:
        """Called when a policy or person takes over, also in mid-episode."""

    def done_for(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return what the last step did for an action, as a log tells it."""
        return action

    def slide_fixture(self, velocity: Vec3) -> None:
        """Let the fixture move at a velocity [m/s], world axes, in the steps to come.

        Raises:
            ArmError: It is no simulation here, nor a simulated cabinet.
        """
        self._fixture_velocity = np.array(velocity, dtype=float)
        self._is_sliding = bool(self._fixture_velocity.any())
        if self._is_sliding:
            require_simulated(self.arm)

    def _slide(self) -> None:
        velocity = self._fixture_velocity
        require_simulated(self.arm).move_fixture(self.fixture, velocity)
        position = self.fixture.position + POLICY_PERIOD * velocity
        self.fixture = self.fixture._replace(position=position)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of what was measured last, shape (480, 640, 3).

        The fixture is where it truly is. Violet, in a frame, is where it is believed,
        if that is elsewhere. A blue line is the path of the tool's end in this episode,
        a red arrow beside it the contact force.

        Raises:
            MissingDependencyError: There is no OpenGL that draws without a screen.
            ArmError: The environment is closed.
        """
        return self._pictures.draw(self.state, self.fixture, self.believed)

    def close(self) -> None:
        """Close the arm and the tracker."""
        self._pictures.close()
        self.arm.close()
        close_tracker(self.tracker)

    def _locate(self) -> Array:
        """Ask the tracker for the fixture; return the unscaled observation."""
        try:
            self.tracker.update(self.fixture, self.state)
            estimate = self.tracker.estimate()
            if estimate.covariance is not None:  # it was seen
                require_plausible(self.task, self.cell, self.fixture, estimate)
        except Exception:  # of a tracker of one's own, too
            self.arm.stop()  # the goal is unknown
            raise
        pose, velocity = self._velocity.follow(estimate, self.state.stamp)
        if velocity is not self._followed:
            self._followed = velocity
            self._target.velocity_d = np.append(velocity * self._is_force, np.zeros(3))
        # By value: a tracker may change its pose in place.
        seen = true = pose.position.tobytes(), pose.quat_wxyz.tobytes()
        if seen != self._seen:
            self._seen = seen
            self.believed = Pose(pose.position.copy(), pose.quat_wxyz.copy())
            self._goal = goal = self.task.goal(pose)
            self._target.near_plane = self._near_plane(goal)
        goal = self._goal
        if pose is not self.fixture:
            true = self.fixture.position.tobytes(), self.fixture.quat_wxyz.tobytes()
        if true != self._true:
            self._true = true
            self._true_goal = goal if true == seen else self.task.goal(self.fixture)
        self._by_sight = self._by_truth = sight(self.state, goal)
        if self._true_goal is not goal or self.grasp is not UNMOVED:
            self._by_truth = sight(self._with_part(self.state), self._true_goal)
        return self.scaling.read(self._by_sight)

    def _with_part(self, state: ArmState) -> ArmState:
        """Return a state whose tool frame is the held part's own."""
        tool = state.tool
        part = compose(Pose(tool.position, tool.quat_wxyz), self.grasp)
        return state._replace(tool=ToolState(*part, tool.velocity))

    def _near_plane(self, goal: Goal) -> Array:
        """Return the plane below which contact is near, as in a Target."""
        return np.append(goal.normal, goal.surface + self.config.near_distance)

    def _info(self, raw: Array) -> dict[str, Any]:
        state, true = self.state, self._by_truth
        told = self.task.judge(true.position_error, true.goal, true.state)
        if type(told) is not Progress or not math.isfinite(told.depth):
            told = read_progress(self.task, told)
        depth, success = told
        fx, fy, fz = state.contact_force.tolist()
        return {
            "success": success,
            "depth": depth,
            "position_error": self._by_sight.position_error,
            "theta_error": self._by_sight.theta_error,
            "contact_force_max": math.sqrt(fx * fx + fy * fy + fz * fz),
            "limit_violations": self.violations.count(state.log),
            "bad_input": count_bad_input(state) if state.flags & BAD_INPUT else 0,
            "observation_raw": raw,
        }
