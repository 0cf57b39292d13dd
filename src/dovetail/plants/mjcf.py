"""Write robot, tool, fixture and table as one MuJoCo model (MJCF)."""

import math

import numpy as np

from dovetail.poses import quat_from_matrix, quat_multiply
from dovetail.robots.drawn import Drawn, geom_xml, mesh_xml
from dovetail.robots.robot import Robot
from dovetail.workcell.parts import Primitive
from dovetail.workcell.workcell import TABLE, Workcell

# The time constant is ContactDynamics.contact_time, set on the compiled model, and at
# least twice the step. With 5 ms this impedance lets 30 N press a wall in by 3 um;
# closer to 1, a part in a corner chatters. Fewer line-search iterations than this let
# the solver stop early and throw the arm. MuJoCo's own convex collisions (nativeccd)
# now and then tell a cylinder that touches a box to be in it as deep as the box is, a
# push of 3900 N. libccd's, taken here, do not; boxes among each other use neither.
_SOLREF = "0.002 1"
_SOLIMP = "0.95 0.99 0.0001 0.5 2"

_ORANGE, _GREY = (0.85, 0.5, 0.2, 1.0), (0.35, 0.37, 0.40, 1.0)
_HEADER = """\
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
    <geom condim="3" solref="{solref}" solimp="{solimp}"/>
    <default class="visual"><geom contype="0" conaffinity="0" group="1"/></default>
    <default class="tool"><geom contype="1" conaffinity="0" mass="0"/>
      <default class="hidden"><geom group="3"/></default></default>
    <default class="world"><geom contype="0" conaffinity="1"/></default>
  </default>
{assets}  <worldbody>
    <light pos="0.4 -1 2" dir="0 0.5 -1" castshadow="false"/>
    <camera name="side" pos="0.6 -1.1 0.5" xyaxes="1 0 0 0 0.4 0.9"/>
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
    lines = [_table(), *_fixture(cell), *_links(robot, cell, looks)]
    header = _HEADER.format(solref=_SOLREF, solimp=_SOLIMP, assets=_assets(cell, looks))
    return header + "\n".join(lines) + "\n  </worldbody>\n</mujoco>\n"


class _Looks:
    """What base, links and tool are drawn as, each file under a name of its own."""

    def __init__(self, robot: Robot | None, cell: Workcell | None) -> None:
        """Number everything that is drawn; nothing of None."""
        self.links: list[dict[str, Drawn]] = [
            {f"link{i}_{k}": one for k, one in enumerate(parts)}
            for i, parts in enumerate(robot.drawn if robot else ((),) * 8)
        ]
        tool = () if cell is None else cell.tool.drawn
        self.tool = {f"tool_{k}": one for k, one in enumerate(tool)}

    def assets(self) -> list[str]:
        """Return an asset for each."""
        every = [*self.links, self.tool]
        return [mesh_xml(name, one) for part in every for name, one in part.items()]


def _assets(cell: Workcell, looks: _Looks) -> str:
    lines = []
    shapes = [*cell.tool_primitives(), *cell.fixture.primitives]
    for part in (part for part in shapes if part.kind == "prism"):
        radius, half = part.size
        corners = [
            (radius * math.cos(a), radius * math.sin(a), z)
            for z in (-half, half)
            for a in (0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)
        ]
        vertices = "  ".join(_numbers(corner) for corner in corners)
        lines.append(f'    <mesh name="{part.name}" vertex="{vertices}"/>')
    lines += [f"    {asset}" for asset in looks.assets()]
    if not lines:
        return ""
    return "  <asset>\n" + "\n".join(lines) + "\n  </asset>\n"


def _table() -> str:
    return "    " + _geom(TABLE.primitives[0], "world")


def _fixture(cell: Workcell) -> list[str]:
    parts = ["      " + _geom(part, "world") for part in cell.fixture.primitives]
    return [
        '    <body name="fixture" mocap="true" pos="0.6 0 0.1">',
        *parts,
        "    </body>",
    ]


def _links(robot: Robot, cell: Workcell, looks: _Looks) -> list[str]:
    """Write the serial chain; the tool is geoms of the last link."""
    lines, at = [_link_visual(0, robot, looks)], robot.geometry
    for i in range(7):
        pad = "    " + "  " * i
        pos = _numbers(at.origin_position[i])
        quat = _numbers(quat_from_matrix(at.origin_rotation[i]))
        lines.append(f'{pad}<body name="link{i + 1}" pos="{pos}" quat="{quat}">')
        lines.append(f"{pad}  {_inertial(robot, i)}")
        lines.append(f'{pad}  <joint name="A{i + 1}" type="hinge" axis="0 0 1"/>')
        lines.append(f"{pad}  {_link_visual(i + 1, robot, looks)}")
    flange = _pose(at.flange_position, at.flange_rotation)
    hidden = {part.name for part in cell.tool.primitives} if looks.tool else set()
    for part in cell.tool_primitives():
        T_flange = np.eye(4)
        T_flange[:3, :3], T_flange[:3, 3] = at.flange_rotation, at.flange_position
        position = (T_flange @ [*part.position, 1.0])[:3]
        quat = quat_from_matrix(at.flange_rotation)
        quat = quat_multiply(quat, part.quat_wxyz)
        placed = part._replace(position=position, quat_wxyz=quat)
        group = "hidden" if part.name in hidden else "tool"
        lines.append("                  " + _geom(placed, group))
    for name, one in looks.tool.items():
        placed = one.seen_from(at.flange_position, at.flange_rotation)
        lines.append("                  " + geom_xml(name, placed, _GREY))
    lines.append(f'                  <body name="flange" {flange}>')
    tool = _pose(at.tool_position, at.tool_rotation)
    lines.append(f'                    <site name="tcp" size="0.003" {tool}/></body>')
    return [*lines, "    " + "</body>" * 7]


def _inertial(robot: Robot, i: int) -> str:
    links, I = robot.links, robot.links.inertia[i]
    full = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
    return (
        f'<inertial pos="{_numbers(links.com[i])}" mass="{links.mass[i]:.17g}" '
        f'fullinertia="{_numbers(full)}"/>'
    )


def _link_visual(link: int, robot: Robot, looks: _Looks) -> str:
    """Draw a link by its meshes, or by a capsule to the next joint."""
    if meshes := looks.links[link]:
        return "".join(geom_xml(name, one, _ORANGE) for name, one in meshes.items())
    at = robot.geometry
    end = at.origin_position[link] if link < 7 else at.flange_position
    radius = 0.06 if link < 5 else 0.045
    if np.linalg.norm(end) < 1e-6:  # MuJoCo builds no capsule without a length
        return (
            f'<geom class="visual" type="sphere" size="{radius}" '
            f'rgba="0.85 0.5 0.2 1" mass="0"/>'
        )
    return (
        f'<geom class="visual" type="capsule" size="{radius}" rgba="0.85 0.5 0.2 1" '
        f'fromto="0 0 0 {_numbers(end)}" mass="0"/>'
    )


def _geom(part: Primitive, group: str) -> str:
    shape = {
        "box": f'type="box" size="{_numbers(part.size)}"',
        "cylinder": f'type="cylinder" size="{_numbers(part.size)}"',
        "prism": f'type="mesh" mesh="{part.name}"',
    }[part.kind]
    return (
        f'<geom class="{group}" name="{part.name}" {shape} '
        f'pos="{_numbers(part.position)}" quat="{_numbers(part.quat_wxyz)}" '
        f'rgba="{_numbers(part.rgba)}"/>'
    )


def _pose(position: np.ndarray, rotation: np.ndarray) -> str:
    quat = quat_from_matrix(rotation)
    return f'pos="{_numbers(position)}" quat="{_numbers(quat)}"'


def _numbers(values: "np.ndarray | tuple[float, ...]") -> str:
    return " ".join(f"{float(v):.17g}" for v in values)
