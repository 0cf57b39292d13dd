"""Pictures of a workcell: any arm's, as they need only what was measured."""

import atexit
import itertools
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dovetail.poses import Pose, matrix_from_quat
from dovetail.types import Vec3, Vec7
from dovetail.view.cell_model import cell_spec
from dovetail.view.gl_context import open_context
from dovetail.workcell.workcell import Workcell

WIDTH, HEIGHT = 640, 480
"""Size of a picture [pixels]."""
FORCE_SCALE = 0.004
"""Length of a force's arrow [m/N]."""
_FORCE_MIN = 0.5  # [N] of which an arrow is drawn
_LOOK_AT, _DISTANCE = (0.42, 0.0, 0.33), 1.25  # m
_AZIMUTH, _ELEVATION = 142.0, -16.0  # degrees
_BESIDE = np.array([-0.04, -0.05, 0.0])
"""Where the arrow of a force stands from the tool's end [m]: else it is inside."""
_ARROW, _LINE = 0.006, 3.0  # radius [m], width [pixels]
RED = np.array([0.85, 0.15, 0.12, 1.0], dtype=np.float32)
BLUE = np.array([0.10, 0.35, 0.75, 1.0], dtype=np.float32)
_MAX_GEOMS = 2000
_INK = 0.00005
"""How far a print's paper is drawn below its ink [m]: so that the ink is seen."""
_NEAR, _FAR = 0.02, 5.0
"""What a camera sees: from and to [m]."""


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


class View(NamedTuple):
    """What a pinhole camera shows."""

    pose: Pose
    """The camera in the world: x to the right of the picture, y down, z ahead."""
    edges: tuple[float, float, float, float]
    """Left, right, top and bottom of the picture, 1 m ahead [m]; y is down."""


class Renderer:
    """Draws the arm at a configuration, its cell, a contact force and a path."""

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
            cell: What is drawn. The iiwa's meshes are pybullet_data's, where that is
                installed; every other link is a capsule.
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
        self._size = height, width
        self._gl = open_context(width, height)
        scale = self._mujoco.mjtFontScale.mjFONTSCALE_100.value
        self._context = self._mujoco.MjrContext(self._model, scale)
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
        path: Sequence[Vec3] = (),
        plate: Pose | None = None,
        view: View | None = None,
    ) -> NDArray[np.uint8]:
        """Return a picture, shape (height, width, 3).

        Args:
            q: Joint angles [rad].
            fixture: Where the fixture is, world axes.
            force: On the tool, world axes [N]: an arrow of `FORCE_SCALE` beside it.
            path: Where the tool's end was [m], the oldest first: a line. Of a long
                one its last points, nearly 2000.
            plate: Where the print is, z out of its face; None leaves it where it was.
            view: What is shown; None is the arm from the side.
        """
        mujoco, data, scene = self._mujoco, self._data, self._scene
        data.qpos[:] = q
        data.mocap_pos[0], data.mocap_quat[0] = fixture
        if plate is not None:
            data.mocap_pos[1], data.mocap_quat[1] = plate
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._gl.make_current()
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value, scene,
        )  # fmt: skip
        if view is not None:
            self._look(view)
        if force is not None and np.linalg.norm(force) > _FORCE_MIN:  # false for nan
            tip = data.site("tcp").xpos + _BESIDE
            end = tip + 2.0 * FORCE_SCALE * force  # MuJoCo draws half of an arrow
            self._connect("mjGEOM_ARROW", _ARROW, tip, end, RED)
        shown = np.asarray(path, dtype=float).reshape(-1, 3)
        room = scene.maxgeom - scene.ngeom
        for begin, end in itertools.pairwise(shown[-(room + 1) :]):
            self._connect("mjGEOM_LINE", _LINE, begin, end, BLUE)
        picture = np.empty((*self._size, 3), dtype=np.uint8)
        whole = mujoco.MjrRect(0, 0, self._size[1], self._size[0])
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        mujoco.mjr_render(whole, scene, self._context)
        mujoco.mjr_readPixels(picture, None, whole, self._context)
        return picture[::-1]

    def _look(self, view: View) -> None:
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

    def _connect(
        self,
        kind: str,
        width: float,
        begin: Vec3,
        end: Vec3,
        rgba: NDArray[np.float32],
    ) -> None:
        """Add a line or an arrow to the scene, while there is room."""
        scene, mujoco = self._scene, self._mujoco
        if scene.ngeom >= scene.maxgeom:
            return
        shape = mujoco.mjtGeom.__members__[kind]
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(
            geom, shape.value, np.zeros(3), np.zeros(3), np.zeros(9), rgba
        )
        mujoco.mjv_connector(geom, shape.value, width, begin, end)
        scene.ngeom += 1

    def close(self) -> None:
        """Give the context back; again is no harm."""
        if self._is_open:
            self._is_open = False
            atexit.unregister(self._close_at_exit)
            self._gl.make_current()
            self._context.free()
            self._gl.free()

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
