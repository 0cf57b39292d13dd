"""A servo loop refuses settings that are no number, whichever they are."""

import numpy as np
import pytest

from dovetail import _core
from dovetail.control.config import LimitConfig, OscConfig

PERIOD = 5e-3


def build(robot, loop, servo):
    limits = LimitConfig.for_period(robot, PERIOD).params()
    osc = OscConfig.for_period(PERIOD).params()
    return _core.ServoLoop(loop, servo, robot.chain(), osc, limits, [1] * 6)


def fresh():
    loop, servo = _core.LoopParams(), _core.ServoParams()
    loop.address, loop.port = "127.0.0.1", 0
    return {"loop": loop, "servo": servo, "watchdog": servo.watchdog}


@pytest.mark.parametrize("kind", ["loop", "servo", "watchdog"])
def test_every_number_of_a_servo_loop_is_refused_by_name(robot, kind):
    struct = fresh()[kind]
    names = [n for n in dir(struct) if isinstance(getattr(struct, n), float)]
    assert names
    for name in names:
        words = name.replace("_", "[_ ]")
        for number in (np.nan, -np.inf):
            structs = fresh()
            setattr(structs[kind], name, number)
            structs["servo"].watchdog = structs.pop("watchdog")
            with pytest.raises(ValueError, match=rf"{words} is {number:g}"):
                build(robot, **structs)


def test_the_pose_to_hold_is_refused_by_element(robot):
    structs = fresh()
    structs.pop("watchdog")
    servo = build(robot, **structs)
    with pytest.raises(ValueError, match=r"position_hold\[2\] is nan m"):
        servo.hold_at(np.array([0.6, 0.0, np.nan]), np.eye(4)[1])
    with pytest.raises(ValueError, match=r"quat_hold \(length\) is 0"):
        servo.hold_at(np.array([0.6, 0.0, 0.2]), np.zeros(4))
    servo.close()
