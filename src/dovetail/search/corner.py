"""Search by touch with a tilted part: one corner falls into the opening, and is led.

Upright, the part falls in only where it stands within the clearance of the middle.
Tilted so that one corner is lowest, that corner falls in almost wherever it is inside
the opening, at any clearance. Then it is pushed until two walls stop it, which tells
where the opening is, and the part is turned upright there and pushed in.

A part that a list of shapes describes may have no corner that can be led so. It is
first put down upright where the opening is believed, and pressed there for a while.
One with several pins is led by one of them, which is small, but alone. Where walls
stand inside the opening, as a socket's tongue does, the upright part slides over it on
a spiral in every second try.

A part that goes over a post is led the other way round: the lowest corner of its bore
is put down outside of the post, and drawn back until it is held by the post's walls.

Only what an arm measures of itself is used, and where the fixture was seen last.
"""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dovetail.control.period import POLICY_PERIOD
from dovetail.control.task_spec import TaskSpec
from dovetail.envs.contact_env import ContactEnv
from dovetail.errors import ConfigError
from dovetail.search.corner_config import CornerSearchConfig
from dovetail.search.led_corner import SoughtOpening
from dovetail.search.led_part import RESPONSE, LedPart
from dovetail.tasks.grasp import Grasp
from dovetail.tasks.task import Outline
from dovetail.types import Vec3

SEARCH_AXES = "XYZ:force ABC:pose"
"""Mode of each axis that the search needs: it tilts the part."""

_UP: Vec3 = np.array([0.0, 0.0, 1.0])
_LEVEL: Vec3 = np.array([1.0, 1.0, 0.0])
_NEAR = 0.003
"""Distance from a place in the air at which it counts as reached [m]."""
_PITCH = 0.004
"""Distance between two points of the path, and from one that is reached [m]."""
_USUAL_SIZE = 0.012
"""`SoughtOpening.catch` from which path and drop are those of the settings [m]."""
_SHALLOW, _SHALLOW_PIN = 0.15, 0.08
"""Least drop of a corner that is in a small opening, per size [1]: of a part that has
one, and of a pin, which the others hold."""
_CROSSING = 0.05
"""Least time in which a corner slides over an opening of its size [s]."""
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
_STEP = 0.0015
"""Depth below the last surface from which what holds a part is a step inside [m]."""
_ROOM = 0.008
"""Least distance of the opening from where it is believed that is searched [m]."""
_FALLEN = 0.0004
"""Way down at such a step from which the part has fallen on [m]."""
_WIND, _WIDEST = 0.02, 0.0030
"""Speed on the spiral there [m/s], and its largest radius [m]."""
_CLOSEST = 0.00025
"""Least distance between two turns of it [m]."""
_SWAY, _SWAYS = 0.03, 1.7
"""Turn to both sides meanwhile [rad], and its frequency [Hz]: it may be turned."""
_FOLLOW = 6.0
"""Gain from the distance to the spiral to speed [1/s]."""
_SUNK = 0.6
"""The post is in the bore once the bore's lowest corner is this share of its depth
below the end's middle under the surface [1]."""
_AWAY = 0.008
"""Most distance from a post at which that corner is put down [m]."""
_UPRIGHT = 0.002
"""Distance from the believed opening at which an upright part goes down [m]."""
_HOLD = 200.0
"""Gain from that distance to f* while it is pressed there, and from the distance to
where a part fell in while it is pushed in [1/s2]."""
_PULL = 0.1
"""Way up on which an upright part is pulled out [m]: as hard as an action may."""
_ROUNDS = 1.5
"""Rounds on which it is pressed [1]."""
_ASTRAY = 0.010
"""Way beyond the widest ring and the opening that is no path's [m]."""
_ROCK, _ROCK_TURNS = 0.2, 0.02
"""Speed on the spiral of tilts [rad/s], and between two turns of it [rad]."""
_SHAKES = 2.5
"""Frequency of the shaking from side to side [Hz]."""
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""Angle whose multiples are spread evenly [rad]."""
_TOUCH_STEPS, _STILL_STEPS, _STUCK_STEPS = 3, 6, 12
"""Policy steps without motion until the part stands: on its way down, into the opening,
over the surface."""
_SEAT_STEPS, _PUSH_STEPS, _OUT_STEPS = 60, 40, 10
"""Policy steps at most to the opening's corner, at least on the way in, and out from
under the fixture."""


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
        gap = env.task.gap() or 0.0
        self._opening = SoughtOpening(_outline_of(env), gap)
        self._led = self._opening.corners[0]
        self._part = LedPart(env, self.config.speed)
        self._turns = max(0.8 * gap, _CLOSEST)
        """Distance between two turns of a spiral [m]."""
        self._take_path(env.config.near_speed)
        self._take_heights(env)
        self._take_grasp(env.grasp_range)
        self._take_leaning(2.0 * gap)
        self.reset()

    def _take_path(self, near_speed: float) -> None:
        """Take path, speed and drop: all less where the opening is small.

        Args:
            near_speed: Most speed in contact [m/s].
        """
        opening, c = self._opening, self.config
        share = min(1.0, opening.catch / _USUAL_SIZE)
        self._pitch = share * _PITCH
        self._radii = [share * ring for ring in c.rings]
        """Radii of the circles of the path [m]: closer where the opening is small."""
        if share < 1.0:  # a small fixture ends near the opening: first close to it
            self._radii.insert(0, 0.5 * self._radii[0])
        self._room = max(_ROOM, opening.outer)
        """Distance from the believed opening from which a part is beside it [m]."""
        if opening.has_steps:  # what ends beside the fixture is on no path
            self._radii = [ring for ring in self._radii if ring < self._room + _PITCH]
        shallow = _SHALLOW_PIN if opening.is_pin else _SHALLOW
        self._drop = min(c.drop, shallow * opening.catch)
        if opening.is_post:
            sunk = _SUNK * opening.radius * math.sin(c.tilt)
            self._drop = max(self._drop, min(sunk, 0.5 * opening.depth))
        self._slide_speed = min(c.slide_speed, near_speed, opening.catch / _CROSSING)
        """Speed of the slide [m/s]; a shortfall from more would count as friction."""
        self._farthest = max(c.rings) + opening.wide + _ASTRAY
        """Distance from the fixture beyond which no path leads [m]."""

    def _take_heights(self, env: ContactEnv) -> None:
        """Take the heights above the fixture and the depth beside it."""
        top = float(env.task.fixture(0.0).corners[:, 2].max())
        self._above = max(top, 0.0) + self.config.over
        """Height of the corner above all of the fixture [m]."""
        self._fast_from = env.config.near_distance + _NEAR
        """Height above the surface from which the arm is not slow [m]."""
        opening = self._opening
        self._beside = _BESIDE + (opening.depth if opening.has_steps else 0.0)
        """Depth of a tilted part's end that it has only beside the fixture [m]."""

    def _take_grasp(self, held: Grasp) -> None:
        """Take how far the part may sit wrong in the fingers."""
        opening = self._opening
        self._askew = math.sqrt(2.0) * held.turn
        """Most that the part is held askew [rad]."""
        self._unsure = 0.0
        """Depth below its believed height at which an untouched surface may lie [m]."""
        if any(held):
            far = max(float(np.linalg.norm(one.on_part)) for one in opening.corners)
            lever = max(opening.radius, far)
            self._unsure = held.error + self._askew * lever + _DEEP

    def _take_leaning(self, play: float) -> None:
        """Take the tilt with which the part is led in: 0 in a tight fit.

        Args:
            play: Of the part in its opening [m].
        """
        most, c = self.config.leaning, self.config
        until_deep = _DEEP + most * self._led.lever
        self._leaning = most if play > most * until_deep else 0.0
        rate = c.turn_rate if self._leaning > 0.0 else c.stir_rate
        self._around = 1.0 / (rate * POLICY_PERIOD)
        """Policy steps of one round of what is tried in the opening's corner."""

    def reset(self) -> None:
        """Begin anew."""
        self._tries = self._steps_met = 0
        self._surface = self._touched_at = 0.0
        """Its height, as touched [m], or as it was seen; and before a spiral."""
        self._is_touched = self._winds = False
        self._search()
        if self._opening.has_steps:  # any shape: perhaps it is where it is believed
            self._tries = 0
            self._winds = False
            self._begin(self._lower)

    def __call__(self, observation: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return the next action; what is measured is read from the arm's state."""
        self._part.look(self._led.on_part)
        if self._has_fallen and self._is_beside():
            self._search_lower()
        elif not self._is_on_the_way and self._is_astray():
            self._search()
        self._steps += 1
        self._track.append(self._part.end)
        force, tilt = self._phase()
        turn = self._given + self._turn * _UP
        return self._part.action(force, self._led.tilt_axis, tilt, turn)

    @property
    def phase(self) -> str:
        """Current phase: lower, settle, go over or out, touch, slide, seat, ..."""
        return self._phase.__name__.removeprefix("_").replace("_", " ")

    def _begin(self, phase: Callable[[], tuple[Vec3, float]]) -> None:
        """Begin a phase with the next step."""
        self._phase = phase
        self._steps = 0
        self._track: deque[Vec3] = deque(maxlen=_STUCK_STEPS + 1)
        self._friction: Vec3 = np.zeros(3)
        self._growth = 0.0
        self._was_above = False
        """True once an upright part that is lowered was over the surface."""
        self._fell_in: Vec3 | None = None
        """Place of the end when all of it was in [m]."""
        self._turn = 0.0
        self._given: Vec3 = np.zeros(3)

    def _search(self) -> None:
        """Begin at the start of a path, after the first on one beside the earlier.

        Where walls stand inside the opening, every second try is upright, on a spiral.
        """
        corners = self._opening.corners
        self._led = corners[self._tries % len(corners)]
        if self._winds:  # where an upright part stood is no surface for a corner
            self._surface = self._touched_at
        self._touched_at = self._surface
        self._winds = self._opening.is_divided and self._tries % 2 == 0
        self._begin(self._lower if self._winds else self._go_over)
        self._level = math.inf
        """Height of the last place inside at which it stood [m]."""
        self._upright: Vec3 = np.zeros(3)
        """Rotation around which `_rock` tilts the part [rad]."""
        angle = _GOLDEN * self._tries
        beside = self._pitch * np.array([math.cos(angle), math.sin(angle), 0.0])
        # From here, not from the middle, most of the opening catches the corner.
        away = -0.7 * self._led.size
        if self._opening.is_post:
            away = min(0.7 * self._led.size, _AWAY)
        first = self._led.on_part + away * self._led.along
        middle = first + min(self._tries, 1) * beside
        self._path = [middle, *self._rings(middle)]
        self._tries += 1

    def _search_lower(self) -> None:
        """Begin again: the corner is on the surface, which is lower than believed."""
        self._surface = float(self._part.corner[2])
        self._search()

    def _rings(self, middle: Vec3) -> list[Vec3]:
        """Return points on circles about the middle [m]."""
        points = []
        for radius in self._radii:
            count = math.ceil(2.0 * math.pi * radius / self._pitch)
            for step in range(count + 1):
                angle = _GOLDEN * self._tries + 2.0 * math.pi * step / count
                circle = np.array([math.cos(angle), math.sin(angle), 0.0])
                points.append(middle + radius * circle)
        return points

    def _is_still(self, steps: int) -> bool:
        """Say whether the part has stood for so many steps; speeds are too noisy."""
        if len(self._track) <= steps:
            return False
        way = self._part.end - self._track[-1 - steps]
        return bool(np.linalg.norm(way) < _STILL * steps * POLICY_PERIOD)

    def _note_fall(self, is_stuck: bool) -> bool:
        """Note where the corner fell in, and say whether it did.

        Args:
            is_stuck: Something holds it, an edge of the opening if it is a bit lower.
        """
        drop = 0.4 * self._drop if is_stuck else self._drop
        is_in = bool(self._part.corner[2] < self._surface - drop)
        if is_in:
            shift = 0.15 * (self._led.size * self._led.to_walls)
            self._fell_at = self._part.corner * _LEVEL + shift
        return is_in

    @property
    def _has_fallen(self) -> bool:
        """True while the corner is believed to be in the opening."""
        return self._phase in (self._seat, self._straighten, self._push)

    @property
    def _is_on_the_way(self) -> bool:
        """True while the part goes through free air."""
        return self._phase in (self._lower, self._go_over, self._go_out)

    def _is_beside(self) -> bool:
        """Say whether the corner is where no opening that it fell into can be."""
        return math.dist(self._part.corner[:2], self._fell_at[:2]) > self._opening.wide

    def _is_astray(self) -> bool:
        """Say whether the part was pushed away, to where no path leads."""
        return math.hypot(*self._part.end[:2]) > self._farthest

    def _go_over(self) -> tuple[Vec3, float]:
        """Go through free air to where the path begins."""
        c = self.config
        way = self._path[0] - self._part.corner
        beside = float(np.abs(way[:2]).max())
        # Near the surface the arm is slow: what is far beside goes there above it.
        height = c.over if beside < _BESIDE else max(self._above, self._fast_from)
        way[2] = height - self._part.corner[2]
        if max(beside, abs(way[2])) < _NEAR:
            self._begin(self._touch)
        if self._part.corner[2] < 0.6 * c.over:  # perhaps beside the fixture: up first
            way = np.array([0.0, 0.0, way[2] + _NEAR])
            if self._is_still(_STUCK_STEPS):  # a part of the fixture hangs over it
                self._begin(self._go_out)
        # What is deep in the opening, or beside the fixture, comes out upright.
        tilt = self.config.tilt if self._part.end[2] > self._surface - _DEEP else 0.0
        return self._part.through_air(way), tilt

    def _lower(self) -> tuple[Vec3, float]:
        """Go upright to where the opening is believed, and down on it."""
        c = self.config
        self._was_above |= bool(self._part.end[2] > 0.5 * c.over)
        if not self._was_above:  # it fell in, or beside the fixture: up first
            if self._is_still(_STUCK_STEPS):
                self._begin(self._go_out)
            return self._shaken() + self._part.through_air(_PULL * _UP), 0.0
        if self._is_lowered_in:
            return self._push_from_here()
        is_low = self._part.end[2] < c.over and self._is_still(_TOUCH_STEPS)
        if is_low or self._is_still(_STUCK_STEPS):
            if self._winds:
                self._surface = self._level = float(self._part.end[2])
                self._step_at = np.zeros(3)
            self._begin(self._wind if self._winds else self._settle)
        way = -self._part.end
        if float(np.abs(self._part.end[:2]).max()) > _UPRIGHT:
            way[2] = self._above - self._part.end[2]
        elif self._part.end[2] < 2.0 * c.over:
            way[2] = -c.touch_speed * RESPONSE
        return self._part.through_air(way), 0.0

    def _settle(self) -> tuple[Vec3, float]:
        """Press the upright part, and go round and round where it stands."""
        c = self.config
        if self._is_lowered_in:
            return self._push_from_here()
        if self._steps > _ROUNDS * self._around:
            self._search()
        phase = 2.0 * math.pi * self._steps / self._around
        push = c.stir * np.array([math.cos(phase), math.sin(phase), 0.0])
        push -= _HOLD * self._part.end * _LEVEL
        return push - c.slide_press * _UP, 0.0

    @property
    def _is_lowered_in(self) -> bool:
        """True if the end of the upright part is in the opening."""
        return bool(self._part.end[2] <= -_DEEP)

    def _push_from_here(self) -> tuple[Vec3, float]:
        """Push in the upright part, which fell in here."""
        self._fell_at = self._part.corner * _LEVEL
        self._begin(self._push)
        return self._push()

    def _go_out(self) -> tuple[Vec3, float]:
        """Go level away from the fixture, for a time."""
        if self._steps > _OUT_STEPS:
            self._winds = False
            self._begin(self._go_over)
        away = self._part.end * _LEVEL
        speed = self._slide_speed / max(float(np.linalg.norm(away)), 1e-9)
        return self._part.towards(speed * away), 0.0

    def _touch(self) -> tuple[Vec3, float]:
        """Go down until something is in the way."""
        c, is_still = self.config, self._is_still(_TOUCH_STEPS)
        if self._note_fall(is_still and self._opening.is_post):
            self._begin(self._seat)
        elif is_still:
            self._surface = float(self._part.corner[2])
            self._is_touched = True
            self._begin(self._slide)
        way: Vec3 = np.zeros(3)
        if self._opening.has_steps:  # what ends near its opening is missed by a drift
            way = (self._path[0] - self._part.corner) * _LEVEL / RESPONSE
            way *= min(1.0, c.touch_speed / max(float(np.linalg.norm(way)), 1e-9))
        return self._part.towards(way - c.touch_speed * _UP), c.tilt

    def _slide(self) -> tuple[Vec3, float]:
        """Slide over the surface, along the path, until the corner falls in."""
        c, tilt = self.config, self.config.tilt
        press = -c.slide_press * _UP
        is_stuck = self._is_still(_STUCK_STEPS)
        if self._note_fall(is_stuck):
            self._begin(self._seat)
            return press, tilt
        here = self._part.corner[:2]
        while self._path and math.dist(self._path[0][:2], here) < self._pitch:
            self._path.pop(0)
        if is_stuck and self._path:
            self._path.pop(0)
            self._track.clear()
        if not self._path:
            self._search()
            return -press, tilt
        way = (self._path[0] - self._part.corner) * _LEVEL
        velocity = self._slide_speed * way / np.linalg.norm(way)
        return self._slid(velocity) + press, tilt

    def _slid(self, velocity: Vec3) -> Vec3:
        """Return the f* that slides the part at a level velocity [m/s].

        What it lacks of that is friction, and is added up.
        """
        c, part = self.config, self._part
        lacking = velocity - part.velocity * _LEVEL
        more = self._friction + c.slide_rate * POLICY_PERIOD * lacking
        size = float(np.linalg.norm(more))
        self._friction = more * min(1.0, c.friction / max(size, 1e-9))
        return part.towards(velocity) + c.slide_gain * lacking + self._friction

    def _seat(self) -> tuple[Vec3, float]:
        """Push the corner into the opening's corner: then the end lies in the mouth."""
        c = self.config
        towards = self._led.to_walls
        way = (self._part.end - self._track[0]) * _LEVEL
        size = float(np.linalg.norm(way))
        if size > _SLID and way @ towards > 0.0:
            # Along the wall that it slides on already: what presses on it is friction.
            towards = towards + way / size
            towards /= np.linalg.norm(towards)
        if self._part.end[2] < -self._beside:
            self._search()
        elif self._steps > _TOUCH_STEPS and self._is_corner_out:
            self._cross()
        elif self._is_seated() or self._steps > _SEAT_STEPS:
            self._begin(self._straighten)
        lacking = self._slide_speed - float(self._part.velocity @ self._led.to_walls)
        growth = self._growth + c.seat_rate * POLICY_PERIOD * lacking
        self._growth = min(growth, c.friction)
        return self._pushed(c.seat_push + self._growth, towards), c.tilt

    @property
    def _is_corner_out(self) -> bool:
        """True if a corner that was in the opening has come out."""
        return bool(self._part.corner[2] > self._surface - _LOST)

    def _is_seated(self) -> bool:
        """Say whether the end lies in the mouth, or its bore's corner at the post."""
        if self._opening.is_post or self._opening.is_pin:
            return self._is_still(_STILL_STEPS)
        return bool(self._part.end[2] - self._surface < 0.3 * _DEEP)

    def _cross(self) -> None:
        """Begin again, led beside the way on which the corner came through the opening.

        It went along a chord, on whose perpendicular through the middle lies the
        opening's middle, to the one side or the other.
        """
        middle = 0.5 * (self._fell_at + self._part.corner) * _LEVEL
        beside = 0.25 * self._opening.wide * self._led.tilt_axis
        self._search()
        if self._opening.is_notched:
            return
        self._path[:0] = [middle + beside, middle - beside]

    def _straighten(self) -> tuple[Vec3, float]:
        """Turn the part upright, or nearly so, its corner pushed into the opening's."""
        c = self.config
        share = self._steps * POLICY_PERIOD / c.straighten_time
        if share >= 1.0:
            self._begin(self._push)
        tilt = c.tilt + min(1.0, share) * (self._leaning - c.tilt)
        return self._pushed(c.hold_push, self._led.to_walls), tilt

    def _push(self) -> tuple[Vec3, float]:
        """Push the part in; where that does not help, go back to where it fell in."""
        opening, end = self._opening, self._part.end
        leaning = 0.0 if self._winds else self._leaning
        is_out = end[2] > self._surface - _DEEP - leaning * self._led.lever
        is_lost = leaning > 0.0 and self._is_corner_out
        wait = self._around if is_out else _PUSH_STEPS
        is_stuck = self._is_still(_STILL_STEPS) and self._steps > wait
        is_beside = opening.has_steps and math.hypot(*end[:2]) > self._room
        if end[2] < -opening.depth - _BESIDE or (is_beside and not is_out):
            self._search()
        elif is_stuck and self._is_at_step():
            return self._wind_here()
        elif is_stuck and not is_out and self._askew > 0.0:
            if self._is_touched or end[2] <= self._surface - self._unsure:
                self._level, self._upright = float(end[2]), self._part.yaw * _UP
                self._begin(self._rock)
                return self._rock()
            self._search_lower()
        elif is_lost or is_stuck:
            self._go_back()
        elif is_out:
            return self._stirred(), leaning
        else:
            self._turn = self._part.yaw  # as the opening's walls turn it
        back: Vec3 = np.zeros(3)
        if opening.has_steps and not is_out:
            # Below a step the place may be wide, and lead the part nowhere.
            if self._fell_in is None:
                self._fell_in = end
            back = _HOLD * (self._fell_in - end) * _LEVEL
        return back + self._shaken() - self.config.press * _UP, 0.0

    def _wind_here(self) -> tuple[Vec3, float]:
        """Begin a spiral at a step inside the opening.

        It is in turn about where the opening is believed, and about where the part is.
        """
        self._level = float(self._part.end[2])
        is_here = self._steps_met % 2 == 1
        self._step_at = self._part.end * _LEVEL if is_here else np.zeros(3)
        self._steps_met += 1
        self._begin(self._wind)
        return self._wind()

    def _go_back(self) -> None:
        """Begin again where the corner fell in."""
        self._search()
        if not self._opening.is_notched:
            self._path.insert(0, self._fell_at)

    def _rock(self) -> tuple[Vec3, float]:
        """Tilt on a spiral what is stuck, as it may be held askew, until it goes on."""
        if self._part.end[2] < self._level - _FALLEN:
            self._level = float(self._part.end[2])
            self._steps = 0
            self._upright = self._part.turned
        radius, out = _spiral(self._steps * POLICY_PERIOD * _ROCK, _ROCK_TURNS)
        if radius >= self._askew:
            self._go_back()
            return self.config.press * _UP, 0.0
        self._given = self._upright + radius * out
        return self._shaken() - self.config.press * _UP, 0.0

    def _is_at_step(self) -> bool:
        """Say whether what holds the part may be a step inside the opening."""
        x, y, z = self._part.end.tolist()
        last = min(self._level, self._surface)
        is_lower = -self._opening.depth - _STEP < z < last - _STEP
        return self._opening.has_steps and is_lower and math.hypot(x, y) < _ROOM

    def _wind(self) -> tuple[Vec3, float]:
        """Slide upright on a spiral, at a step inside, until the part falls on."""
        c = self.config
        if self._part.end[2] < self._level - _FALLEN:
            self._fell_at = self._part.corner * _LEVEL
            self._begin(self._push)
            return -c.press * _UP, 0.0
        sway = 2.0 * math.pi * _SWAYS * self._steps * POLICY_PERIOD
        self._turn = _SWAY * math.sin(sway)
        radius, out = _spiral(self._steps * POLICY_PERIOD * _WIND, self._turns)
        if radius > _WIDEST:
            self._search()
            return c.press * _UP, 0.0
        target = self._step_at + radius * out
        along = np.cross(_UP, out)
        velocity = _WIND * along + _FOLLOW * (target - self._part.end) * _LEVEL
        is_caught = self._is_still(_TOUCH_STEPS)  # by an edge: up, over it
        press = c.press if is_caught else -c.slide_press
        return self._slid(velocity) + press * _UP, 0.0

    def _stirred(self) -> Vec3:
        """Return a push into the opening's corner that tries all places and turns.

        What leans in that corner is turned about it, from side to side; what stands
        upright on the rim goes round and round.
        """
        c = self.config
        phase = 2.0 * math.pi * self._steps / self._around
        if self._leaning > 0.0 and not self._winds:
            self._turn = c.turn * math.sin(phase)
            return c.lean * self._led.to_walls - c.press * _UP
        around = c.stir * (1.0 + math.cos(phase))
        return (
            around * self._led.to_walls
            + c.stir * math.sin(phase) * self._led.tilt_axis
            - c.press * _UP
        )

    def _pushed(self, push: float, towards: Vec3) -> Vec3:
        """Return a push in a level direction, and down what it would lift."""
        c = self.config
        press = c.seat_press + c.lift * push
        return push * towards + self._shaken() - press * _UP

    def _shaken(self) -> Vec3:
        phase = 2.0 * math.pi * _SHAKES * self._steps * POLICY_PERIOD
        return self.config.shake * math.sin(phase) * self._led.tilt_axis


def _outline_of(env: ContactEnv) -> Outline:
    """Return the opening of an environment's task, or refuse the environment."""
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
    return outline


def _spiral(length: float, turns: float) -> tuple[float, Vec3]:
    """Return the radius and the direction that a spiral has reached, level.

    Args:
        length: Way along it [m, rad].
        turns: Distance between two turns of it [m, rad].
    """
    radius = math.sqrt(length * turns / math.pi)
    angle = 2.0 * math.pi * radius / turns
    return radius, np.array([math.cos(angle), math.sin(angle), 0.0])
