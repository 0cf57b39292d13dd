"""Masses of a robot file's bodies: possible ones, and meshes for those from shapes."""

from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.errors import ConfigError
from dovetail.robots.meshes import is_near, read_mesh
from dovetail.robots.robot_file import RobotFile

if TYPE_CHECKING:
    import mujoco

_VERTICES = 20_000
"""Most corners of meshes that give a mass: MuJoCo wraps them in a hull."""
_ROUNDING = 1e-9
"""Share of the largest moment by which a moment may be wrong."""
_NEGLIGIBLE = 1e-6  # kg m2, of a body that is fixed to a link


def require_masses(spec: "mujoco.MjSpec", file: RobotFile) -> None:
    """Refuse inertias that no body has, and prune the shapes that give no mass."""
    import mujoco

    _require_own_masses(spec, file)
    from_shapes = spec.compiler.inertiafromgeom == 1
    for body in spec.bodies[1:]:
        if not _moves(body):
            _make_light(body, spec)
        elif body.explicitinertial and not from_shapes:
            _require_body(body, spec, file)
            for geom in list(body.geoms):
                spec.delete(geom)
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    for joint in spec.joints:
        _require_mass(joint, file)
    used = set()
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0  # nothing collides: no hull is needed
        used.add(geom.meshname)
        if geom.type in (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF):
            raise ConfigError(
                f"{file.path}: {file.where('body', geom.parent.name)} has no "
                "<inertial>, and a shape that gives no mass: write its <inertial>"
            )
    _read_meshes(spec, file, used)


def _require_own_masses(spec: "mujoco.MjSpec", file: RobotFile) -> None:
    """Refuse a total that scales all masses: base and hand, left out, count in it."""
    if (total := spec.compiler.settotalmass) > 0.0:
        raise ConfigError(
            f"{file.path}: <compiler settotalmass> scales all masses to {total:g} kg "
            "in all, base and hand included, which are left out here: write each "
            "body's own mass, and remove settotalmass"
        )


def _moves(body: Any) -> bool:
    """Say whether one of the arm's joints moves a body."""
    while body.name != "world":
        if list(body.joints):
            return True
        body = body.parent
    return False


def _make_light(body: Any, spec: "mujoco.MjSpec") -> None:
    """Remove mass and shapes of a body that no joint moves: no torque depends on it."""
    for geom in list(body.geoms):
        spec.delete(geom)
    body.explicitinertial = False
    body.mass, body.inertia, body.fullinertia = 0.0, np.zeros(3), np.full(6, np.nan)


def _require_body(body: Any, spec: "mujoco.MjSpec", file: RobotFile) -> None:
    """Refuse a written inertia that no body has, unless the file balances it."""
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz = body.fullinertia
    matrix = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
    if is_diagonal := bool(np.isnan(Ixx)):
        matrix = np.diag(body.inertia)
    moments = np.linalg.eigvalsh(matrix)
    a, b, c = moments.tolist()
    lack = c - a - b
    where = f"{file.path}: {file.where('body', body.name)}"
    if a < -_ROUNDING * c:
        raise ConfigError(
            f"{where} has the principal moments {a:.4g}, {b:.4g} and {c:.4g} kg m2; "
            "none may be negative: correct its inertia"
        )
    if spec.compiler.balanceinertia:
        return
    if not list(body.joints) and 0.0 < c <= _NEGLIGIBLE:  # the placeholder of a frame
        body.inertia, body.fullinertia = (
            np.full(3, (a + b + c) / 3.0),
            np.full(6, np.nan),
        )
        return
    if lack > 1e-6 * c:
        raise ConfigError(
            f"{where} has the principal moments {a:.4g}, {b:.4g} and {c:.4g} kg m2: "
            f"{c:.4g} > {a:.4g} + {b:.4g}, and no rigid body has these. Correct its "
            'inertia, or put <compiler balanceinertia="true"/> into the file (in a '
            "URDF inside of <mujoco>): it takes the mean of the three"
        )
    if lack > -_ROUNDING * c:  # MuJoCo's own check counts rounding as a fault
        if is_diagonal:
            body.inertia += max(lack, 0.0) + _ROUNDING * c
        else:
            body.fullinertia[:3] += max(lack, 0.0) + _ROUNDING * c


def _require_mass(joint: Any, file: RobotFile) -> None:
    """Refuse a joint that moves nothing."""
    bodies, mass, moment = [joint.parent], 0.0, 0.0
    while bodies:
        body = bodies.pop()
        if list(body.geoms):
            return
        if body.explicitinertial:
            mass += body.mass
            full = body.fullinertia
            moment += float(np.abs(body.inertia if np.isnan(full[0]) else full).sum())
        bodies += [child for child in body.bodies if not list(child.joints)]
    if mass <= 0.0 or moment <= 0.0:
        body = file.where("body", joint.parent.name)
        raise ConfigError(
            f"{file.path}: {body}, which {file.where('joint', joint.name)} moves, has "
            f"a mass of {mass:g} kg and moments of {moment:g} kg m2 in all: both must "
            "be > 0; give it an <inertial>"
        )


def _read_meshes(spec: "mujoco.MjSpec", file: RobotFile, used: set[str]) -> None:
    """Read the meshes that a mass needs; MuJoCo opens none itself."""
    count = 0
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
            continue
        count += len(mesh.uservert) // 3
        if mesh.file:
            count += _read_into(mesh, file)
        if count > _VERTICES:
            raise ConfigError(
                f"{file.path}: bodies without <inertial> have meshes of more than "
                f"{_VERTICES} vertices: write their <inertial>"
            )


def _read_into(mesh: Any, file: RobotFile) -> int:
    """Read the file of a mesh, and return how many corners it has."""
    place = file.meshes[mesh.file]
    if not is_near(place, file.path):
        raise ConfigError(
            f"{file.path}: mesh {mesh.name} is {place}; only files of the file's own "
            "folder and of the one above are read: write the <inertial> of the body "
            "that needs it"
        )
    content = read_mesh(place)
    vertices, faces = np.unique(content.vertices, axis=0, return_inverse=True)
    mesh.file = ""
    mesh.uservert = vertices.ravel()
    mesh.userface = faces.ravel()[content.faces].ravel()
    return len(vertices)
