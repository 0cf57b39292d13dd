"""Tare: uncompensated weight, measured in free air and taken off f*.

A cabinet compensates gravity by its own model. What it misses by draws on the tool, at
f* = 0 as much as under a policy that was trained without it: 1.8 m/s2 on twin medium.

The tool is led slowly forth and back along a line. Friction takes as much from f* one
way as it adds the other way, so the mean over both is what holds the weight alone.
Meanwhile the errors of pose and hold axes give the f* that they lack.
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.control.period import POLICY_PERIOD as STEP_TIME
from dovetail.control.task_spec import FORCE, HOLD, POSE, TaskSpec
from dovetail.envs.commands import CommandMap, per_axis
from dovetail.errors import ArmError, ConfigError
from dovetail.poses import Pose, rotation_error
from dovetail.types import Array, Vec3, Vec6
from dovetail.workcell.workcell import Walls

SPEED = 0.015
"""Speed along each axis [m/s]: below the speed limit near contact."""
LEG_STEPS = 10
"""Policy steps of one way."""
TRAVEL = LEG_STEPS * SPEED * STEP_TIME
"""Distance that the tool goes along each axis, and back [m]."""
DAMPING_MIN = 20.0
"""Smallest damping of the force axes with which the tool can be led [1/s]."""
_ROUNDS = 2
_SETTLE_STEPS = 4
_STIFFNESS = 600.0
"""Of the law that leads the tool [1/s2]: with it one round is within 0.3 m/s2 on twin
medium, 0.5 on hard."""
_F_MAX = 12.0
"""Largest f* on the way [m/s2]."""
_UPWARDS = 0.7
"""Of a normal's z [1]: above it a fixture opens upwards, tilted or not."""
_CHANGE_MAX = 2.0
"""Largest change from one round to the next [m/s2]; on twin hard 0.5."""


class Tare(NamedTuple):
    """Result of a tare."""

    f_star: Vec6
    """f* that holds the weight [m/s2, rad/s2], world axes; 0 on free axes."""
    wrench: Vec6
    """Mean wrench on the tool meanwhile, as the arm measured it [N, Nm]: that of the
    weight alone, as dry friction cancels between the way there and the way back."""
    state: ArmState
    """The arm afterwards; its log holds every cycle of the way."""


def measure_tare(
    arm: Arm,
    state: ArmState,
    axes: Sequence[int],
    stiffness: Vec6,
    direction: Vec3,
    near_plane: Array,
) -> Tare:
    """Lead the tool forth and back in free air, and return the f* that holds it.

    Args:
        arm: At rest, nothing within `TRAVEL` of the tool along the direction.
        state: What it said last.
        axes: Which of x, y, z are force axes; each has a damping of `DAMPING_MIN`.
        stiffness: Of the controller's impedance law on pose and hold axes [1/s2]; 0 on
            the others. Their error, times this, is what they lack.
        direction: Where to go first: +1 or -1 for each of x, y, z, shape (3,).
        near_plane: The plane near contact, as in a Target, shape (4,).

    Raises:
        ArmError: The rounds disagree: something is in the way; its `state` has the log
            of the way.
    """
    target = _core.Target()
    target.position_d = start = state.tool.position.copy()
    target.quat_wxyz_d = quat = state.tool.quat_wxyz.copy()
    target.near_plane = near_plane
    is_led = np.isin(np.arange(6), axes)
    lead = np.where(is_led, _STIFFNESS, 0.0)
    way = np.where(is_led[:3], direction, 0.0) * SPEED * STEP_TIME
    along = np.append(near_plane[:3], np.zeros(3))
    reference = start.copy()
    held = change = np.zeros(6)
    logs: list[Array] = []
    wrenches: list[Vec6] = []

    def follow() -> Vec6:
        """Command one step; return what is lacked on each axis before it."""
        nonlocal state
        turn = rotation_error(quat, state.tool.quat_wxyz)
        error = np.append(reference - state.tool.position, turn)
        pull = (lead * error).clip(-_F_MAX, _F_MAX)
        target.f_star = held + pull
        # No press on what is near: the controller would cut it, one way and not the
        # other, and friction would not cancel.
        target.f_tare = held + along * (along @ pull)
        state = arm.step(target, STEP_TIME)
        logs.append(state.log)
        wrenches.append(state.wrench)
        return pull + stiffness * error

    for _ in range(_ROUNDS):
        lacked = []
        for leg in (way, -way):
            for _ in range(LEG_STEPS):
                reference += leg
                lacked.append(follow())
        change = np.mean(lacked, axis=0)
        held = held + change
    wrench = np.mean(wrenches, axis=0)
    for _ in range(_SETTLE_STEPS):
        follow()
    state = state._replace(log=np.vstack(logs))
    worst = np.where(is_led, np.abs(change), 0.0)
    if not worst.max() <= _CHANGE_MAX:
        axis = int(worst.argmax())
        raise ArmError(
            f"tare: f* that holds the tool along {'xyz'[axis]} changed by "
            f"{change[axis]:.1f} m/s2 between two rounds, allowed {_CHANGE_MAX:g}: "
            f"something is in the way within {1e3 * TRAVEL:g} mm of the start, or the "
            "arm does not follow; start in free air, or give --no-tare",
            "tare",
            state,
        )
    return Tare(held, wrench, state)


def tared_axes(task: TaskSpec, force_damping: float | Sequence[float]) -> list[int]:
    """Return the force axes along which the tool can be led, of x, y, z.

    Args:
        task: Mode of each axis.
        force_damping: Damping of force axes X Y Z [1/s], one number or three.

    Raises:
        ConfigError: There is none, or one has not enough damping.
    """
    axes = [axis for axis in range(3) if task.modes[axis] == FORCE]
    if not axes:
        raise ConfigError(
            f"tare needs a force axis among X Y Z; task '{task}' has none: leave tare "
            "out (--no-tare)"
        )
    damping = per_axis("force_damping", force_damping)
    if (least := min(damping[axis] for axis in axes)) < DAMPING_MIN:
        raise ConfigError(
            f"force_damping is {least:g} 1/s; tare needs at least {DAMPING_MIN:g}: "
            "nothing else damps the tool on its way; leave tare out (--no-tare)"
        )
    return axes


def can_tare(task: TaskSpec, force_damping: float | Sequence[float]) -> bool:
    """Say whether the tool can be led; warn of weight on force axes where it cannot.

    Without a force axis among X Y Z the controller follows by itself what pulls.
    """
    if FORCE not in task.modes[:3]:
        return False
    try:
        tared_axes(task, force_damping)
    except ConfigError as error:
        warnings.warn(
            f"weight that the arm's gravity compensation misses is not held: {error}",
            stacklevel=2,
        )
        return False
    return True


class ToolTare:
    """Takes the tare of an arm's tool, and hands it to the commands."""

    def __init__(
        self,
        arm: Arm,
        commands: CommandMap,
        force_damping: float | Sequence[float],
    ) -> None:
        """Find out which axes can be measured.

        Args:
            arm: Its law says how stiff pose and hold axes are.
            commands: Its task says what is measured; gets that.
            force_damping: Damping of force axes X Y Z [1/s], one number or three.

        Raises:
            ConfigError: See `tared_axes`.
        """
        self._arm, self._commands = arm, commands
        self._axes = tared_axes(commands.task, force_damping)
        is_held = np.isin(commands.task.modes, (POSE, HOLD))
        self._stiffness: Vec6 = np.where(is_held, arm.facts.osc.stiffness, 0.0)

    def far_end(
        self, start: Vec3, fixture: Pose, near_plane: Array, walls: Walls
    ) -> Vec3:
        """Return the point [m] to which the tool is led, and back.

        Args:
            start: Where the tool is [m].
            fixture: Where not to go.
            near_plane: The plane near contact, as in a Target, shape (4,).
            walls: Lower and upper walls of the TCP [m].
        """
        is_led = np.isin(np.arange(3), self._axes)
        way = TRAVEL * self._direction(start, fixture, near_plane, walls)
        return start + np.where(is_led, way, 0.0)

    def _direction(
        self, start: Vec3, fixture: Pose, near_plane: Array, walls: Walls
    ) -> Vec3:
        """Return where to go first along x y z: away from fixture and walls.

        The limits hold the tool their margin before a wall. There a way would be cut,
        and friction would not cancel.
        """
        margin = self._arm.facts.limits.delta_x
        direction = np.where(start >= fixture.position, 1.0, -1.0)
        out, surface = near_plane[:3], near_plane[3]
        if not (out[2] < _UPWARDS and out @ start < surface):
            direction[2] = 1.0
        end = start + 2.0 * TRAVEL * direction
        low, high = np.array(walls[0]) + margin, np.array(walls[1]) - margin
        return np.where((end < low) | (end > high), -direction, direction)

    def take(
        self, state: ArmState, fixture: Pose, near_plane: Array, walls: Walls
    ) -> Tare:
        """Measure, leading the tool up and away from the fixture first.

        Beside a fixture in a wall up may be towards it: there away is away in height,
        too.

        Args:
            state: What the arm said last; nothing touches the tool.
            fixture: Where not to go.
            near_plane: The plane near contact, as in a Target, shape (4,).
            walls: Lower and upper walls of the TCP [m]: where the limits' margin before
                one is near, the other way is taken.

        Returns:
            What was measured, and the arm afterwards, back where it was.

        Raises:
            ArmError: Something is in the way.
        """
        start = state.tool.position
        direction = self._direction(start, fixture, near_plane, walls)
        tare = measure_tare(
            self._arm, state, self._axes, self._stiffness, direction, near_plane
        )
        self._commands.take_off(tare.f_star)
        return tare
