"""Bodies that tests insert: areas of shapely from one height to another, united."""

import numpy as np

from dovetail.meshes.read import Mesh
from extras import need

MM = 1e-3


def circle(radius, x=0.0, y=0.0, sides=64):
    """Return a regular polygon inside a circle [mm]."""
    shapely = need("shapely")
    turn = 2.0 * np.pi * np.arange(sides) / sides
    line = np.stack([x + radius * np.cos(turn), y + radius * np.sin(turn)], axis=1)
    return shapely.Polygon(line)


def square(side, x=0.0, y=0.0):
    """Return an upright square [mm]."""
    half = side / 2.0
    return need("shapely").box(x - half, y - half, x + half, y + half)


def prism(area, low, high):
    """Return an area from one height to another [mm]."""
    creation = need("trimesh").creation
    body = creation.extrude_polygon(area, high - low)
    body.apply_translation([0.0, 0.0, low])
    return body


def cone(low_radius, high_radius, low, high, sides=64):
    """Return a body between two circles, its corners over one another [mm]."""
    trimesh = need("trimesh")
    turn = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [
        np.insert(radius * ring, 2, z, axis=1)
        for radius, z in ((low_radius, low), (high_radius, high))
    ]
    return trimesh.convex.convex_hull(np.vstack(rings))


def bead(radius, out, z, sides=64):
    """Return a ring around z that stands out by as much as it is wide [mm]."""
    creation = need("trimesh").creation
    line = [
        (radius - 0.5, z - out - 0.5),
        (radius + out, z),
        (radius - 0.5, z + out + 0.5),
    ]
    return creation.revolve([*line, line[0]], sections=sides)


def united(*bodies):
    """Return the union of bodies."""
    need("manifold3d")
    return need("trimesh").boolean.union(bodies, engine="manifold")


def cut(body, *others):
    """Return a body without others."""
    need("manifold3d")
    return need("trimesh").boolean.difference([body, *others], engine="manifold")


def mesh(body, name="plug"):
    """Return a body of trimesh [mm] as a mesh that was read."""
    vertices = MM * np.array(body.vertices)
    return Mesh(name, vertices, np.array(body.faces), "mm", "given", True)
