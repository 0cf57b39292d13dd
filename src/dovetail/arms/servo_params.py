"""Default parameters of a servo loop."""

from typing import TYPE_CHECKING

from dovetail.control.observer import observer_gain

if TYPE_CHECKING:
    from dovetail import _core


def servo_params(period: float) -> "_core.ServoParams":
    """Return the default parameters of a servo loop.

    Args:
        period: Control period [s].
    """
    from dovetail import _core

    servo = _core.ServoParams()
    servo.observer_gain = observer_gain(period)
    return servo
