"""The workcell in the browser: the bodies that MuJoCo simulates, and marks."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dovetail.cockpit.software_rendering import fewer_triangles
from dovetail.plants.mjcf import model_positions
from dovetail.poses import Pose, matrix_from_quat, quat_from_matrix
from dovetail.types import Array, Mat33, Vec3, Vec7
from dovetail.view.cell_model import LAST_DRAWN, cell_spec
from dovetail.view.marks import (
    BELIEVED_COLOUR,
    BESIDE,
    FORCE_COLOUR,
    FORCE_MIN,
    FORCE_SCALE,
    PATH_COLOUR,
    is_elsewhere,
)
from dovetail.workcell.parts import Part, Primitive
from dovetail.workcell.workcell import Workcell

if TYPE_CHECKING:
    import viser

PULL_COLOUR = (240, 150, 20)
WALL_COLOUR, NEAR_COLOUR = (120, 130, 140), (11, 122, 117)
EDGE_COLOUR, MOUTH_COLOUR = (48, 66, 84), (255, 214, 10)
_PIECES = 32
"""Pieces of an edge that are shown or hidden each."""
_BESIDE_EDGE, _AT_SIDE = 2e-5, 1e-3
"""Distance beside an edge where material is tested, and largest distance of an outer
edge from the side of its part [m]."""


class CellScene:
    """Draws one cell below a node of the browser's scene; `remove` takes it away."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        cell: Workcell,
        *,
        name: str = "/cell",
        shift: Vec3 | None = None,
        has_believed: bool = True,
    ) -> None:
        """Send every body of the cell to the browser.

        Args:
            scene: The browser's.
            cell: The workcell.
            name: Name of its node in the scene.
            shift: Position of its base in the scene [m]; None is the origin.
            has_believed: Draw the fixture at its believed pose, too.
        """
        import mujoco

        self._mujoco: Any = mujoco
        self._scene, self._name = scene, name
        self._model: Any = cell_spec(cell).compile()
        self._data: Any = mujoco.MjData(self._model)
        at = np.zeros(3) if shift is None else shift
        self._root = scene.add_frame(name, show_axes=False, position=at)
        self._bodies = {
            i: scene.add_frame(f"{name}/body{i}", show_axes=False)
            for i in range(1, self._model.nbody)
        }
        self._joints, self._starts = cell.joints, cell.joint_starts
        self._fixture = self._model.body("fixture").id
        self.believed: viser.FrameHandle | None = None
        """Frame of the fixture's believed pose."""
        if has_believed:
            self.believed = scene.add_frame(f"{name}/believed", show_axes=False)
        for geom in np.flatnonzero(self._model.geom_group <= LAST_DRAWN):
            self._add_geom(int(geom))
        self._add_edges(cell.fixture)
        self._low, self._high = (np.array(wall) for wall in cell.walls)
        self._add_marks()

    def _add_geom(self, geom: int) -> None:
        model = self._model
        body = int(model.geom_bodyid[geom])
        parent = f"{self._name}/body{body}" if body else self._name
        vertices, faces, is_smooth = triangles(self._mujoco, model, geom)
        rgba = model.geom_rgba[geom]
        about: dict[str, Any] = {
            "vertices": vertices,
            "faces": faces,
            "flat_shading": not is_smooth,
            # toon5: a browser without a GPU draws it in two thirds of the standard's
            # time. But its few shades give the sides of a box one colour.
            "material": "toon5" if is_smooth else "standard",
            "position": model.geom_pos[geom],
            "wxyz": model.geom_quat[geom],
            "cast_shadow": False,
            "receive_shadow": False,
        }
        colour = np.round(255.0 * rgba[:3]).astype(np.uint8)
        opacity = float(rgba[3]) if rgba[3] < 1.0 else None
        self._scene.add_mesh_simple(
            f"{parent}/geom{geom}", color=colour, opacity=opacity, **about
        )
        if body == self._fixture and self.believed is not None:
            self._scene.add_mesh_simple(
                f"{self._name}/believed/geom{geom}",
                color=BELIEVED_COLOUR,
                opacity=0.25,
                **about,
            )

    def _add_edges(self, fixture: Part) -> None:
        """Draw the fixture's edges, those of its openings in a colour of their own."""
        edges, is_inner = feature_edges(fixture)
        for kind, is_kind, colour in (
            ("edges", ~is_inner, EDGE_COLOUR),
            ("mouth", is_inner, MOUTH_COLOUR),
        ):
            if is_kind.any():
                self._scene.add_line_segments(
                    f"{self._name}/body{self._fixture}/{kind}",
                    edges[is_kind].astype(np.float32),
                    colour,
                    thickness=2.0,
                    thickness_units="screen",
                )

    def _add_marks(self) -> None:
        scene, name = self._scene, self._name
        nowhere = np.zeros((1, 2, 3))
        arrow: dict[str, Any] = {
            "shaft_radius": 0.004,
            "head_radius": 0.011,
            "head_length": 0.025,
            "visible": False,
        }
        self.force = scene.add_arrows(f"{name}/force", nowhere, FORCE_COLOUR, **arrow)
        self.pull = scene.add_arrows(f"{name}/pull", nowhere, PULL_COLOUR, **arrow)
        line: dict[str, Any] = {"thickness_units": "screen"}
        self.path = scene.add_line_segments(
            f"{name}/path", nowhere, PATH_COLOUR, thickness=3.0, **line
        )
        edges = _box_edges(self._low, self._high)
        self.walls = scene.add_line_segments(
            f"{name}/walls", edges, WALL_COLOUR, thickness=1.5, **line
        )
        middle, half = (self._low + self._high) / 2.0, (self._high - self._low) / 2.0
        corners = np.array(
            [
                [-half[0], -half[1], 0.0],
                [half[0], -half[1], 0.0],
                [half[0], half[1], 0.0],
                [-half[0], half[1], 0.0],
            ]
        )
        self.near = scene.add_mesh_simple(
            f"{name}/near",
            corners,
            np.array([[0, 1, 2], [0, 2, 3]]),
            color=NEAR_COLOUR,
            opacity=0.18,
            side="double",
            position=middle,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def place(
        self,
        q: Vec7,
        fixture: Pose,
        seen: Pose | None = None,
        parts: Array | None = None,
    ) -> None:
        """Put the arm at joint angles [rad], the fixture and the believed one.

        Args:
            q: Joint angles [rad].
            fixture: The fixture.
            seen: The believed one; None leaves it where it was.
            parts: Positions of the parts' joints [rad, m]; None, empty or a
                not-a-number is where they start.
        """
        data = self._data
        if parts is None or not len(parts) or not np.isfinite(parts).all():
            parts = self._starts
        data.qpos[:] = model_positions(q, self._joints, parts)
        data.mocap_pos[0], data.mocap_quat[0] = fixture
        self._mujoco.mj_kinematics(self._model, data)
        for i, frame in self._bodies.items():
            frame.position, frame.wxyz = data.xpos[i], data.xquat[i]
        if self.believed is not None and seen is not None:
            self.believed.position, self.believed.wxyz = seen
            self.believed.visible = is_elsewhere(seen, fixture)

    def point(self, force: Vec3, pull: Vec3) -> None:
        """Draw the contact force and the hand's pull [N], world axes, at the tool."""
        tip = np.array(self._data.site("tcp").xpos)
        for arrow, vector, begin in (
            (self.force, force, tip + BESIDE),
            (self.pull, pull, tip),
        ):
            is_shown = bool(np.linalg.norm(vector) > FORCE_MIN)  # false for nan
            if is_shown:
                ends = np.array([[begin, begin + FORCE_SCALE * vector]])
                arrow.points = ends.astype(np.float32)
            arrow.visible = is_shown

    def trace(self, places: Array) -> None:
        """Draw the path of the tool's end [m], shape (points, 3)."""
        if len(places) < 2:
            self.path.visible = False
            return
        segments = np.stack([places[:-1], places[1:]], axis=1)
        self.path.points = segments.astype(np.float32)
        self.path.visible = True

    def lay_near(self, normal: Vec3, height: float) -> None:
        """Place the plane near contact: its normal, and its place along that [m]."""
        middle = (self._low + self._high) / 2.0
        self.near.position = middle + (height - float(normal @ middle)) * normal
        x = np.array([normal[2], 0.0, -normal[0]]) + 1e-12
        x = x / np.linalg.norm(x)
        axes = np.column_stack([x, np.cross(normal, x), normal])
        self.near.wxyz = quat_from_matrix(axes)

    def remove(self) -> None:
        """Take everything out of the browser's scene."""
        self._root.remove()


def triangles(mujoco: Any, model: Any, geom: int) -> tuple[Array, Array, bool]:
    """Return a geom's vertices [m], faces, and whether its surface is round."""
    from trimesh import creation

    kinds = mujoco.mjtGeom
    kind, size = kinds(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        begin, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        vertices = np.array(model.mesh_vert[first : first + count], dtype=float)
        triangles = np.array(model.mesh_face[begin : begin + faces])
        return *fewer_triangles(vertices, triangles), bool(count > 100)
    if kind == kinds.mjGEOM_BOX:
        shape = creation.box(extents=2.0 * size)
        # no vertex is shared: the browser's normals are those of the faces
        corners = shape.vertices[shape.faces].reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3).astype(shape.faces.dtype)
        return corners, faces, False
    if kind == kinds.mjGEOM_SPHERE:
        shape = creation.icosphere(subdivisions=2, radius=size[0])
    elif kind == kinds.mjGEOM_CYLINDER:
        shape = creation.cylinder(radius=size[0], height=2.0 * size[1])
    elif kind == kinds.mjGEOM_CAPSULE:
        shape = creation.capsule(radius=size[0], height=2.0 * size[1])
    else:
        raise ValueError(
            f"geom {geom} of the cell is a {kind.name}, which cannot be drawn"
        )
    return shape.vertices, shape.faces, True


def feature_edges(part: Part) -> tuple[Array, NDArray[np.bool_]]:
    """Return the visible edges of a part that is made of boxes.

    An edge of a box is left out where another box continues its face or covers it.

    Returns:
        Short pieces of edges [m], shape (pieces, 2, 3), the part's frame; and which of
        them are inside its outline seen along z, as the edges of an opening are.
    """
    boxes = [shape for shape in part.primitives if shape.kind == "box"]
    turns = [matrix_from_quat(box.quat_wxyz) for box in boxes]
    pieces = []
    for box, turn in zip(boxes, turns, strict=True):
        half = np.array(box.size)
        for begin, end in _box_edges(-half, half):
            ends = np.linspace(begin, end, _PIECES + 1)
            middles = (ends[:-1] + ends[1:]) / 2.0
            axis = int(np.argmax(np.abs(end - begin)))
            out = np.sign(begin) * _BESIDE_EDGE
            out[axis] = 0.0
            u, v = (np.where(np.arange(3) == i, out, 0.0) for i in _others(axis))
            full = np.array(
                [
                    _inside(box.position + (middles + sides) @ turn.T, boxes, turns)
                    for sides in (-u - v, u - v, u + v, v - u)
                ]
            )
            is_flat = (full.sum(axis=0) % 4 == 0) | (
                (full.sum(axis=0) == 2) & (full[0] != full[2])
            )
            seen = np.stack([ends[:-1], ends[1:]], axis=1)[~is_flat]
            pieces.append(box.position + seen @ turn.T)
    edges = np.concatenate([*pieces, np.empty((0, 2, 3))])
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    directions = np.stack([np.cos(angle), np.sin(angle)])
    outline = (part.corners[:, :2] @ directions).max(axis=0)
    inside = edges.mean(axis=1)[:, :2] @ directions < outline - _AT_SIDE
    return edges, inside.all(axis=1)


def _inside(points: Array, boxes: list[Primitive], turns: list[Mat33]) -> Array:
    """Return True for each point [m], shape (points, 3), inside one of the boxes."""
    return np.any(
        [
            (np.abs((points - box.position) @ turn) < box.size).all(axis=1)
            for box, turn in zip(boxes, turns, strict=True)
        ],
        axis=0,
    )


def _others(axis: int) -> tuple[int, int]:
    return (axis + 1) % 3, (axis + 2) % 3


def _box_edges(low: Vec3, high: Vec3) -> Array:
    """Return the twelve edges of a box, shape (12, 2, 3)."""
    ends = []
    for axis in range(3):
        others = [i for i in range(3) if i != axis]
        for corner in range(4):
            begin = np.array(low, dtype=float)
            for bit, other in enumerate(others):
                if corner >> bit & 1:
                    begin[other] = high[other]
            end = begin.copy()
            end[axis] = high[axis]
            ends.append((begin, end))
    return np.array(ends)
