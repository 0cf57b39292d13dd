"""Search by touch with a tilted part: one corner falls into the opening, and is led.

Upright, the part falls in only where it stands within the clearance of the middle.
Tilted so that one corner is lowest, that corner falls in almost wherever it is inside
the opening, at any clearance. Then it is pushed until two walls stop it, which tells
where the opening is, and the part is turned upright there and pushed in.

Only what an arm measures of itself is used, and where the fixture was seen last.
"""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dovetail.control.period import POLICY_PERIOD
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.commands import per_axis
from dovetail.envs.contact_env import ContactEnv
from dovetail.errors import ConfigError
from dovetail.poses import (
    matrix_from_quat,
    quat_conjugate,
    quat_from_vector,
    quat_multiply,
)
from dovetail.search.corner_config import CornerSearchConfig
from dovetail.types import Array, Mat33, Vec3

SEARCH_AXES = "XYZ:force ABC:pose"
"""Mode of each axis that the search needs: it tilts the part."""

_UP: Vec3 = np.array([0.0, 0.0, 1.0])
_LEVEL: Vec3 = np.array([1.0, 1.0, 0.0])
_NEAR = 0.003
"""Distance from a place in the air at which it counts as reached [m]."""
_PITCH = 0.004
"""Distance between two points of the path, and from one that is reached [m]."""
_RESPONSE = 0.1
"""Time in which a distance is made up through free air [s]."""
_STILL = 0.003
"""Speed below which the part stands [m/s]."""
_DEEP = 0.0005
"""Depth of the end's middle from which the whole end is in [m]."""
_SLID = 0.0002
"""Way in 0.6 s from which the corner slides [m]."""
_LOST = 0.00024
"""Depth above which a corner that leaned in the opening has come out [m]."""
_BESIDE = 0.010
"""Depth that a tilted part has only beside the fixture [m]."""
_ASTRAY = 0.010
"""Way beyond the widest ring and the opening that is no path's [m]."""
_SHAKES = 2.5
"""Frequency of the shaking from side to side [Hz]."""
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""Angle whose multiples are spread evenly [rad]."""
_TOUCH_STEPS, _STILL_STEPS, _STUCK_STEPS = 3, 6, 12
"""Policy steps without motion until the part stands: on its way down, into the opening,
over the surface."""
_SEAT_STEPS, _PUSH_STEPS = 60, 40
"""Policy steps at most to the opening's corner, and at least on the way in."""


class CornerSearch:
    """Acts as a policy does: called once a step of 50 ms, gives the next action.

    `reset` begins an episode. When the part does not go in, the search begins again,
    on another path, for as long as it is called.
    """

    def __init__(
        self, env: ContactEnv, config: CornerSearchConfig | None = None
    ) -> None:
        """Take the environment to act in, on any arm.

        Args:
            env: Its task tells of an opening (`Task.outline`) and lets the part be
                tilted: axes `SEARCH_AXES`. Read are its arm's state and its tracker.
            config: How the corner is led.

        Raises:
            ConfigError: The task has other axes, or no opening.
        """
        self.config = config or CornerSearchConfig()
        outline = env.task.outline()
        if outline is None:
            raise ConfigError(
                f"a corner search needs a task that tells of its opening; "
                f"{type(env.task).__name__} has no outline()"
            )
        if env.axes != TaskSpec.parse(SEARCH_AXES):
            raise ConfigError(
                f"a corner search needs the axes '{SEARCH_AXES}'; here they are "
                f"'{env.axes}': add --task '{SEARCH_AXES}'"
            )
        self._env = env
        corner = max(outline.opening, key=lambda point: float(point @ point))
        radius = math.hypot(*corner)
        self._along: Vec3 = np.append(corner / radius, 0.0)
        """Towards the opening's corner, in the fixture's frame, as all that follows."""
        share = 1.0 - (env.task.gap() or 0.0) / _inner_radius(outline.opening)
        self._part_corner = share * radius * self._along
        self._tilt_axis = np.cross(_UP, self._along)
        self._depth, self._wide = outline.depth, 2.0 * radius
        self._leaning = self._without_wedging(2.0 * (env.task.gap() or 0.0))
        self._damping = np.array(per_axis("", env.config.force_damping))
        self._scale = np.array(env.commands.scale)
        near_speed = env.config.near_speed
        self._fast_from = env.config.near_distance + _NEAR
        """Height above the surface from which the arm is not slow [m]."""
        self._slide_speed = min(self.config.slide_speed, near_speed)
        """Speed of the slide [m/s]; a shortfall from more would count as friction."""
        most = float((self._scale[:3] / np.maximum(self._damping, 1e-9)).min())
        self._air_speed = min(self.config.speed, most)
        """Speed through free air that an action can ask for [m/s]."""
        self._farthest = max(self.config.rings) + self._wide + _ASTRAY
        """Distance from the fixture beyond which no path leads [m]."""
        self.reset()

    def _without_wedging(self, play: float) -> float:
        """Return the tilt with which the part is led in [rad], 0 in a tight fit."""
        most, c = self.config.leaning, self.config
        until_deep = _DEEP + 0.5 * most * self._wide
        leaning = most if play > most * until_deep else 0.0
        rate = c.turn_rate if leaning > 0.0 else c.stir_rate
        self._around = 1.0 / (rate * POLICY_PERIOD)
        """Policy steps of one round of what is tried in the opening's corner."""
        return leaning

    def reset(self) -> None:
        """Begin anew."""
        self._tries = 0
        self._surface = 0.0
        """Its height, as touched [m]."""
        self._search()

    def __call__(self, observation: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return the next action; what is measured is read from the arm's state."""
        self._look()
        if self._phase != self._go_over and self._is_astray():
            self._search()
        self._steps += 1
        self._track.append(self._end)
        force, tilt = self._phase()
        return self._action(force, tilt, self._turn)

    @property
    def phase(self) -> str:
        """Current phase: go over, touch, slide, seat, straighten or push."""
        return self._phase.__name__.removeprefix("_").replace("_", " ")

    def _begin(self, phase: Callable[[], tuple[Vec3, float]]) -> None:
        """Begin a phase with the next step."""
        self._phase = phase
        self._steps = 0
        self._track: deque[Vec3] = deque(maxlen=_STUCK_STEPS + 1)
        self._friction: Vec3 = np.zeros(3)
        self._growth = 0.0
        self._turn = 0.0

    def _search(self) -> None:
        """Begin at the start of a path, after the first on one beside the earlier."""
        self._begin(self._go_over)
        angle = _GOLDEN * self._tries
        beside = _PITCH * np.array([math.cos(angle), math.sin(angle), 0.0])
        # From here, not from the middle, most of the opening catches the corner.
        middle = 0.3 * self._part_corner + min(self._tries, 1) * beside
        self._path = [middle, *self._rings(middle)]
        self._tries += 1

    def _rings(self, middle: Vec3) -> list[Vec3]:
        """Return points on circles about the middle [m]."""
        points = []
        for radius in self.config.rings:
            count = math.ceil(2.0 * math.pi * radius / _PITCH)
            for step in range(count + 1):
                angle = _GOLDEN * self._tries + 2.0 * math.pi * step / count
                circle = np.array([math.cos(angle), math.sin(angle), 0.0])
                points.append(middle + radius * circle)
        return points

    def _look(self) -> None:
        """Take from the arm's state where the corner is, in the fixture's frame."""
        state, seen = self._env.state, self._env.tracker.estimate().pose
        goal = self._env.task.goal(seen)
        self._rotation: Mat33 = matrix_from_quat(seen.quat_wxyz)
        R = self._rotation.T
        turn = quat_multiply(state.tool.quat_wxyz, quat_conjugate(goal.quat_wxyz))
        turned = R @ matrix_from_quat(turn) @ self._rotation
        self._end: Vec3 = R @ (state.tool.position - seen.position)
        self._corner: Vec3 = self._end + turned @ self._part_corner
        self._velocity: Vec3 = R @ state.tool.velocity[:3]
        self._yaw = math.atan2(turned[1, 0], turned[0, 0])

    def _action(self, force: Vec3, tilt: float, turn: float) -> NDArray[np.float32]:
        """Return the action that commands f* [m/s2], a tilt and a turn [rad]."""
        axis = self._rotation @ self._tilt_axis
        tilted = matrix_from_quat(quat_from_vector(tilt * axis))
        out = self._rotation @ _UP
        R = matrix_from_quat(quat_from_vector(turn * out)) @ tilted
        # The turns about the world's z, y, x, one after the other, that make R.
        about_z = math.atan2(-R[0, 1], R[0, 0])
        about_y = math.asin(R[0, 2])
        about_x = math.atan2(-R[1, 2], R[2, 2])
        asked = np.array([*(self._rotation @ force), about_z, about_y, about_x])
        return np.clip(asked / self._scale, -1.0, 1.0).astype(np.float32)

    def _towards(self, velocity: Vec3) -> Vec3:
        """Return the f* that moves the part at a velocity [m/s] in free air."""
        R = self._rotation
        return R.T @ (self._damping * (R @ velocity))

    def _is_still(self, steps: int) -> bool:
        """Say whether the part has stood for so many steps; speeds are too noisy."""
        if len(self._track) <= steps:
            return False
        way = self._end - self._track[-1 - steps]
        return bool(np.linalg.norm(way) < _STILL * steps * POLICY_PERIOD)

    def _is_in(self, is_stuck: bool = False) -> bool:
        """Say whether the corner has fallen in, and remember where.

        Args:
            is_stuck: Something holds it, an edge of the opening if it is a bit lower.
        """
        drop = self.config.drop
        drop = 0.4 * drop if is_stuck else drop
        is_in = bool(self._corner[2] < self._surface - drop)
        if is_in:
            self._fell_at = self._corner * _LEVEL + 0.15 * self._part_corner
        return is_in

    def _is_astray(self) -> bool:
        """Say whether the part was pushed away, to where no path leads."""
        return math.hypot(*self._end[:2]) > self._farthest

    def _go_over(self) -> tuple[Vec3, float]:
        """Go through free air to where the path begins."""
        c = self.config
        way = self._path[0] - self._corner
        beside = float(np.abs(way[:2]).max())
        # Near the surface the arm is slow: what is far beside goes there above it.
        height = c.over if beside < _BESIDE else max(c.over, self._fast_from)
        way[2] = height - self._corner[2]
        if max(beside, abs(way[2])) < _NEAR:
            self._begin(self._touch)
        if self._corner[2] < 0.6 * c.over:  # perhaps beside the fixture: up first
            way = np.array([0.0, 0.0, way[2] + _NEAR])
        velocity = way / _RESPONSE
        most = float(np.abs(velocity).max())
        force = self._towards(velocity * min(1.0, self._air_speed / max(most, 1e-9)))
        # What is deep in the opening, or beside the fixture, comes out upright.
        tilt = self.config.tilt if self._end[2] > self._surface - _DEEP else 0.0
        return force, tilt

    def _touch(self) -> tuple[Vec3, float]:
        """Go down until something is in the way."""
        c = self.config
        if self._is_in():
            self._begin(self._seat)
        elif self._is_still(_TOUCH_STEPS):
            self._surface = float(self._corner[2])
            self._begin(self._slide)
        return self._towards(-c.touch_speed * _UP), c.tilt

    def _slide(self) -> tuple[Vec3, float]:
        """Slide over the surface, along the path, until the corner falls in."""
        c, tilt = self.config, self.config.tilt
        press = -c.slide_press * _UP
        is_stuck = self._is_still(_STUCK_STEPS)
        if self._is_in(is_stuck):
            self._begin(self._seat)
            return press, tilt
        while self._path and math.dist(self._path[0][:2], self._corner[:2]) < _PITCH:
            self._path.pop(0)
        if is_stuck and self._path:
            self._path.pop(0)
            self._track.clear()
        if not self._path:
            self._search()
            return -press, tilt
        way = (self._path[0] - self._corner) * _LEVEL
        velocity = self._slide_speed * way / np.linalg.norm(way)
        lacking = velocity - self._velocity * _LEVEL
        more = self._friction + c.slide_rate * POLICY_PERIOD * lacking
        size = float(np.linalg.norm(more))
        self._friction = more * min(1.0, c.friction / max(size, 1e-9))
        push = self._towards(velocity) + c.slide_gain * lacking + self._friction
        return push + press, tilt

    def _seat(self) -> tuple[Vec3, float]:
        """Push the corner into the opening's corner: then the end lies in the mouth."""
        c = self.config
        towards = self._along
        way = (self._end - self._track[0]) * _LEVEL
        size = float(np.linalg.norm(way))
        if size > _SLID and way @ self._along > 0.0:
            # Along the wall that it slides on already: what presses on it is friction.
            towards = self._along + way / size
            towards /= np.linalg.norm(towards)
        if self._end[2] < -_BESIDE:
            self._search()
        elif math.dist(self._corner[:2], self._fell_at[:2]) > self._wide:
            self._surface = float(self._corner[2])  # lower than it was believed
            self._search()
        elif self._corner[2] > self._surface - _LOST and self._steps > _TOUCH_STEPS:
            self._cross()
        elif self._end[2] - self._surface < 0.3 * _DEEP or self._steps > _SEAT_STEPS:
            self._begin(self._straighten)
        lacking = self._slide_speed - float(self._velocity @ self._along)
        growth = self._growth + c.seat_rate * POLICY_PERIOD * lacking
        self._growth = min(growth, c.friction)
        return self._pushed(c.seat_push + self._growth, towards), c.tilt

    def _cross(self) -> None:
        """Begin again beside the way on which the corner came through the opening.

        It went along a chord, on whose perpendicular through the middle lies the
        opening's middle, to the one side or the other.
        """
        middle = 0.5 * (self._fell_at + self._corner) * _LEVEL
        beside = 0.25 * self._wide * self._tilt_axis
        self._search()
        self._path[:0] = [middle + beside, middle - beside]

    def _straighten(self) -> tuple[Vec3, float]:
        """Turn the part upright, or nearly so, its corner pushed into the opening's."""
        c = self.config
        share = self._steps * POLICY_PERIOD / c.straighten_time
        if share >= 1.0:
            self._begin(self._push)
        tilt = c.tilt + min(1.0, share) * (self._leaning - c.tilt)
        return self._pushed(c.hold_push, self._along), tilt

    def _push(self) -> tuple[Vec3, float]:
        """Push the part in; where that does not help, go back to where it fell in."""
        deep = self._surface - _DEEP - 0.5 * self._leaning * self._wide
        is_out = self._end[2] > deep
        is_lost = self._leaning > 0.0 and self._corner[2] > self._surface - _LOST
        wait = self._around if is_out else _PUSH_STEPS
        if self._end[2] < -self._depth - _BESIDE:
            self._search()
        elif is_lost or (self._is_still(_STILL_STEPS) and self._steps > wait):
            self._search()
            self._path.insert(0, self._fell_at)
        elif is_out:
            return self._stirred(), self._leaning
        else:
            self._turn = self._yaw  # as the opening's walls turn it
        return self._shaken() - self.config.press * _UP, 0.0

    def _stirred(self) -> Vec3:
        """Return a push into the opening's corner that tries all places and turns.

        What leans in that corner is turned about it, from side to side; what stands
        upright on the rim goes round and round.
        """
        c = self.config
        phase = 2.0 * math.pi * self._steps / self._around
        if self._leaning > 0.0:
            self._turn = c.turn * math.sin(phase)
            return c.lean * self._along - c.press * _UP
        around = c.stir * (1.0 + math.cos(phase))
        return (
            around * self._along
            + c.stir * math.sin(phase) * self._tilt_axis
            - c.press * _UP
        )

    def _pushed(self, push: float, towards: Vec3) -> Vec3:
        """Return a push in a level direction, and down what it would lift."""
        c = self.config
        press = c.seat_press + c.lift * push
        return push * towards + self._shaken() - press * _UP

    def _shaken(self) -> Vec3:
        phase = 2.0 * math.pi * _SHAKES * self._steps * POLICY_PERIOD
        return self.config.shake * math.sin(phase) * self._tilt_axis


def _inner_radius(opening: Array) -> float:
    """Return the distance from the origin to the nearest edge of a closed line [m]."""
    begin, way = opening[:-1], np.diff(opening, axis=0)
    area = begin[:, 0] * way[:, 1] - begin[:, 1] * way[:, 0]
    return float(np.min(np.abs(area) / np.linalg.norm(way, axis=1)))
