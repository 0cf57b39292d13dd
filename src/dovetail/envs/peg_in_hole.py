"""Peg in hole (Kaspar et al. 2020) as a goal-conditioned Gymnasium environment."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.build_arm import build_arm
from dovetail.envs.commands import CommandMap
from dovetail.envs.hole_tracker import HoleTracker, TrueHole
from dovetail.envs.limit_check import LimitCheck
from dovetail.envs.randomisation import (
    TOOL_DOWN,
    RandomisationConfig,
    sample_hole,
    sample_start,
    tool_down,
)
from dovetail.envs.rewards import RewardConfig, insertion_reward
from dovetail.envs.stacking import History
from dovetail.errors import ConfigError, LimitError
from dovetail.plants.plant import DynamicsConfig
from dovetail.poses import Pose, matrix_from_quat, wrap_angle, yaw_relative
from dovetail.scene import SceneConfig
from dovetail.types import Vec7

NUM_OBSERVATIONS = 14
POLICY_PERIOD = 0.05
"""Time that one action acts for [s]."""
OBSERVATION_SCALES = {"position": 0.002, "theta": 0.02, "velocity": 0.02}
"""s of the symmetric logarithm: [m], [rad], [m/s]."""
_SEED = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0])
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
_S = np.repeat(list(OBSERVATION_SCALES.values()), (3, 1, 3))


class PegInHoleEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Insert a peg with a torque-controlled arm.

    ## Description

    The arm starts in free air around the hole's block, also below its surface and beside
    it; hole pose and start pose are random in every episode, nothing else. One action
    acts for 50 ms. Everything observed is what the robot would measure: joint encoders
    and the tool pose that follows from them, and the hole tracker's estimate. The
    target is the inserted pose: `hole_depth` below the hole's mouth, tool down, turned
    like the hole.

    ## Action space

    Box(-1, 1), one number per axis that the task commands, in the order X Y Z A B C.
    For ``XYZ:force A:pose BC:hold``:

    | index | meaning | frame | unit at 1 | range |
    |---|---|---|---|---|
    | 0-2 | f* along x, y, z (unit mass) | world | `f_scale` 4 m/s2 | [-1, 1] |
    | 3 | theta_des about the vertical | target | `theta_range` 0.2 rad | [-1, 1] |

    Force axes have the viscous damping `force_damping`; f*/D is the speed that an
    action leads to. 0 is the paper's law.

    ## Observation space

    Box of 14 numbers, then `stack` past (observation, action) pairs, newest first.
    slog(x; s) = sign(x) log(1 + abs(x)/s) gives the policy fine resolution around 0. On z
    it is taken of x - `hole_depth`, whose 0 is the hole's mouth, where millimetres
    decide. The scaling is fixed, monotone and invertible.

    | index | meaning | frame | unit | scaling | range |
    |---|---|---|---|---|---|
    | 0-6 | configuration A1..A7 | joints | rad | q / q_max | [-1, 1] |
    | 7-9 | tool minus target, x y z | world | m | slog, s = 2 mm | [-8, 8] |
    | 10 | tool minus target, theta | world | rad | slog, s = 0.02 rad | [-6, 6] |
    | 11-13 | tool velocity x y z | world | m/s | slog, s = 0.02 m/s | [-6, 6] |

    ## Reward

    -(0.6 abs(x)_2 + 0.4 abs(x)_1 + 0.1 abs(theta)), tool minus target in metres and
    radians, plus 50 on success.

    ## Episode end

    Terminated: the tool is at least `success_depth` (28 mm) below the mouth and inside
    the hole. Truncated: `max_steps` (200) actions without success.

    ## Info

    success, depth [m], position_error [m, (3,)], theta_error [rad], contact_force_max
    [N], limit_violations (control cycles in which a measured limit was exceeded),
    flags, observation_unscaled (14,).
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        arm: Arm | None = None,
        *,
        plant: str = "mujoco",
        twin: str | None = None,
        engine: str | None = None,
        peg: str = "square",
        clearance: float = 0.0005,
        task: str = "XYZ:force A:pose BC:hold",
        stack: int = 0,
        period: float = 0.005,
        f_scale: float = 4.0,
        force_damping: float = 40.0,
        theta_range: float = 0.2,
        position_range: float = 0.05,
        max_steps: int = 200,
        scheme: str = "qp",
        scene: SceneConfig | None = None,
        dynamics: DynamicsConfig | None = None,
        randomisation: RandomisationConfig | None = None,
        reward: RewardConfig | None = None,
        tracker: HoleTracker | None = None,
    ) -> None:
        """Build the environment, and the arm unless one is given.

        Args:
            arm: Any arm; the default is built in this process from what follows.
            plant: Physics engine, "mujoco" or "bullet".
            twin: Name or file of a twin to use instead of the plant.
            engine: Engine of the twin, if not the one in its file.
            peg: "square", "triangle" (MuJoCo only) or "round".
            clearance: Gap between peg and hole on each side [m].
            task: Mode of each axis, see `TaskSpec`.
            stack: Number of past (observation, action) pairs in the observation.
            period: Control period [s]; 50 ms must be a whole number of them.
            f_scale: f* at action 1 on X Y Z [m/s2]; on A B C 25 times it [rad/s2].
            force_damping: Damping D of force axes [1/s].
            theta_range: Rotation at action 1 on pose axes A B C [rad].
            position_range: Displacement at action 1 on pose axes X Y Z [m].
            max_steps: Actions per episode.
            scheme: Limit scheme, "qp" or "paper".
            scene: Geometry other than shape and clearance.
            dynamics: Physics of the plant, where it is not a twin.
            randomisation: Ranges of hole and start.
            reward: Weights of the reward.
            tracker: Says where the hole is; the default is the simulation's truth.

        Raises:
            ConfigError: An unknown name or a value out of range, named.
        """
        if max_steps < 1:
            raise ConfigError(f"max_steps is {max_steps}; allowed: 1 or more")
        base = SceneConfig() if scene is None else scene
        self.scene = replace(base, peg=peg, clearance=clearance)  # type: ignore[arg-type]
        self.task = TaskSpec.parse(task)
        self.arm = arm or build_arm(
            self.scene,
            self.task,
            period=period,
            plant=plant,
            twin=twin,
            engine=engine,
            force_damping=force_damping,
            scheme=scheme,
            dynamics=dynamics,
        )
        self.max_steps = max_steps
        self._commands = CommandMap(
            self.task,
            f_scale=f_scale,
            f_scale_angular=25.0 * f_scale,
            theta_range=theta_range,
            position_range=position_range,
        )
        self._randomisation = randomisation or RandomisationConfig()
        self._reward = reward or RewardConfig()
        self._tracker = tracker or TrueHole()
        self._limits = LimitCheck(self.arm)
        self._history = History(stack, NUM_OBSERVATIONS, self._commands.size)
        self._target = _core.Target()
        self._q_scale = 1.0 / np.asarray(self.arm.robot.q_max)
        self.action_space = gym.spaces.Box(
            -1.0, 1.0, (self._commands.size,), np.float32
        )
        self.observation_space = gym.spaces.Box(
            -16.0, 16.0, (len(self._history),), np.float32
        )
        self.state: ArmState
        self.hole: Pose
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode.

        Args:
            seed: Starts the environment's random numbers, and the plant's noise, anew.
            options: "hole": a fixed hole `Pose`; "start": a fixed start
                configuration [rad], shape (7,).

        Raises:
            ConfigError: Unknown option, or a hole out of reach (says by how much).
        """
        super().reset(seed=seed)
        options = {} if options is None else options
        unknown = set(options) - {"hole", "start"}
        if unknown:
            raise ConfigError(
                f"unknown reset option {sorted(unknown)[0]!r}; known: hole, start"
            )
        plant = getattr(self.arm, "plant", None)
        if seed is not None and plant is not None:
            plant.seed(seed)
        hole = options.get("hole")
        self.hole = (
            sample_hole(self.np_random, self._randomisation) if hole is None else hole
        )
        self.scene.require_reachable(self.arm.robot, self.hole)
        start = options.get("start")
        q = self._sample_configuration() if start is None else np.asarray(start, float)
        self.state = self.arm.reset(q, self.hole)
        self._tracker.reset(self.hole)
        self._steps = 0
        observation, measured = self._observe()
        info = self._info(measured, success=False)
        return self._history.reset(observation), info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Let an action act for 50 ms.

        Raises:
            ConfigError: The action has another size or a number that is not finite.
        """
        action = np.asarray(action, dtype=np.float64)
        if action.shape != (self._commands.size,) or not np.isfinite(action).all():
            raise ConfigError(
                f"action {action.tolist()} must be {self._commands.size} finite "
                f"numbers in [-1, 1], one for each of {' '.join(self._commands.axes)}"
            )
        action = np.clip(action, -1.0, 1.0)
        self._commands.write_target(action, self._goal(), self._target)
        self.state = self.arm.step(self._target, POLICY_PERIOD)
        self._steps += 1
        observation, measured = self._observe()
        success = self._is_inserted(measured)
        reward = insertion_reward(
            measured[7:10], float(measured[10]), success, self._reward
        )
        truncated = self._steps >= self.max_steps and not success
        stacked = self._history.push(action.astype(np.float32), observation)
        return stacked, reward, success, truncated, self._info(measured, success)

    def close(self) -> None:
        """Release the arm."""
        self.arm.close()

    def _sample_configuration(self) -> Vec7:
        """Draw a start pose and solve for the joints; draw again if out of reach."""
        yaw = yaw_relative(self.hole.quat_wxyz, _IDENTITY)
        failure: LimitError | None = None
        for _ in range(20):
            start = sample_start(self.np_random, self.hole, yaw, self._randomisation)
            try:
                return self.arm.robot.inverse_kinematics(start, _SEED)
            except LimitError as error:
                failure = error
        raise ConfigError(f"no start in reach among 20 draws; the last one: {failure}")

    def _goal(self) -> Pose:
        """Return the tool pose of an inserted peg, by the tracker's estimate."""
        hole = self._tracker.estimate().pose
        down = self.scene.hole_depth * matrix_from_quat(hole.quat_wxyz)[:, 2]
        yaw = yaw_relative(hole.quat_wxyz, _IDENTITY)
        return Pose(hole.position - down, tool_down(yaw))

    def _observe(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return the observation and the same 14 numbers in SI units."""
        state, goal = self.state, self._goal()
        measured = np.empty(NUM_OBSERVATIONS)
        measured[:7] = state.q
        measured[7:10] = state.position - goal.position
        yaw = yaw_relative(state.quat_wxyz, TOOL_DOWN)
        measured[10] = wrap_angle(yaw - yaw_relative(goal.quat_wxyz, TOOL_DOWN))
        measured[11:] = state.velocity[:3]
        scaled = np.empty(NUM_OBSERVATIONS, dtype=np.float32)
        scaled[:7] = measured[:7] * self._q_scale
        rest = measured[7:].copy()
        rest[2] -= self.scene.hole_depth
        scaled[7:] = np.sign(rest) * np.log1p(np.abs(rest) / _S)
        return scaled, measured

    def _depth(self, measured: NDArray[np.float64]) -> float:
        """Return how far the tip is below the mouth [m], by the measurement."""
        return self.scene.hole_depth - float(measured[9])

    def _is_inserted(self, measured: NDArray[np.float64]) -> bool:
        """Deep enough, and not beside the block: within half a peg of the axis."""
        aside = float(np.hypot(measured[7], measured[8]))
        inside = aside < self.scene.clearance + 0.1 * self.scene.peg_width
        return inside and self._depth(measured) >= self.scene.success_depth

    def _info(self, measured: NDArray[np.float64], success: bool) -> dict[str, Any]:
        return {
            "success": success,
            "depth": self._depth(measured),
            "position_error": measured[7:10],
            "theta_error": float(measured[10]),
            "contact_force_max": float(np.linalg.norm(self.state.contact_force)),
            "limit_violations": self._limits.count(self.state.log),
            "flags": self.state.flags,
            "observation_unscaled": measured,
        }
