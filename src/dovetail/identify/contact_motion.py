"""Slides of a held part on a plain surface, through the controller.

The part first goes its way in free air, then touches the surface and slides there and
back under several forces. The weight that gravity compensation misses is measured
before, and held.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dovetail import _core
from dovetail.arms.arm import Arm, ArmState
from dovetail.control.period import POLICY_PERIOD
from dovetail.control.task_spec import HOLD, POSE
from dovetail.envs.tare import measure_tare
from dovetail.errors import ArmError
from dovetail.identify.plain_strip import Strip
from dovetail.types import Array, Vec3, Vec6

PRESSES = (0.6, 1.2, 1.8, 2.4, 3.0)
"""f* into the surface, one after the other [m/s2]: up to about 35 N."""
SPEED = 0.015
"""Speed of the part on its way [m/s], below the limit near contact."""
START = 0.025
"""Height of the part's end at the start [m]."""
_OVER = 0.008
"""Height of the way in free air [m]."""
_TOUCH = 3.0
"""f* of a touch [m/s2]: the limit near contact sets the speed."""
_REST_STEPS = 6
_STILL_STEPS, _STILL = 4, 0.0002
"""Policy steps in which the part moves by less than this [m] once it stands."""
_OFF = 0.005
"""Largest distance of the surface from where it should be [m]."""
_TOUCH_STEPS = 60
"""Policy steps in which it has to."""
_STIFFNESS = 600.0
"""Of the law that leads the tool [1/s2], as a tare's."""
_INTEGRAL = 600.0
"""Gain from the missing distance over time to f* [1/s3]: friction may hold it."""
_LED_MAX, _INTEGRAL_MAX = 14.0, 8.0
"""Most f* of both together, and of the latter [m/s2]."""


class Slide(NamedTuple):
    """A way along a strip, and its control cycles."""

    press: float
    """f* into the surface [m/s2]; 0 is in free air."""
    sign: int
    """Direction along the strip, 1 or -1."""
    log: Array
    """Control cycles, columns CYCLE_COLUMNS."""


def play_strip(begin: Callable[[], ArmState], arm: Arm, strip: Strip) -> list[Slide]:
    """Slide along a strip under all forces, there and back.

    Args:
        begin: Puts the arm over the strip's middle, `START` above it.
        arm: Its axes X Y Z are force axes.
        strip: Where.

    Raises:
        ArmError: The arm, or there is no surface.
    """
    hand = _Hand(begin, arm, strip)
    slides: list[Slide] = []
    hand.go_to(_OVER, -strip.half, 0.0)
    for press in (0.0, *PRESSES):
        if press == PRESSES[0]:
            hand.touch()
        hand.wait(press)
        for sign in (1, -1):
            log = hand.go_to(hand.level, sign * strip.half, press)
            slides.append(Slide(press, sign, log))
    hand.lift()
    return slides


class _Hand:
    """Leads the tool over a strip; heights and ways are from the strip's middle."""

    def __init__(self, begin: Callable[[], ArmState], arm: Arm, strip: Strip) -> None:
        """Begin, and measure the weight to hold."""
        self._arm, self._strip = arm, strip
        state = begin()
        normal = strip.normal
        plane = np.append(normal, float(normal @ strip.middle) + START)
        is_held = np.isin(arm.facts.task.modes, (POSE, HOLD))
        stiffness: Vec6 = np.where(is_held, arm.facts.osc.stiffness, 0.0)
        away = np.where(normal < 0.0, -1.0, 1.0)
        tare = measure_tare(arm, state, [0, 1, 2], stiffness, away, plane)
        self._state, self._held = tare.state, tare.f_star
        self._target = _core.Target(
            position_d=state.tool.position, quat_wxyz_d=strip.quat_wxyz
        )
        self._target.near_plane = plane
        self._reference: Vec3 = self._state.tool.position.copy()
        self._lacking: Vec3 = np.zeros(3)
        self.level = _OVER
        """Height of the way [m]: in free air, then of the surface as touched."""

    def follow(self, press: float) -> Array:
        """Do one policy step, led to the reference or pressed; return its cycles."""
        normal = self._strip.normal
        error = self._reference - self._state.tool.position
        if press:
            error = error - normal * (normal @ error)
        grown = self._lacking + _INTEGRAL * POLICY_PERIOD * error
        self._lacking = grown.clip(-_INTEGRAL_MAX, _INTEGRAL_MAX)
        led = (_STIFFNESS * error + self._lacking).clip(-_LED_MAX, _LED_MAX)
        f_star = self._held.copy()
        f_star[:3] += led - press * normal
        self._target.f_star = f_star
        self._state = self._arm.step(self._target, POLICY_PERIOD)
        return self._state.log

    def go_to(self, height: float, way: float, press: float) -> Array:
        """Lead the tool to a place at `SPEED`; return the cycles."""
        strip = self._strip
        goal = strip.middle + way * strip.along + height * strip.normal
        left = goal - self._reference
        count = max(1, int(np.ceil(np.linalg.norm(left) / (SPEED * POLICY_PERIOD))))
        logs = []
        for _ in range(count):
            self._reference = self._reference + left / count
            logs.append(self.follow(press))
        return np.vstack(logs)

    def wait(self, press: float) -> None:
        """Stay for a moment."""
        for _ in range(_REST_STEPS):
            self.follow(press)

    def lift(self) -> None:
        """Leave the surface."""
        self._reference = self._state.tool.position.copy()
        self._lacking = np.zeros(3)
        self.go_to(_OVER, 0.0, 0.0)

    def touch(self) -> None:
        """Go down until the part stands on the surface.

        Raises:
            ArmError: Nothing is there, or something else is in the way before.
        """
        normal, heights = self._strip.normal, [np.inf]
        for _ in range(_TOUCH_STEPS):
            self.follow(_TOUCH)
            offset = self._state.tool.position - self._strip.middle
            heights.append(float(normal @ offset))
            if heights[-1] < -_OFF:
                break
            late = heights[-1 - _STILL_STEPS :]
            is_still = len(late) > _STILL_STEPS and max(late) - min(late) < _STILL
            if is_still and heights[-1] < _OFF:
                self.level = heights[-1]
                self._reference = self._reference + normal * (
                    heights[-1] - normal @ (self._reference - self._strip.middle)
                )
                return
        self._arm.stop()
        raise ArmError(
            f"the held part met no surface within {1e3 * _OFF:g} mm of where it should "
            f"be, its end is {1e3 * heights[-1]:.1f} mm above that: say where the "
            "fixture is with --fixture, or leave --contact out",
            "no_surface",
        )
