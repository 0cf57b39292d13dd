"""Joints of parts: shapes that turn, slide or screw, with spring, stops and detents.

The force of a joint is one formula for every engine, `Joint.law`. Engines step it
linearly implicitly: damping is `law.implicit_damping`, D = d + h k, and h D is added to
the inertia, h being the physics step [s]. That is the implicit Euler method: forces at
rest are exact, and no spring is unstable. It damps a vibration that the step does not
resolve, so `Joint.require_steppable` refuses a spring with less than `STEPS` steps in a
period of its vibration.

A screw is a hinge whose shapes also go along the axis, by its lead s = pitch / (2 pi)
for each radian. Its one position is the angle, and a force F along the axis is a torque
s F: its inertia is I + m s^2.

The engines let shapes of one part pass through each other: a stop is the end of a
joint's range, not a shape.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from dovetail.errors import ConfigError
from dovetail.poses import matrix_from_quat
from dovetail.types import Mat33, Vec3, Vec4

if TYPE_CHECKING:
    from dovetail import _core

STEPS = 2.0 * math.pi
"""Fewest physics steps in a period of a spring's vibration. With x = omega h a step
leaves (1 + x^2)^(-1/2) of a swing and turns by atan x: at this limit, x = 1, 0.11 of it
is left after a period's steps, which is 1.27 times as long; at x = 0.1, 0.73."""
_TURNING = "rad", "Nm", "kg m2"
_UNITS = {"hinge": _TURNING, "screw": _TURNING, "slide": ("m", "N", "kg")}
_TURNS = {"hinge": 1.0, "screw": 100.0}
"""Largest distance of a stop from 0 [turns]."""
_PITCH = 1e-5, 0.1
"""Least and largest pitch of a screw [m]; those of bolts are 0.2 to 6 mm."""


class Detent(NamedTuple):
    """A place into which a joint snaps: -force sin(pi (q - position) / half_width)."""

    position: float
    """Middle [rad, m], where it holds the joint."""
    force: float
    """Largest force [Nm, N], half way between the middle and its end."""
    half_width: float
    """Distance from the middle at which its force ends [rad, m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Joint:
    """A hinge, a slide or a screw of a part, in the part's frame."""

    name: str
    """Its name in messages, logs and observations."""
    kind: Literal["hinge", "slide", "screw"]
    """A hinge turns about an axis [rad], a slide moves along one [m], a screw does
    both [rad]."""
    axis: Vec3
    """Direction of the axis, of any length above 0."""
    range: tuple[float, float] | None = None
    """Lower and upper stop [rad, m]. It has no default: a joint ends somewhere."""
    origin: Vec3 = field(default_factory=lambda: np.zeros(3))
    """A point of the axis of a hinge or a screw [m]."""
    pitch: float = 0.0
    """Way of a screw along its axis in a turn [m]; below 0 it is left-handed."""
    start: float = 0.0
    """Position after a reset [rad, m]; the shapes are given at position 0."""
    stiffness: float = 0.0
    """Stiffness of a spring [Nm/rad, N/m]."""
    rest: float = 0.0
    """Position at which the spring has no force [rad, m]; outside of the range it is
    preloaded."""
    damping: float = 0.0
    """Viscous damping [Nms/rad, Ns/m]."""
    friction: float = 0.0
    """Dry friction [Nm, N]."""
    detents: tuple[Detent, ...] = ()
    """Places into which it snaps."""
    armature: float = 0.0
    """Inertia that moves with it and has no shape, e.g. of a gear [kg m2, kg]."""

    def __post_init__(self) -> None:
        """Refuse a joint that cannot be.

        Raises:
            ConfigError: Names the joint, the number and what is allowed.
        """
        if self.kind not in _UNITS:
            raise self._error("kind", self.kind, "", "hinge, slide or screw")
        if not self.name.isidentifier():
            allowed = "a word of letters, digits and _: it names a column of logs"
            raise self._error("name", self.name, "", allowed)
        set_ = object.__setattr__
        unit, force, inertia = _UNITS[self.kind]
        axis = np.array(self.axis, dtype=float)
        length = float(np.linalg.norm(axis)) if axis.shape == (3,) else 0.0
        if not 1e-9 < length < math.inf:
            raise self._error("axis", self.axis, "", "three numbers, not all 0")
        set_(self, "axis", axis / length)
        origin = np.array(self.origin, dtype=float)
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise self._error("origin", self.origin, "m", "three numbers")
        set_(self, "origin", origin)
        set_(self, "detents", tuple(Detent(*d) for d in self.detents))
        self._check_pitch()
        self._check_range(unit)
        for name, value, of in (
            ("stiffness", self.stiffness, f"{force}/{unit}"),
            ("damping", self.damping, f"{force} s/{unit}"),
            ("friction", self.friction, force),
            ("armature", self.armature, inertia),
        ):
            if not 0.0 <= value < math.inf:
                raise self._error(name, value, of, "0 or more")
        self._check_detents(unit, force)

    def _check_pitch(self) -> None:
        if self.kind != "screw":
            if self.pitch:
                allowed = f"none to a {self.kind}, or make it a screw"
                raise self._error("pitch", self.pitch, "m", allowed)
        elif not _PITCH[0] <= abs(self.pitch) <= _PITCH[1]:
            sizes = f"{_PITCH[0]:g} to {_PITCH[1]:g} m"
            allowed = f"its way in a turn, {sizes}, or below 0 if it is left-handed"
            raise self._error("pitch", self.pitch, "m", allowed)

    def _check_detents(self, unit: str, force: str) -> None:
        low, high = self.stops
        for detent in self.detents:
            if not (low <= detent.position <= high and detent.half_width > 0.0):
                allowed = f"position {low:g} to {high:g}, half_width above 0"
                raise self._error("detent", tuple(detent), unit, allowed)
            if not 0.0 <= detent.force < math.inf:
                raise self._error("force of a detent", detent.force, force, "0 or more")

    def _check_range(self, unit: str) -> None:
        if self.range is None:
            raise self._error(
                "range", None, "", f"range=(low, high) in {unit}: its two stops"
            )
        low, high = self.range
        largest = 2.0 * math.pi * _TURNS[self.kind] if unit == "rad" else 1.0
        if not -largest <= low < high <= largest:
            allowed = f"low below high, both within {largest:.4g} of 0"
            raise self._error("range", self.range, unit, allowed)
        object.__setattr__(self, "range", (float(low), float(high)))
        if not low <= self.start <= high:
            raise self._error("start", self.start, unit, f"{low:g} to {high:g}")
        if not math.isfinite(self.rest):
            raise self._error("rest", self.rest, unit, "a number")

    def _error(self, name: str, value: object, unit: str, allowed: str) -> ConfigError:
        shown = " ".join(str(part) for part in (value, unit) if part != "")
        return ConfigError(
            f"joint {self.name!r}: {name} is {shown}; give {allowed}",
            name=name,
            value=value,
            unit=unit,
            allowed=(allowed,),
        )

    @property
    def unit(self) -> str:
        """Unit of its position: rad or m."""
        return _UNITS[self.kind][0]

    @property
    def column(self) -> str:
        """Name of its column in logs: kind, which tells the unit, and name."""
        return f"{self.kind}_{self.name}"

    @property
    def stops(self) -> tuple[float, float]:
        """Lower and upper stop [rad, m]."""
        assert self.range is not None
        return self.range

    @property
    def lead(self) -> float:
        """Way along the axis for each radian [m/rad]; 0 but for a screw."""
        return self.pitch / (2.0 * math.pi)

    @cached_property
    def law(self) -> "_core.PartJoint":
        """Force and stiffness of spring and detents, as every engine computes them."""
        from dovetail import _core

        return _core.PartJoint(
            stiffness=self.stiffness,
            rest=self.rest,
            damping=self.damping,
            armature=self.armature,
            detents=list(self.detents),
        )

    def stiffest(self) -> float:
        """Return the largest stiffness over all positions [Nm/rad, N/m]."""
        steepest = (most * math.pi / half for _, most, half in self.detents)
        return self.stiffness + max(steepest, default=0.0)

    def turn(self, q: float) -> tuple[Vec3, Mat33]:
        """Return the move of its shapes at a position, in the part's frame.

        Returns:
            p [m] and R, a point x of position 0 being at p + R x.
        """
        if self.kind == "slide":
            return q * self.axis, np.eye(3)
        half = 0.5 * q
        R = matrix_from_quat(np.array([math.cos(half), *(math.sin(half) * self.axis)]))
        return self.origin - R @ self.origin + q * self.lead * self.axis, R

    def moved(self, position: Vec3, quat_wxyz: Vec4) -> "Joint":
        """Return it in a frame in which its part's frame lies at this pose."""
        R = matrix_from_quat(quat_wxyz).round(12)  # quarter turns are exact
        return replace(self, axis=R @ self.axis, origin=position + R @ self.origin)

    def require_steppable(self, inertia: float, h: float) -> None:
        """Refuse a spring that is too stiff for a physics step.

        Args:
            inertia: At the joint [kg m2, kg].
            h: Physics step [s].

        Raises:
            ConfigError: Names stiffness, inertia, step and the largest stiffness.
        """
        stiffness = self.stiffest()
        unit, force, of = _UNITS[self.kind]
        largest = inertia * (2.0 * math.pi / (STEPS * h)) ** 2
        if stiffness <= largest:
            return
        longest = h * math.sqrt(largest / stiffness)
        raise ConfigError(
            f"joint {self.name!r}: stiffness is {stiffness:.4g} {force}/{unit} "
            f"(detents included) at an inertia of {inertia:.4g} {of}; a physics step "
            f"of {1e3 * h:.4g} ms allows up to {largest:.4g} {force}/{unit}: make it "
            f"softer, give an armature, or set physics_dt to {longest:.2g} s or less",
            name="stiffness",
            value=stiffness,
            unit=f"{force}/{unit}",
            allowed=(0.0, largest),
        )
