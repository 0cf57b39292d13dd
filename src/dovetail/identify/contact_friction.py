r"""Sliding friction coefficient from slides under several forces.

Along a way the arm's own friction acts as well. Joint friction turns with the motion as
the contact's does, but it is the same under every force. What gravity compensation
misses does not turn. So half the difference between the two directions is

.. math:: T = T_{joints} + \mu N

and the mean of both is N plus a constant. The slope of T over N is the coefficient.
Both forces are the estimated wrench: its errors of scale cancel in the slope.
"""

from collections.abc import Sequence

import numpy as np

from dovetail.identify.contact_estimate import ContactEstimate
from dovetail.identify.contact_log import StripLog
from dovetail.identify.contact_motion import SPEED, Slide
from dovetail.identify.student import student_t
from dovetail.plants.plant import COLUMN
from dovetail.types import Array, Vec3

MOVING = 0.5
"""Least speed of a part that slides, as a share of the way's [1]."""
_SETTLE, _OVER_TIME, _LEAST = 0.3, 0.1, 0.4
"""Time after a turn that is left out, time over which a speed is taken, and least time
of sliding [s]."""
LEVELS_MIN = 4
"""Least number of forces under which the part slid on both strips."""
_NAME = "contact_friction"


def contact_friction(strips: Sequence[StripLog]) -> ContactEstimate:
    """Estimate the sliding friction coefficient from slides on each strip."""
    presses = sorted({slide.press for strip in strips for slide in strip.slides})
    points = np.full((len(strips), len(presses), 2), np.nan)
    for i, strip in enumerate(strips):
        forces = {
            (slide.press, slide.sign): sliding_force(slide, strip.along, strip.normal)
            for slide in strip.slides
        }
        for j, press in enumerate(presses):
            there, back = forces.get((press, 1)), forces.get((press, -1))
            if there is not None and back is not None:
                turned, kept = 0.5 * (back - there), 0.5 * (back + there)
                points[i, j] = turned[0], kept[1]
    return friction_of(points)


def sliding_force(slide: Slide, along: Vec3, normal: Vec3) -> Array | None:
    """Return the mean force on the sliding part, along its way and normal to it [N].

    Args:
        slide: The way.
        along: Unit vector along its strip.
        normal: Unit vector out of the surface.

    Returns:
        Shape (2,); None where it stuck on most of the way.
    """
    time = slide.log[:, COLUMN["time"]]
    way = slide.log[:, COLUMN["x"] : COLUMN["z"] + 1] @ along
    period = float(np.median(np.diff(time)))
    span = max(1, round(0.5 * _OVER_TIME / period))
    speed = np.zeros(len(way))
    speed[span:-span] = (way[2 * span :] - way[: -2 * span]) / (2.0 * span * period)
    slides = slide.sign * speed > MOVING * SPEED
    slides[: round(_SETTLE / period)] = False
    if slides.sum() * period < _LEAST:
        return None
    first = COLUMN["wrench_fx"]
    force = slide.log[slides, first : first + 3].mean(axis=0)
    return np.array([force @ along, force @ normal])


def friction_of(points: Array) -> ContactEstimate:
    """Estimate the slope of T over N.

    What is left of a fit is not noise: joints that stand take a part of a force, which
    changes slowly with it. So each force is one fact, of all strips together: the
    interval is the jackknife over the forces, with Student's t, and holds the
    difference between the strips, too.

    Args:
        points: T and N [N], shape (strips, forces, 2); not-a-number where it stuck.
    """
    usable = np.asarray(np.isfinite(points).all(axis=(0, 2)))
    points = points[:, usable]
    strips, count = points.shape[:2]
    if count < LEVELS_MIN:
        return ContactEstimate(
            *(_NAME, "1", None, None),
            f"{usable.size - count} of {usable.size} forces have no sliding force: the "
            f"part stuck, or no wrench was measured; {LEVELS_MIN} with one are needed",
        )
    slopes = _slopes(points)
    value = float(slopes.mean())
    left_out = [_slopes(np.delete(points, i, axis=1)).mean() for i in range(count)]
    variance = (count - 1) / count * float(np.sum((np.array(left_out) - value) ** 2))
    if strips > 1:
        variance += float(slopes.var(ddof=1)) / strips
    half_width = student_t(count - 1) * float(np.sqrt(variance))
    return ContactEstimate(_NAME, "1", value, half_width).judged()


def _slopes(points: Array) -> Array:
    """Return the slope of T over N on each strip [1]."""
    tangential, normal = np.moveaxis(points - points.mean(axis=1, keepdims=True), 2, 0)
    return (tangential * normal).sum(axis=1) / (normal**2).sum(axis=1)
