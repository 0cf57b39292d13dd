"""Teleoperation of an environment: a person leads the tool in place of the policy.

The person sets a pose for the tool to follow. It becomes an action of the environment,
so that the same controller and the same limits act on it.
"""

import math
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dovetail.control.task_spec import AXES, FORCE, TaskSpec
from dovetail.envs.commands import per_axis
from dovetail.envs.contact_env import ContactEnv
from dovetail.envs.unwrapped import require_contact_env
from dovetail.poses import Pose, matrix_from_quat, rotation_error
from dovetail.types import Array

GAIN = 6.0
"""Gain from the distance to the led pose to the tool's speed [1/s]."""
LEAD_SPEED = 0.1
"""Largest speed of the lead [m/s]; the controller's limits are lower near contact."""
_BRAKE = 8.0  # [1/s] damping, where the environment has less
_TURN, _TURN_BRAKE = 100.0, 20.0  # [1/s2, 1/s] of force axes A B C: critically damped


def action_towards(core: ContactEnv, to: Pose) -> NDArray[np.float32]:
    """Return the action by which the tool follows a pose.

    Force axes X Y Z become a velocity towards it of `GAIN` times what is missing, pose
    axes the displacement or turn from the goal. Axes that the environment does not
    command are left out.

    Args:
        core: The environment, after a reset.
        to: Pose for the tool to follow, world axes.
    """
    state, commands = core.state, core.commands
    goal = core.task.goal(core.tracker.estimate().pose)
    damping = np.array(per_axis("force_damping", core.config.force_damping))
    way = np.asarray(to.position, dtype=float) - state.tool.position
    wanted = GAIN * way
    wanted *= min(1.0, LEAD_SPEED / max(float(np.abs(wanted).max()), 1e-12))
    brake = np.maximum(_BRAKE - damping, 0.0)
    forward = damping * wanted + brake * (wanted - state.tool.velocity[:3])
    turn = rotation_error(np.asarray(to.quat_wxyz), state.tool.quat_wxyz)
    angular = _TURN * turn - _TURN_BRAKE * state.tool.velocity[3:]
    force = np.concatenate([forward, angular])
    shift = np.concatenate([to.position - goal.position, _turns(to, goal.quat_wxyz)])
    modes = core.axes.modes
    places = [AXES.index(axis) for axis in commands.axes]
    asked = [force[i] if modes[i] == FORCE else shift[i] for i in places]
    scaled = np.array(asked) / np.maximum(commands.scale, 1e-12)
    return scaled.clip(-1.0, 1.0).astype(np.float32)


def _turns(to: Pose, goal_quat: Array) -> Array:
    """Return the turns about world x, y, z that make the goal's rotation another.

    They act in the order z, y, x, as `CommandMap` does them.
    """
    turn = matrix_from_quat(np.asarray(to.quat_wxyz)) @ matrix_from_quat(goal_quat).T
    about_y = math.asin(min(1.0, max(-1.0, turn[0, 2])))
    about_x = math.atan2(-turn[1, 2], turn[2, 2])
    about_z = math.atan2(-turn[0, 1], turn[0, 0])
    return np.array([about_x, about_y, about_z])


def resting_action(
    axes: TaskSpec, action: NDArray[np.float32], commanded: tuple[str, ...]
) -> NDArray[np.float32]:
    """Return the action that stays: force axes at 0, pose axes where they were.

    Args:
        axes: Mode of each axis.
        action: The last action.
        commanded: The action's axes.
    """
    is_force = [axes.modes[AXES.index(axis)] == FORCE for axis in commanded]
    return np.where(is_force, 0.0, action).astype(np.float32)


class TeleopWrapper(gymnasium.Wrapper):
    """Takes a person's action in place of the policy's whenever there is one.

    `info["is_intervention"]` is True then, and `info["action"]` is the action taken.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        lead: Callable[[ContactEnv], NDArray[np.float32] | None],
    ) -> None:
        """Wrap an environment.

        Args:
            env: An environment of dovetail, wrapped or not.
            lead: Returns the person's action, or None while no person leads; called
                once per step.

        Raises:
            ConfigError: It is no environment of dovetail.
        """
        super().__init__(env)
        self._core, self._lead = require_contact_env(env), lead

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Follow the person's action, or else this one, for 50 ms."""
        led = self._lead(self._core)
        taken = action if led is None else led
        self._core.is_led = led is not None
        seen, reward, ended, cut, info = self.env.step(taken)
        told = {
            "is_intervention": led is not None,
            "action": self._core.done_for(taken),
        }
        return seen, reward, ended, cut, info | told
