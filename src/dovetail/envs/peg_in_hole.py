"""Peg in hole (Kaspar et al. 2020) as a Gymnasium environment over any arm."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState, require_simulated
from dovetail.control.period import DEFAULT_PERIOD, POLICY_PERIOD
from dovetail.control.ranges import Range, in_count, in_range
from dovetail.control.task_spec import TaskSpec
from dovetail.envs import usual
from dovetail.envs.arm_setup import WALLS_MAX, WALLS_MIN, build_arm
from dovetail.envs.commands import CommandMap
from dovetail.envs.copying import RebuiltOnCopy
from dovetail.envs.hole_pose import HOLE_POSES, HolePose, insertion
from dovetail.envs.hole_tracker import HoleTracker, TrueHole
from dovetail.envs.observation import (
    NUM_OBSERVATIONS,
    OBSERVATION_HIGH,
    ObservationScaling,
    observe,
)
from dovetail.envs.randomisation import (
    TOOL_DOWN,
    RandomisationConfig,
    sample_hole,
    sample_start,
)
from dovetail.envs.rewards import RewardConfig, insertion_reward
from dovetail.envs.stacking import History
from dovetail.envs.tare import ToolTare
from dovetail.envs.violations import ViolationCounter, count_bad_input
from dovetail.envs.workspace import require_inside, require_task
from dovetail.errors import ConfigError
from dovetail.plants.plant import DynamicsConfig
from dovetail.plants.twin import TwinConfig
from dovetail.poses import Pose, matrix_from_quat, quat_multiply
from dovetail.scene import SceneConfig
from dovetail.types import Array, Vec3, Vec4, Vec7

_NEAR = Range(0.0, 1.0, "m")


class PegInHoleEnv(
    RebuiltOnCopy, gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]
):
    """Push a peg into a hole whose pose is known, under a torque-controlled arm.

    The target is the peg's pose when inserted: its end in the middle of the hole's
    floor, its rotation the hole's. All axes are the world's.

    ## Action space

    `Box(-1, 1)`, one number per commanded axis of the task, in the order X Y Z A B C.
    For the default task `XYZ:force A:pose BC:hold`:

    | index | meaning | unit | value at action 1 |
    |---|---|---|---|
    | 0, 1, 2 | f* x, y, z: acceleration of the unit-mass operational point | m/s2 | `f_scale` |
    | 3 | theta_des: desired rotation about the vertical, relative to the hole's | rad | `theta_range` |

    B and C are held: the tool points down. On force axes the controller adds
    `-force_damping` x velocity, so that an action is close to a velocity. Less than
    `near_distance` above the hole's mouth, and below it, the tool's speed is limited to
    `near_speed`: contact happens at no more than that, whatever the policy does; and f*
    towards the hole to `near_press`.

    ## Observation space

    `Box`, 14 numbers, then `stack` past (observation, action) pairs, newest first:

    | index | meaning | unit unscaled | scaling | range |
    |---|---|---|---|---|
    | 0-6 | joint angles q1..q7 | rad | (q - middle) / half of the joint's range | +-1.1 |
    | 7-9 | tool minus target x, y, z | m | symmetric log, s = 2 mm | +-7 |
    | 10 | tool minus target rotation about the vertical | rad | symmetric log, s = 0.02 rad | +-5.1 |
    | 11-13 | tool velocity x, y, z | m/s | symmetric log, s = 0.02 m/s | +-5 |

    The symmetric log is `sign(x) ln(1 + |x| / s)`; on z, x is counted from the hole's
    mouth, a fixed offset of `hole_depth` from the target. Everything comes from measured
    joint angles and the hole tracker, never from the simulation's truth.

    ## Reward

    `-(0.6 L2(x) + 0.4 L1(x) + 0.1 |theta|)` per step, x the tool minus the target [m],
    and 50 on success.

    ## Starting state

    Hole pose and start pose are random, see `RandomisationConfig`; starts below the
    block's surface, beside it, are included. `reset(options={"hole": Pose, "start":
    q})` fixes either.

    ## Episode end

    Terminated on success: the peg's end `SceneConfig.success_depth` below the mouth and
    inside the hole. Truncated after `max_steps`.

    ## Info

    `success` and `depth` [m] in the true hole, `position_error` [m] and `theta_error`
    [rad] (tool minus target, by the hole tracker), `contact_force_max` [N] of the step,
    `limit_violations` (control cycles of the step outside a joint or wall limit, by the
    measured state), `bad_input` (those in which the controller held the arm because of
    a number that is none), `observation_raw` (14 numbers, unscaled) and, from `reset`,
    `tare` [m/s2, rad/s2]: the f* that holds the weight.

    Args:
        arm: The arm to use, or its address (see `arms.address`); None builds a
            `LocalArm` from the next arguments.
        plant: Physics engine, "mujoco" or "bullet".
        peg: Shape of peg and hole: "square", "triangle" or "round".
        clearance: Gap between peg and hole on each side [m]; None is in `defaults`.
        task: Mode of each axis; None is in `defaults`.
        stack: Number of past (observation, action) pairs to append.
        twin: A twin, its name or its file, to use in place of the plain plant.
        period: Control period [s]: 0.001, 0.002, 0.0025 or 0.005.
        max_steps: Episode length [policy steps of 50 ms].
        f_scale: f* at action 1 on X Y Z [m/s2], one number or three.
        f_scale_angular: f* at action 1 on A B C [rad/s2].
        force_damping: Damping of force axes X Y Z [1/s], one number or three. The paper
            has 0; near_speed and near_press act all the same, until they are 0.25 m/s
            (the limit everywhere) and f_scale; tare needs damping.
        tare: Measure at each reset, in free air, the f* that holds the weight which
            the arm's gravity compensation misses, and add it to every action's: 2.2 s.
        near_speed: Speed limit of the TCP per axis where contact is near [m/s].
        near_press: Largest f* towards the hole there [m/s2], tare not counted: times
            the effective mass, about 10 kg, it is the force of standing on the rim.
        near_distance: How far above the hole's mouth that begins [m].
        theta_range: Rotation at action 1 on pose axes A B C [rad].
        position_range: Displacement at action 1 on pose axes X Y Z [m].
        scheme: How limits are kept, "qp" or "paper".
        engine: Physics engine of the twin, if not the one in its file.
        dynamics: Physics of the plain plant; a twin has its own.
        tracker: Where the hole is; None is the simulation's truth.
        randomisation: Ranges of starts and holes.
        reward: Weights of the reward.
        render_mode: None; there is nothing to render here.

    Raises:
        ConfigError: An unknown name or a number out of range.
    """  # noqa: E501

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  (Gymnasium's name)

    defaults: ClassVar[dict[str, Any]] = {
        "task": "XYZ:force A:pose BC:hold",
        "clearance": 0.0005,
    }
    """What the task is where nothing else is asked for."""
    hole_poses: ClassVar[tuple[HolePose, ...]] = HOLE_POSES
    """Where the hole is when a policy is tried."""
    q_seed: ClassVar[Vec7] = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0])
    """Where inverse kinematics starts [rad]: elbow up, tool down."""

    state: ArmState
    """What the arm said after the last step."""
    hole: Pose
    """The hole's true pose in this episode."""
    violations: ViolationCounter
    """Counts the control cycles of a log outside a joint or wall limit."""
    places_fixture: bool
    """Whether the arm can put the hole where an episode wants it."""

    def __init__(
        self,
        arm: Arm | str | None = None,
        *,
        plant: str = "mujoco",
        peg: str = "square",
        clearance: float | None = None,
        task: str | None = None,
        stack: int = 0,
        twin: TwinConfig | str | Path | None = None,
        period: float = DEFAULT_PERIOD,
        max_steps: int = 200,
        f_scale: float | Sequence[float] = usual.F_SCALE,
        f_scale_angular: float = usual.F_SCALE_ANGULAR,
        force_damping: float | Sequence[float] = usual.FORCE_DAMPING,
        tare: bool = False,
        near_speed: float = usual.NEAR_SPEED,
        near_press: float = usual.NEAR_PRESS,
        near_distance: float = usual.NEAR_DISTANCE,
        theta_range: float = usual.THETA_RANGE,
        position_range: float = usual.POSITION_RANGE,
        scheme: str = "qp",
        engine: str | None = None,
        dynamics: DynamicsConfig | None = None,
        tracker: HoleTracker | None = None,
        randomisation: RandomisationConfig | None = None,
        reward: RewardConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = render_mode
        gap = self.defaults["clearance"] if clearance is None else clearance
        self.scene = SceneConfig(peg=peg, clearance=gap)  # type: ignore[arg-type]
        self.task = TaskSpec.parse(self.defaults["task"] if task is None else task)
        self.arm = build_arm(
            arm,
            self.scene,
            self.task,
            plant=plant,
            twin=twin,
            period=period,
            force_damping=force_damping,
            near_speed=near_speed,
            near_press=near_press,
            walls=self.walls(),
            scheme=scheme,
            engine=engine,
            dynamics=dynamics,
        )
        self.tracker = tracker or TrueHole()
        self.randomisation = randomisation or RandomisationConfig()
        self.reward_config = reward or RewardConfig()
        self.commands = CommandMap(
            self.task,
            f_scale=f_scale,
            f_scale_angular=f_scale_angular,
            theta_range=theta_range,
            position_range=position_range,
        )
        self._tare = ToolTare(self.arm, self.commands, force_damping) if tare else None
        self._prepare(stack, max_steps, near_distance)

    def _prepare(self, stack: int, max_steps: int, near_distance: float) -> None:
        """Take from the arm and the scene what each step needs."""
        self.max_steps = in_count("max_steps", max_steps, 1, 1_000_000, "steps")
        self._near_distance = in_range("near_distance", near_distance, _NEAR)
        self._lateral_max = self.scene.clearance * math.sqrt(2.0) + 0.002
        robot = self.arm.facts.robot
        require_task(self.arm, self.task)
        self.scaling = ObservationScaling(
            robot.q_min, robot.q_max, self.scene.hole_depth * self.mouth_direction()
        )
        self._walls = self.walls()
        if (limits := self.arm.facts.limits).walls:
            self._walls = tuple(limits.x_min), tuple(limits.x_max)
        self.violations = ViolationCounter(robot, *self._walls)
        self.places_fixture = self.arm.facts.places_fixture
        self._target = _core.Target()
        size = len(self.commands)
        self._history = History(stack, NUM_OBSERVATIONS, size)
        high = self._history.highest(OBSERVATION_HIGH)
        self.observation_space = gymnasium.spaces.Box(-high, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (size,), dtype=np.float32)

    def walls(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return lower and upper walls of the TCP [m], world axes."""
        return WALLS_MIN, WALLS_MAX

    def mouth_direction(self) -> Vec3:
        """Return where the mouth is from the target, world axes, unit length."""
        return np.array([0.0, 0.0, 1.0])

    def draw_hole(self) -> Pose:
        """Draw the true pose of the hole's mouth for an episode."""
        return sample_hole(self.np_random, self.randomisation)

    def draw_start(self, hole: Pose) -> Pose:
        """Draw the tool's start pose for an episode."""
        yaw = 2.0 * math.atan2(hole.quat_wxyz[3], hole.quat_wxyz[0])
        return sample_start(self.np_random, hole, yaw, self.randomisation)

    def goal_rotation(self, hole: Pose) -> Vec4:
        """Return the tool's rotation (wxyz) when the peg is aligned with the hole."""
        return quat_multiply(hole.quat_wxyz, TOOL_DOWN)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Starts the environment's random numbers again.
            options: "hole": the hole's Pose; "start": the configuration q [rad].

        Raises:
            ConfigError: An unknown option, a hole out of reach, or a drawn one on an
                arm that cannot move it.
        """
        super().reset(seed=seed)
        options = options or {}
        if unknown := ", ".join(sorted(set(options) - {"hole", "start"})):
            raise ConfigError(f"unknown reset options: {unknown}; known: hole, start")
        hole = self.draw_hole()
        if options.get("hole") is not None:
            hole = Pose(*(np.asarray(part, dtype=float) for part in options["hole"]))
        elif not (self.places_fixture or self.randomisation.is_hole_fixed):
            raise ConfigError(
                "the arm cannot move the hole: say where it is, with --fixed-goal "
                "--hole X Y Z YAW [m, rad] or reset(options={'hole': Pose})"
            )
        require_inside(self.scene, self.arm, self.walls(), hole)
        if options.get("start") is not None:
            q = np.asarray(options["start"], dtype=float)
        else:
            start, robot = self.draw_start(hole), self.arm.facts.robot
            q = robot.inverse_kinematics(start, self.q_seed)
        self.hole = hole
        self.slide_fixture(np.zeros(3))
        if seed is not None:
            self.arm.seed(seed)
        self.tracker.reset(hole)
        self.state = self.arm.reset(q, hole)
        self._steps = 0
        raw = self._locate()
        if self._tare is not None:
            plane = self._target.near_plane
            self.state = self._tare.take(self.state, hole, plane, self._walls)
            raw = self._locate()
        info = {**self._info(raw), "tare": self.commands.tare.copy()}
        return self._history.reset(self.scaling.scale(raw)), info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Follow an action for 50 ms."""
        action = self.commands.usable(action)
        self.commands.fill(self._target, action, self._goal, self._goal_quat)
        if self._is_sliding:
            self._slide()
        self.state = self.arm.step(self._target, POLICY_PERIOD)
        self._steps += 1
        raw = self._locate()
        info = self._info(raw)
        reward = insertion_reward(
            info["position_error"],
            info["theta_error"],
            info["success"],
            self.reward_config,
            info["contact_force_max"],
        )
        observation = self._history.push(action, self.scaling.scale(raw))
        is_cut = self._steps >= self.max_steps and not info["success"]
        return observation, reward, info["success"], is_cut, info

    def slide_fixture(self, velocity: Vec3) -> None:
        """Let the hole move at a velocity [m/s], world axes, in the steps to come.

        Raises:
            ArmError: It is no simulation here, nor a simulated cabinet.
        """
        self._hole_velocity = np.array(velocity, dtype=float)
        self._is_sliding = bool(self._hole_velocity.any())
        _ = self._is_sliding and require_simulated(self.arm)

    def _slide(self) -> None:
        require_simulated(self.arm).move_fixture(self.hole, self._hole_velocity)
        position = self.hole.position + POLICY_PERIOD * self._hole_velocity
        self.hole = self.hole._replace(position=position)

    def close(self) -> None:
        """Close the arm."""
        self.arm.close()

    def _locate(self) -> Array:
        """Ask the tracker for the hole; return the unscaled observation."""
        self.tracker.update(self.hole, self.state)
        hole = self.tracker.estimate().pose
        if hole is not getattr(self, "_tracked", None):
            self._tracked = hole
            self._axis = matrix_from_quat(hole.quat_wxyz)[:, 2]
            self._goal = hole.position - self.scene.hole_depth * self._axis
            self._goal_quat = self.goal_rotation(hole)
            self._near_height = self._axis @ hole.position + self._near_distance
            self._target.near_plane = np.append(self._axis, self._near_height)
        return observe(self.state, self._goal, self._goal_quat)

    def _info(self, raw: Array) -> dict[str, Any]:
        error = raw[7:10]
        depth, lateral = self._insertion(error)
        fx, fy, fz = self.state.contact_force.tolist()
        return {
            "success": depth >= self.scene.success_depth
            and lateral <= self._lateral_max,
            "depth": depth,
            "position_error": error,
            "theta_error": float(raw[10]),
            "contact_force_max": math.sqrt(fx * fx + fy * fy + fz * fz),
            "limit_violations": self.violations.count(self.state.log),
            "bad_input": count_bad_input(self.state),
            "observation_raw": raw,
        }

    def _insertion(self, error: Vec3) -> tuple[float, float]:
        """Return `insertion` in the true hole, whatever `error` the tracker saw."""
        axis = self._axis
        if self._tracked is not self.hole:
            axis = matrix_from_quat(self.hole.quat_wxyz)[:, 2]
            goal = self.hole.position - self.scene.hole_depth * axis
            error = self.state.position - goal
        return insertion(error, axis, self.scene.hole_depth)
