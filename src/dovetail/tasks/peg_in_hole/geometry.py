"""Peg and hole block, from one set of numbers.

The hole's frame sits in the middle of the hole's mouth, z out of the hole. The peg is
inserted and aligned when ``R_world_tool = R_world_hole @ Rx(pi)``. The triangle has a
corner on its +x axis, so this turn maps it onto the hole.

Everything convex is a box or a cylinder (the triangle peg alone is a prism), because
convex meshes carry a margin in PyBullet.
"""

import math
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import model_validator

from dovetail.errors import ConfigError
from dovetail.settings import Range, settings
from dovetail.types import Array
from dovetail.workcell.parts import IDENTITY, Part, Primitive, turned_box

PegShape = Literal["square", "triangle", "round"]
PEG_SHAPES: tuple[PegShape, ...] = ("square", "triangle", "round")

_SIDES = {"square": 4, "triangle": 3, "round": 36}
"""Walls of the hole: its edges, or the flats that stand for a circle."""
_PEG_RGBA = (0.90, 0.55, 0.15, 1.0)


@settings()
class Peg:
    """Peg that the tool holds."""

    shape: PegShape = "square"
    """Its section, and the hole's."""
    width: Annotated[float, Range(0.005, 0.060, "m")] = 0.030
    """Side of the square or triangle, diameter of the round peg [m]."""
    length: Annotated[float, Range(0.040, 0.110, "m")] = 0.070
    """Length [m]; 20 mm of it are between the fingers."""
    density: Annotated[float, Range(100.0, 20000.0, "kg/m3")] = 2700.0
    """Density, aluminium [kg/m3]."""

    @model_validator(mode="after")
    def _check_peg(self) -> Self:
        """Refuse a peg that cannot be built."""
        if self.shape not in PEG_SHAPES:
            raise ConfigError(
                f"peg {self.shape!r} is unknown; known shapes: {', '.join(PEG_SHAPES)}"
            )
        return self

    @property
    def inner_radius(self) -> float:
        """Distance from the peg's axis to its flats [m]."""
        if self.shape == "triangle":
            return self.width / (2.0 * math.sqrt(3.0))
        return self.width / 2.0

    def part(self) -> Part:
        """Return the peg in the TCP's frame; its end face is the TCP."""
        half, side = self.length / 2.0, self.width / 2.0
        size, kind, area = {
            "square": ((side, side, half), "box", self.width**2),
            "round": ((side, half), "cylinder", math.pi * self.width**2 / 4.0),
            "triangle": (
                (2.0 * self.inner_radius, half),
                "prism",
                math.sqrt(3.0) / 4.0 * self.width**2,
            ),
        }[self.shape]
        mass = self.density * area * self.length
        centre = np.array([0.0, 0.0, -half])
        shape = Primitive("peg", kind, size, centre, IDENTITY, _PEG_RGBA, mass)
        return Part(f"{self.shape} peg", (shape,))


@settings()
class HoleBlock:
    """Block with the hole that the peg goes into."""

    depth: Annotated[float, Range(0.005, 0.060, "m")] = 0.030
    """Depth of the hole [m]."""
    success_depth: Annotated[float, Range(0.001, 0.060, "m")] = 0.028
    """Depth of the peg's end below the mouth that counts as inserted [m]."""
    chamfer: Annotated[float, Range(0.0, 0.030, "m")] = 0.0
    """Width and depth of a 45 degree chamfer around the mouth [m]; 0 is none."""
    width: Annotated[float, Range(0.080, 0.300, "m")] = 0.100
    """Outer side of the block [m]."""
    floor_thickness: Annotated[float, Range(0.0, 0.050, "m")] = 0.0
    """Material under the hole [m]; 0 is a through hole in a plate above the table."""

    @model_validator(mode="after")
    def _check_hole_block(self) -> Self:
        """Refuse a block that cannot be built."""
        for name, most in (("success_depth", 1.0), ("chamfer", 0.5)):
            if vars(self)[name] > most * self.depth:
                raise ConfigError(
                    f"{name} is {vars(self)[name]:g} m; allowed: at most "
                    f"{most * self.depth:g} m in a hole {self.depth:g} m deep"
                )
        return self

    def part(self, peg: Peg, clearance: float) -> Part:
        """Return the block in the hole's frame: a wall per edge, a floor if any.

        The hole is the intersection of half planes, so each wall may reach past the
        corners: a wall is material outside its own edge and nothing else.

        Args:
            peg: What it is made for.
            clearance: Gap on each side [m].
        """
        outer = self.width / 2.0
        shapes = []
        if self.floor_thickness > 0.0:
            size = (outer, outer, self.floor_thickness / 2.0)
            at = np.array([0.0, 0.0, -self.depth - self.floor_thickness / 2.0])
            shapes.append(Primitive("floor", "box", size, at))
        edge = peg.inner_radius + clearance
        for i in range(_SIDES[peg.shape]):
            shapes += self._wall(peg.shape, i, edge, outer)
        return Part("hole", tuple(shapes))

    def _wall(
        self, shape: PegShape, index: int, edge: float, outer: float
    ) -> list[Primitive]:
        """Return the boxes of one wall, whose face is `edge` from the axis."""
        count = _SIDES[shape]
        # Outward normals; the triangle's corner on +x lies between two of them.
        angle = 2.0 * math.pi * (index + 0.5 * (shape == "triangle")) / count
        along = outer if count <= 4 else 1.2 * outer * math.tan(math.pi / count)
        if shape == "square" and index % 2 == 1 and self.chamfer == 0.0:
            along = edge  # no overlap with the other two walls: fewer contacts
        depth, chamfer = self.depth, self.chamfer

        def box(name: str, near: float, far: float, top: float) -> Primitive:
            size = ((far - near) / 2.0, along, (depth + top) / 2.0)
            local = np.array([(near + far) / 2.0, 0.0, (top - depth) / 2.0])
            return turned_box(f"{name}_{index}", size, local, angle, IDENTITY)

        if chamfer == 0.0:
            return [box("wall", edge, outer, 0.0)]
        # The triangle between lowered and full wall: a box whose face is the slope.
        thickness = chamfer / math.sqrt(2.0)
        middle = np.array([edge + chamfer / 2.0, 0.0, -chamfer / 2.0])
        normal = np.array([-1.0, 0.0, 1.0]) / math.sqrt(2.0)
        tilt = np.array([math.cos(math.pi / 8), 0.0, -math.sin(math.pi / 8), 0.0])
        slope = (thickness, along, thickness / 2.0)
        local = middle - normal * thickness / 2.0
        return [
            box("wall", edge + chamfer, outer, 0.0),
            box("lip", edge, edge + chamfer, -chamfer),
            turned_box(f"chamfer_{index}", slope, local, angle, tilt),
        ]


def hole_outline(peg: Peg, clearance: float) -> Array:
    """Return the hole's outline in its own frame [m], closed, shape (points, 2)."""
    edge = peg.inner_radius + clearance
    if peg.shape == "square":
        return edge * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1.0]])
    radius, corners = (2.0 * edge, 3) if peg.shape == "triangle" else (edge, 72)
    angle = np.arange(corners + 1) * 2.0 * np.pi / corners
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
