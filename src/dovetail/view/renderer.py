"""Pictures of a workcell: any arm's, as they need only what was measured."""

import atexit
import itertools
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.plants.mjcf import model_positions
from dovetail.poses import Pose, matrix_from_quat
from dovetail.types import Array, Mat33, Vec3, Vec7
from dovetail.view.cell_model import cell_spec
from dovetail.view.gl_context import GlThread
from dovetail.view.marks import (
    BELIEVED_COLOUR,
    BESIDE,
    FORCE_COLOUR,
    FORCE_MIN,
    FORCE_SCALE,
    PATH_COLOUR,
    Colour,
    is_elsewhere,
)
from dovetail.workcell.workcell import Workcell

WIDTH, HEIGHT = 640, 480
"""Size of a picture [pixels]."""
_LOOK_AT, _DISTANCE = (0.42, 0.0, 0.33), 1.25  # m
_AZIMUTH, _ELEVATION = 142.0, -16.0  # degrees
_ARROW, _LINE = 0.006, 3.0  # radius [m], width [pixels]
_IN_FRONT = 0.5
"""Share of the way from the eye at which the path is drawn: at the same pixels, but no
longer hidden by the part that the tool holds."""
_MAX_GEOMS = 2000
_NEARER = 0.0005
"""Shift of the believed fixture towards the eye [m]: a face that lies in one plane with
the true one's would flicker."""
_INK = 0.00005
"""Depth of a print's paper below its ink [m]: so that the ink is seen."""
_NEAR, _FAR = 0.02, 5.0
"""Nearest and farthest distance that a camera sees [m]."""


def _rgba(colour: Colour, opacity: float = 1.0) -> NDArray[np.float32]:
    return np.array([*(part / 255.0 for part in colour), opacity], dtype=np.float32)


_RED, _BLUE, _FRAME = _rgba(FORCE_COLOUR), _rgba(PATH_COLOUR), _rgba(BELIEVED_COLOUR)
_GHOST = _rgba(BELIEVED_COLOUR, 0.15)  # what is behind it stays visible
_NO_TURN: Mat33 = np.eye(3)


class Plate(NamedTuple):
    """A flat print of no weight, cut out in its middle."""

    dark: NDArray[np.float64]
    """Black squares on white: their middles [m], shape (squares, 2)."""
    cell: float
    """Side of each [m]."""
    side: float
    """Outer side [m]."""
    cut_out: float
    """Side of the square that is cut out [m]."""


class CameraView(NamedTuple):
    """Pose of a pinhole camera, and the edges of its picture."""

    pose: Pose
    """The camera in the world: x to the right of the picture, y down, z ahead."""
    edges: tuple[float, float, float, float]
    """Left, right, top and bottom of the picture, 1 m ahead [m]; y is down."""


class Renderer:
    """Draws the arm at a configuration, its cell, a contact force and a path.

    A fixture that is believed to be elsewhere is drawn there once more: translucent,
    and in a frame.
    """

    def __init__(
        self,
        cell: Workcell,
        *,
        width: int = WIDTH,
        height: int = HEIGHT,
        plate: Plate | None = None,
        samples: int = 0,
    ) -> None:
        """Open a context and load the cell; `close` gives both back.

        Args:
            cell: What is drawn, by meshes where these are: see `cell_spec`.
            width: Of the picture [pixels].
            height: Of the picture [pixels].
            plate: A print that is drawn, too; it touches nothing.
            samples: Of each pixel, for smooth edges; 0 halves the time.

        Raises:
            MissingDependencyError: There is no OpenGL that draws without a screen.
        """
        import mujoco

        self._mujoco: Any = mujoco
        self._model = _model(self._mujoco, cell, (width, height), plate, samples)
        self._data = self._mujoco.MjData(self._model)
        body = self._model.body("fixture").id
        self._fixture = np.flatnonzero(self._model.geom_bodyid == body)
        self._corners = cell.fixture.corners
        self._joints, self._starts = cell.joints, cell.joint_starts
        self._size = height, width
        self._gl = GlThread(width, height)
        scale = self._mujoco.mjtFontScale.mjFONTSCALE_100.value
        self._context = self._gl.do(self._mujoco.MjrContext, self._model, scale)
        self._scene = self._mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._scene.flags[self._mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._options = self._mujoco.MjvOption()
        self._camera = self._mujoco.MjvCamera()
        self._camera.lookat[:], self._camera.distance = _LOOK_AT, _DISTANCE
        self._camera.azimuth, self._camera.elevation = _AZIMUTH, _ELEVATION
        self._is_open = True
        atexit.register(self._close_at_exit)  # before OpenGL itself is gone

    def draw(
        self,
        q: Vec7,
        fixture: Pose,
        *,
        force: Vec3 | None = None,
        path: Iterable[Vec3] = (),
        believed: Pose | None = None,
        plate: Pose | None = None,
        view: CameraView | None = None,
        parts: Array | None = None,
    ) -> NDArray[np.uint8]:
        """Return a picture, shape (height, width, 3).

        Args:
            q: Joint angles [rad].
            fixture: Where the fixture truly is, world axes.
            force: On the tool, world axes [N]: an arrow of `FORCE_SCALE` beside it.
            path: Where the tool's end was [m], the oldest first: a line in front of
                all bodies. Of a long one its last points, nearly 2000.
            believed: Where the fixture is believed; drawn where that is another place.
            plate: Where the print is, z out of its face; None leaves it where it was.
            view: What is shown; None is the arm from the side.
            parts: Positions of the parts' joints [rad, m]; None or empty is where they
                start.
        """
        mujoco, data, scene = self._mujoco, self._data, self._scene
        if parts is None or not len(parts):
            parts = self._starts
        data.qpos[:] = model_positions(q, self._joints, parts)
        data.mocap_pos[0], data.mocap_quat[0] = fixture
        if plate is not None:
            data.mocap_pos[1], data.mocap_quat[1] = plate
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value, scene,
        )  # fmt: skip
        if view is not None:
            self._look(view)
        if believed is not None and is_elsewhere(believed, fixture):
            self._add_ghost(believed)
        if force is not None and np.linalg.norm(force) > FORCE_MIN:  # false for nan
            tip = data.site("tcp").xpos + BESIDE
            end = tip + 2.0 * FORCE_SCALE * force  # MuJoCo draws half of an arrow
            self._connect("mjGEOM_ARROW", _ARROW, tip, end, _RED)
        self._add_path(np.array(list(path), dtype=float).reshape(-1, 3))
        return self._gl.do(self._rendered)[::-1]

    def _rendered(self) -> NDArray[np.uint8]:
        """Return the scene as a picture, its lowest row first; for the GlThread."""
        mujoco, context = self._mujoco, self._context
        picture = np.empty((*self._size, 3), dtype=np.uint8)
        whole = mujoco.MjrRect(0, 0, self._size[1], self._size[0])
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
        mujoco.mjr_render(whole, self._scene, context)
        mujoco.mjr_readPixels(picture, None, whole, context)
        return picture

    def _look(self, view: CameraView) -> None:
        """Let the scene be seen by a camera: a pinhole, not in its middle."""
        R = matrix_from_quat(view.pose.quat_wxyz)
        left, right, top, bottom = (_NEAR * edge for edge in view.edges)
        for eye in self._scene.camera:  # one for each eye; without stereo their mean
            eye.pos[:], eye.forward[:], eye.up[:] = (
                view.pose.position,
                R[:, 2],
                -R[:, 1],
            )
            eye.frustum_near, eye.frustum_far = _NEAR, _FAR
            eye.frustum_center = (left + right) / 2.0
            eye.frustum_width = (right - left) / 2.0
            eye.frustum_top, eye.frustum_bottom = -top, -bottom

    def _add_ghost(self, believed: Pose) -> None:
        """Add the fixture to the scene once more where it is believed, and a frame."""
        kinds, model = self._mujoco.mjtGeom, self._model
        nearer = -_NEARER * np.array(self._scene.camera[0].forward)
        place, R = believed.position + nearer, matrix_from_quat(believed.quat_wxyz)
        for geom in self._fixture:
            kind = int(model.geom_type[geom])
            shape = self._add(
                kind,
                model.geom_size[geom],
                place + R @ model.geom_pos[geom],
                R @ matrix_from_quat(model.geom_quat[geom]),
                _GHOST,
            )
            if shape is not None and kind == kinds.mjGEOM_MESH.value:
                shape.dataid = 2 * model.geom_dataid[geom]  # the odd one is its hull
        low, high = self._corners.min(axis=0), self._corners.max(axis=0)
        middle = place + R @ ((low + high) / 2.0)
        box = kinds.mjGEOM_LINEBOX.value
        self._add(box, (high - low) / 2.0, middle, R, _FRAME)

    def _add_path(self, places: Array) -> None:
        """Add a line through places [m], shape (points, 3): the last that have room."""
        scene = self._scene
        room = scene.maxgeom - scene.ngeom
        eye = np.mean([eye.pos for eye in scene.camera], axis=0)
        shown = eye + _IN_FRONT * (places[-(room + 1) :] - eye)
        for begin, end in itertools.pairwise(shown):
            self._connect("mjGEOM_LINE", _LINE, begin, end, _BLUE)

    def _add(
        self, kind: int, size: Vec3, position: Vec3, R: Mat33, rgba: NDArray[np.float32]
    ) -> Any:
        """Return a shape that was added to the scene, or None: there is no room."""
        scene = self._scene
        if scene.ngeom >= scene.maxgeom:
            return None
        shape = scene.geoms[scene.ngeom]
        self._mujoco.mjv_initGeom(shape, kind, size, position, R.ravel(), rgba)
        scene.ngeom += 1
        return shape

    def _connect(
        self,
        kind: str,
        width: float,
        begin: Vec3,
        end: Vec3,
        rgba: NDArray[np.float32],
    ) -> None:
        """Add a line or an arrow to the scene, while there is room."""
        shape = self._mujoco.mjtGeom.__members__[kind].value
        nothing = np.zeros(3)
        geom = self._add(shape, nothing, nothing, _NO_TURN, rgba)
        if geom is not None:
            self._mujoco.mjv_connector(geom, shape, width, begin, end)

    def close(self) -> None:
        """Give the context back; again is no harm."""
        if self._is_open:
            self._is_open = False
            atexit.unregister(self._close_at_exit)
            self._gl.close(self._context.free)

    def _close_at_exit(self) -> None:
        with suppress(Exception):  # the thread that opened it took it along
            self.close()


def _model(
    mujoco: Any,
    cell: Workcell,
    size: tuple[int, int],
    plate: Plate | None,
    samples: int,
) -> Any:
    """Return the compiled cell, with a sky and light for pictures."""
    spec = cell_spec(cell)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.45, 0.45, 0.45]
    spec.visual.quality.offsamples = samples
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.98],
        rgb2=[0.72, 0.78, 0.86],
        width=64,
        height=64,
    )
    if plate is not None:
        _add_plate(mujoco, spec, plate)
    return spec.compile()


def _add_plate(mujoco: Any, spec: Any, plate: Plate) -> None:
    """Add a print as a body of its own, to be put where it is seen."""
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2.0
    frame = np.vstack([plate.side * square, plate.cut_out * square])
    ring = [
        triangle
        for i, j in ((0, 1), (1, 2), (2, 3), (3, 0))
        for triangle in ((i, j, j + 4), (i, j + 4, i + 4))
    ]
    cells = (plate.dark[:, None, :] + plate.cell * square).reshape(-1, 2)
    first = 4 * np.arange(len(plate.dark))[:, None]
    halves = np.hstack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    # Triangles, not a texture: that would be blurred by the engine's way of shrinking.
    body = spec.worldbody.add_body(name="plate", mocap=True)
    for name, corners, faces, height, grey in (
        ("paper", frame, np.ravel(ring), -_INK, 1.0),
        ("ink", cells, halves.ravel(), 0.0, 0.03),
    ):
        spec.add_mesh(
            name=name,
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            uservert=np.column_stack([corners, np.full(len(corners), height)]).ravel(),
            userface=faces,
        )
        material = spec.add_material(name=name, specular=0.0, rgba=[grey] * 3 + [1.0])
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=material.name,
            contype=0,
            conaffinity=0,
            group=1,
        )
