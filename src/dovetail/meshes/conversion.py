"""A converted pair of meshes: its slabs, and the facts known about it."""

from dataclasses import dataclass, field

from dovetail.meshes.exactness import Exactness
from dovetail.meshes.hold import Hold
from dovetail.meshes.read import Mesh
from dovetail.meshes.slabs import Slab
from dovetail.meshes.way import Gap
from dovetail.types import Array, Mat33, Vec3

DENSITY = 1200.0
"""Density of a plug, a printed plastic [kg/m3]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stalk:
    """Prism, or two, that the fingers hold above a plug: upright and coarse."""

    outlines: tuple[tuple[Array, tuple[Array, ...]], ...]
    """Closed lines of each of its areas: around it, and around its openings [m]."""
    low: float
    """Lower height, in the part's frame [m]."""
    high: float
    """Upper height [m]."""

    def slabs(self) -> list[Slab]:
        """Return it as slabs."""
        return [Slab(self.low, self.high, *lines) for lines in self.outlines]


@dataclass(frozen=True, kw_only=True, eq=False)
class Conversion:
    """A pair of meshes as slabs, with what is known about it.

    Everything but the meshes is in the part's frame: z out of the socket, the middle of
    its mouth at 0 0 0, the plug where it stands in the end.
    """

    name: str
    """Of the part."""
    plug: Mesh
    """As read, in its file's frame."""
    socket: Mesh
    """As read, in its file's frame."""
    axis: str
    """Way in, in the files' axes: -z, +z, -x, +x, -y or +y."""
    turn: Mat33
    """Rotation from the files' axes to the part's."""
    mouth: Vec3
    """Origin of the part's frame, in the files' axes after the turn [m]."""
    depth: float
    """Depth of the plug's end below the mouth [m]."""
    gap: Gap
    """Gap between the walls, in the part's frame."""
    is_through: bool
    """True if nothing of the socket is below the plug's end."""
    levels: Array
    """Heights of level faces of both near the way in, highest first [m]."""
    held: tuple[Slab, ...]
    """The plug, without a stalk, lowest first."""
    fixture: tuple[Slab, ...]
    """The socket, lowest first."""
    stalk: Stalk | None = None
    """Added to the held part."""
    hold: Hold | None = None
    """Ways to hold the plug, where it was not simply long enough."""
    density: float = DENSITY
    """Of the held part [kg/m3]."""
    tolerance: float = 0.0
    """Of the sections near the other part [m]."""
    exactness: Exactness | None = None
    """Pieces beside the meshes; None where they cannot be built."""
    pieces: tuple[int, int] = (0, 0)
    """Convex pieces of the held part and of the fixture."""
    mass: float = 0.0
    """Of the held part, with its stalk [kg]."""
    reasons: tuple[str, ...] = field(default=())
    """Reasons that make it no go; empty where it is go."""

    @property
    def is_go(self) -> bool:
        """True if the pair can be built, held and inserted."""
        return not self.reasons

    def held_slabs(self) -> list[Slab]:
        """Return the plug's slabs, and the stalk's."""
        return [*self.held, *(self.stalk.slabs() if self.stalk else ())]

    def in_part(self, mesh: Mesh) -> Mesh:
        """Return a mesh in the part's frame."""
        return mesh._replace(vertices=mesh.vertices @ self.turn.T - self.mouth)

    def in_files(self, point: Vec3) -> Vec3:
        """Return a place of the part's frame in the files' axes [m]."""
        return self.turn.T @ (point + self.mouth)
