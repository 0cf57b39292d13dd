"""Write robot, tool, fixture and table as one MuJoCo model (MJCF)."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from dovetail.poses import quat_from_matrix, quat_multiply
from dovetail.robots.drawn import Drawn, add_geom, add_mesh
from dovetail.robots.robot import Robot
from dovetail.types import Array
from dovetail.workcell.joints import Joint
from dovetail.workcell.parts import Moving, Primitive, mass_centre_inertia
from dovetail.workcell.workcell import Workcell

# The time constant is ContactDynamics.contact_time, set on the compiled model, and at
# least twice the step. With 5 ms this impedance lets 30 N press a wall in by 3 um;
# closer to 1, a part in a corner chatters. Fewer line-search iterations than this let
# the solver stop early and throw the arm. MuJoCo's own convex collisions (nativeccd)
# now and then put a cylinder that touches a box as deep in it as the box is, a
# push of 3900 N. libccd's, taken here, do not; boxes among each other use neither.
# Convex parts are another matter: one point of contact a pair lets a flat face rock (a
# force of 100 N by 3 N, 0.05 mm deep), libccd's normals are off by up to 0.3 rad near
# edges. MuJoCo's own with several points hold it to the millinewton, 0.02 mm deep.
_SOLREF = "0.002 1"
_SOLIMP = "0.95 0.99 0.0001 0.5 2"

_ORANGE, _GREY = (0.85, 0.5, 0.2, 1.0), (0.35, 0.37, 0.40, 1.0)
_HEADER = f"""\
<mujoco model="dovetail">
  <compiler angle="radian" autolimits="true"/>
  <option integrator="implicitfast" cone="elliptic" jacobian="dense" solver="Newton"
          iterations="100" ls_iterations="100" tolerance="1e-8" impratio="10">
    <flag autoreset="disable" island="disable" sensor="disable" actuation="disable"
          limit="disable" equality="disable" spring="disable" nativeccd="disable"/>
  </option>
  <size memory="4M"/>
  <visual><global offwidth="1280" offheight="960"/></visual>
  <default>
    <geom condim="3" solref="{_SOLREF}" solimp="{_SOLIMP}"/>
    <default class="visual"><geom contype="0" conaffinity="0" group="1"/></default>
    <default class="tool"><geom contype="1" conaffinity="0" mass="0"/>
      <default class="hidden"><geom group="3"/></default></default>
    <default class="world"><geom contype="0" conaffinity="1"/></default>
  </default>
  <asset/>
  <worldbody>
    <light pos="0.4 -1 2" dir="0 0.5 -1" castshadow="false"/>
    <camera name="side" pos="0.6 -1.1 0.5" xyaxes="1 0 0 0 0.4 0.9"/>
  </worldbody>
</mujoco>
"""


def build_mjcf(robot: Robot, cell: Workcell, *, visual_meshes: bool = False) -> str:
    """Return the workcell as an MJCF string.

    Dynamics (masses as simulated, damping, friction, gravity) are not written here:
    `MujocoPlant.configure` sets them on the compiled model, so that changing them does
    not compile again.

    Args:
        robot: The arm with its tool.
        cell: What stands around it.
        visual_meshes: Draw arm and tool as the files say that they have, and a link
            that has none as a capsule. Never used for collisions.
    """
    looks = _Looks(robot, cell) if visual_meshes else _Looks(None, None)
    root = ET.fromstring(_HEADER)
    assets, world = root.find("asset"), root.find("worldbody")
    assert assets is not None
    assert world is not None
    shapes = [*cell.tool_primitives(), *cell.fixture.primitives]
    shapes += [s for piece in cell.moving() for s in piece.primitives]
    _set_flags(root, shapes, moves=bool(cell.joints))
    _add_vertices(assets, shapes)
    looks.add_assets(assets)
    _add_part(world, cell.table.primitives[0], "world")
    # After the arm where it has joints: the arm's are the first seven of the model.
    if not cell.fixture.moving:
        _add_fixture(world, cell)
    _add_tool(_add_links(world, robot, looks), robot, cell, looks)
    if cell.fixture.moving:
        _add_fixture(world, cell)
    _couple(root, cell.joints)
    return ET.tostring(root, encoding="unicode")


def joint_name(name: str) -> str:
    """Return the model's name of a part's joint, and of the body that it moves."""
    return f"part_{name}"


def way_name(name: str) -> str:
    """Return the model's name of the slide along which a screw goes."""
    return f"way_{name}"


def turns(joints: Sequence[Joint]) -> list[int]:
    """Return where the positions of parts' joints are in those of the model.

    A screw has two, one after the other: its turn, and its way along the axis.
    """
    widths = [2 if joint.lead else 1 for joint in joints]
    return [7 + sum(widths[:i]) for i in range(len(joints))]


def model_positions(q: Array, joints: Sequence[Joint], parts: Array) -> Array:
    """Return the positions of the model.

    Args:
        q: Of the arm's joints [rad].
        joints: Of the parts.
        parts: Their positions [rad, m].
    """
    found = list(q)
    for joint, at in zip(joints, parts, strict=True):
        found += [at, joint.lead * at] if joint.lead else [at]
    return np.array(found)


def _add_fixture(world: ET.Element, cell: Workcell) -> None:
    fixture = ET.SubElement(
        world, "body", name="fixture", mocap="true", pos="0.6 0 0.1"
    )
    for part in cell.fixture.primitives:
        _add_part(fixture, part, "world")
    for piece in cell.fixture.moving:
        _add_moving(fixture, piece, {}, "world")


def _add_moving(
    body: ET.Element, piece: Moving, pose: dict[str, str], group: str
) -> None:
    """Write what moves on a body, in the frame of its part."""
    joint = piece.joint
    name = joint_name(joint.name)
    moved = ET.SubElement(body, "body", pose, name=name)
    mass, com, I = mass_centre_inertia(piece.primitives)
    full = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    facts = {"mass": f"{mass:.17g}", "fullinertia": _numbers(full)}
    ET.SubElement(moved, "inertial", facts, pos=_numbers(com))
    about = {"pos": _numbers(joint.origin), "axis": _numbers(joint.axis)}
    kind = "slide" if joint.kind == "slide" else "hinge"
    stops = _numbers(joint.stops)
    ET.SubElement(moved, "joint", about, name=name, type=kind, range=stops)
    if joint.lead:
        ET.SubElement(moved, "joint", about, name=way_name(joint.name), type="slide")
    for part in piece.primitives:
        _add_part(moved, part, group)


def _couple(root: ET.Element, joints: Sequence[Joint]) -> None:
    """Let each screw go along its axis as it turns."""
    screws = [joint for joint in joints if joint.lead]
    if not screws:
        return
    flag = root.find("option/flag")
    assert flag is not None
    flag.set("equality", "enable")
    equality = ET.SubElement(root, "equality")
    for joint in screws:
        ET.SubElement(
            equality,
            "joint",
            joint1=joint_name(joint.name),
            joint2=way_name(joint.name),
            polycoef=_numbers((0.0, 1.0 / joint.lead, 0.0, 0.0, 0.0)),
        )


class _Looks:
    """Meshes that draw base, links and tool, each file under a name of its own."""

    def __init__(self, robot: Robot | None, cell: Workcell | None) -> None:
        """Number everything that is drawn; nothing of None."""
        self.links: list[dict[str, Drawn]] = [
            {f"link{i}_{k}": one for k, one in enumerate(parts)}
            for i, parts in enumerate(robot.drawn if robot else ((),) * 8)
        ]
        tool = () if cell is None else cell.tool.drawn
        self.tool = {f"tool_{k}": one for k, one in enumerate(tool)}

    def add_assets(self, assets: ET.Element) -> None:
        """Add an asset for each."""
        for part in (*self.links, self.tool):
            for name, one in part.items():
                add_mesh(assets, name, one)


def _set_flags(root: ET.Element, shapes: list[Primitive], *, moves: bool) -> None:
    """Switch on stops of joints, and how shapes touch.

    Convex parts touch in several points; a cylinder keeps to libccd.
    """
    flag = root.find("option/flag")
    assert flag is not None
    kinds = {part.kind for part in shapes}
    if moves:
        flag.set("limit", "enable")
    if "convex" in kinds:
        flag.set("multiccd", "enable")
        flag.set("nativeccd", "disable" if "cylinder" in kinds else "enable")


def _add_vertices(assets: ET.Element, shapes: list[Primitive]) -> None:
    """Add the corners of what is neither box nor cylinder, as a mesh of its name."""
    for part in (part for part in shapes if part.kind in ("prism", "convex")):
        vertices = "  ".join(_numbers(corner) for corner in part.vertices())
        ET.SubElement(assets, "mesh", name=part.name, vertex=vertices)


def _add_links(world: ET.Element, robot: Robot, looks: _Looks) -> ET.Element:
    """Write the serial chain and return the last link."""
    _add_link_visual(world, 0, robot, looks)
    body, at = world, robot.geometry
    for i in range(7):
        pose = _pose(at.origin_position[i], at.origin_rotation[i])
        body = ET.SubElement(body, "body", pose, name=f"link{i + 1}")
        _add_inertial(body, robot, i)
        ET.SubElement(body, "joint", name=f"A{i + 1}", type="hinge", axis="0 0 1")
        _add_link_visual(body, i + 1, robot, looks)
    return body


def _add_tool(link: ET.Element, robot: Robot, cell: Workcell, looks: _Looks) -> None:
    """Write the tool, geoms of the last link, and the flange with the TCP."""
    at = robot.geometry
    hidden = {part.name for part in cell.tool.primitives} if looks.tool else set()
    for part in cell.tool_primitives():
        placed = in_last_link(part, robot)
        _add_part(link, placed, "hidden" if part.name in hidden else "tool")
    for name, one in looks.tool.items():
        placed = one.seen_from(at.flange_position, at.flange_rotation)
        add_geom(link, name, placed, _GREY)
    pose = _pose(at.flange_position, at.flange_rotation)
    for piece in cell.held_moving():
        _add_moving(link, piece, pose, "tool")
    flange = ET.SubElement(link, "body", pose, name="flange")
    tool = _pose(at.tool_position, at.tool_rotation)
    ET.SubElement(flange, "site", tool, name="tcp", size="0.003")


def in_last_link(part: Primitive, robot: Robot) -> Primitive:
    """Return a shape that is given in the flange frame in that of the last link."""
    at = robot.geometry
    T_flange = np.eye(4)
    T_flange[:3, :3], T_flange[:3, 3] = at.flange_rotation, at.flange_position
    position = (T_flange @ [*part.position, 1.0])[:3]
    quat = quat_multiply(quat_from_matrix(at.flange_rotation), part.quat_wxyz)
    return part._replace(position=position, quat_wxyz=quat)


def _add_inertial(body: ET.Element, robot: Robot, i: int) -> None:
    links, I = robot.links, robot.links.inertia[i]
    full = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    ET.SubElement(
        body,
        "inertial",
        pos=_numbers(links.com[i]),
        mass=f"{links.mass[i]:.17g}",
        fullinertia=_numbers(full),
    )


def _add_link_visual(body: ET.Element, link: int, robot: Robot, looks: _Looks) -> None:
    """Draw a link by its meshes, or by a capsule to the next joint."""
    if meshes := looks.links[link]:
        for name, one in meshes.items():
            add_geom(body, name, one, _ORANGE)
        return
    at = robot.geometry
    end = at.origin_position[link] if link < 7 else at.flange_position
    shape = {"type": "capsule", "fromto": f"0 0 0 {_numbers(end)}"}
    if np.linalg.norm(end) < 1e-6:  # MuJoCo builds no capsule without a length
        shape = {"type": "sphere"}
    size = "0.06" if link < 5 else "0.045"
    facts = {"class": "visual", "rgba": _numbers(_ORANGE), "mass": "0"}
    ET.SubElement(body, "geom", facts | shape, size=size)


def _add_part(body: ET.Element, part: Primitive, group: str) -> None:
    shape = {
        "box": {"type": "box", "size": _numbers(part.size)},
        "cylinder": {"type": "cylinder", "size": _numbers(part.size)},
    }.get(part.kind, {"type": "mesh", "mesh": part.name})
    facts = {"class": group, "name": part.name, "rgba": _numbers(part.rgba)}
    place = {"pos": _numbers(part.position), "quat": _numbers(part.quat_wxyz)}
    ET.SubElement(body, "geom", facts | shape | place)


def _pose(position: np.ndarray, rotation: np.ndarray) -> dict[str, str]:
    return {"pos": _numbers(position), "quat": _numbers(quat_from_matrix(rotation))}


def _numbers(values: "np.ndarray | tuple[float, ...]") -> str:
    return " ".join(f"{float(v):.17g}" for v in values)
