"""Overlap of two parts: the two shapes that are deepest in one another."""

from typing import Any, NamedTuple

from dovetail.poses import Pose
from dovetail.workcell.parts import Part, Primitive


class Overlap(NamedTuple):
    """Two shapes that overlap."""

    one: str
    """Name of the first part's shape."""
    other: str
    """Name of the second part's."""
    depth: float
    """Depth of one in the other [m]."""


def deepest_overlap(one: Part, other: Part, place: Pose) -> Overlap | None:
    """Return where two parts overlap most, or None.

    Args:
        one: A part.
        other: Another.
        place: Pose of the other's frame in the first one's.
    """
    import mujoco

    spec = mujoco.MjSpec()
    moving = spec.worldbody.add_body()
    moving.add_freejoint()
    moving.mass, moving.inertia, moving.explicitinertial = 1.0, [1.0] * 3, True
    for shape in one.primitives:
        _add(spec, moving, shape, contype=1, conaffinity=0)
    for shape in other.primitives:
        _add(spec, spec.worldbody, shape.moved(*place), contype=0, conaffinity=1)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    if not data.ncon:
        return None
    contact = min(data.contact[: data.ncon], key=lambda contact: contact.dist)
    names = sorted(
        (model.geom(i) for i in contact.geom), key=lambda geom: geom.contype[0]
    )
    return Overlap(names[1].name, names[0].name, -float(contact.dist))


def _add(spec: Any, body: Any, shape: Primitive, **masks: int) -> None:
    """Add a shape to a body of a MuJoCo model."""
    import mujoco

    known = {
        "box": mujoco.mjtGeom.mjGEOM_BOX,
        "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    }
    facts = {"name": shape.name, "pos": shape.position, "quat": shape.quat_wxyz}
    if shape.kind in known:
        size = [*shape.size, 0.0][:3]
        body.add_geom(type=known[shape.kind], size=size, **facts, **masks)
        return
    spec.add_mesh(name=shape.name, uservert=shape.vertices().ravel())
    mesh = mujoco.mjtGeom.mjGEOM_MESH
    body.add_geom(type=mesh, meshname=shape.name, **facts, **masks)
