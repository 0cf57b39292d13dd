"""A DIN rail, and a component that hooks over one lip and snaps behind the other.

EN 60715, TH 35-7.5: 35 mm wide, 7.5 mm deep, of 1 mm sheet, here with straight corners.
The rail's frame is in the middle of its front: z out of it, x along it, the lips at the
ends of y. The component's frame is the TCP: on the rail it lies in the rail's front, z
into the rail, the hook at negative y and the latch at positive y.

A latch is a slide with a preloaded spring and a nose with two faces, at 30 degrees to
the way in and at 60 to the way out: the two sides of one box. A lip that pushes it by
a friction angle phi needs the force F tan(angle + phi), F being that of the spring.
"""

import math

import numpy as np

from dovetail.types import Vec3
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, Part, Primitive

WIDTH, RAIL_DEPTH, SHEET, LIP = 0.035, 0.0075, 0.001, 0.0045
"""Cross-section of the rail [m]: over its lips, deep, thick, and each lip's width."""
LENGTH = 0.100
"""Length of the rail [m]."""
SLOPE_IN, SLOPE_OUT = math.radians(30.0), math.radians(60.0)
"""Angles of the nose's faces to the way of the component [rad]."""
OVERLAP = 0.0015
"""Length of the nose behind the lip [m]."""
TIP = SHEET + 0.0001 + OVERLAP / math.tan(SLOPE_OUT)
"""Height of the nose's tip over the component's face [m]: 0.1 mm of play."""
STIFFNESS, PRELOAD = 2000.0, 0.0025
"""Spring of the latch [N/m], and its compression at rest [m]: 5 N, 8 N when pushed."""
OUTER = WIDTH / 2.0 + 0.0003
"""Inner side of the hook's arm from the component's middle [m]: 0.3 mm of play."""
HOLD = 0.0018
"""Depth of the hook's inner side under the component's face [m]: 0.8 mm of play."""
HOOK = 0.0025
"""Length of the hook behind the lip [m]."""
_NOSE = 0.005, 0.004
_GREY, _GREEN = (0.72, 0.73, 0.75, 1.0), (0.35, 0.60, 0.30, 1.0)
_X, _Y, _Z = np.eye(3)


def _box(name: str, low: Vec3, high: Vec3, mass: float = 0.0) -> Primitive:
    half = tuple(float(v) for v in (np.array(high) - low) / 2.0)
    middle = (np.array(high) + low) / 2.0
    rgba = _GREEN if mass else _GREY
    return Primitive(name, "box", half, middle, rgba=rgba, mass=mass)


def rail() -> Part:
    """Return the rail."""
    x, half, inner = LENGTH / 2.0, WIDTH / 2.0, WIDTH / 2.0 - LIP
    back = -RAIL_DEPTH
    shapes = [
        _box(
            "base",
            np.array([-x, -inner, back]),
            np.array([x, inner, back + SHEET]),
        )
    ]
    for name, side in (("upper", -1.0), ("lower", 1.0)):
        for what, begin, end, low, high in (
            ("lip", inner, half, -SHEET, 0.0),
            ("wall", inner - SHEET, inner, back + SHEET, 0.0),
        ):
            y = sorted((side * begin, side * end))
            shapes.append(
                _box(
                    f"{name}_{what}",
                    np.array([-x, y[0], low]),
                    np.array([x, y[1], high]),
                )
            )
    return Part("DIN rail", tuple(shapes))


def latch(name: str = "latch", side: float = 1.0) -> Moving:
    """Return a latch in the component's frame.

    Args:
        name: Of its joint and shapes.
        side: 1 for the end of y, -1 for its begin.
    """
    joint = Joint(
        name=name,
        kind="slide",
        axis=side * _Y,
        range=(0.0, 0.004),
        stiffness=STIFFNESS,
        rest=-PRELOAD,
        damping=3.0,
        armature=0.005,
    )
    into, out = _NOSE
    along = np.array([0.0, side * math.sin(SLOPE_IN), math.cos(SLOPE_IN)])
    aside = np.array([0.0, side * math.cos(SLOPE_IN), -math.sin(SLOPE_IN)])
    tip = np.array([0.0, side * (WIDTH / 2.0 - OVERLAP), TIP])
    half = -side * SLOPE_IN / 2.0
    nose = Primitive(
        f"{name}_nose",
        "box",
        (0.005, out / 2.0, into / 2.0),
        tip + into / 2.0 * along + out / 2.0 * aside,
        np.array([math.cos(half), math.sin(half), 0.0, 0.0]),
        (0.90, 0.55, 0.15, 1.0),
        0.004,
    )
    y = sorted((side * 0.0188, side * 0.0235))
    slider = _box(
        f"{name}_slider",
        np.array([-0.005, y[0], -0.010]),
        np.array([0.005, y[1], TIP]),
        0.006,
    )
    return Moving(joint, (nose, slider))


def component() -> Part:
    """Return the component: a body with a hook and a latch."""
    shapes = (
        _box(
            "body",
            np.array([-0.009, -0.020, -0.040]),
            np.array([0.009, 0.018, 0.0]),
            0.06,
        ),
        _box(
            "grip",
            np.array([-0.015, -0.01, -0.075]),
            np.array([0.015, 0.01, -0.04]),
            0.02,
        ),
        _box(
            "hook_arm",
            np.array([-0.009, -OUTER - 0.003, -0.010]),
            np.array([0.009, -OUTER, HOLD + 0.002]),
            0.004,
        ),
        _box(
            "hook",
            np.array([-0.009, -OUTER, HOLD]),
            np.array([0.009, -OUTER + HOOK, HOLD + 0.002]),
            0.002,
        ),
    )
    return Part("component", shapes, (latch(),))
