"""Pictures of a workcell: any arm's, as they need only what was measured."""

import atexit
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dovetail.poses import Pose
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


class Renderer:
    """Draws the arm at a configuration, its cell, a contact force and a path."""

    def __init__(
        self, cell: Workcell, *, width: int = WIDTH, height: int = HEIGHT
    ) -> None:
        """Open a context and load the cell; `close` gives both back.

        Args:
            cell: What is drawn. The iiwa's meshes are pybullet_data's, where that is
                installed; every other link is a capsule.
            width: Of the picture [pixels].
            height: Of the picture [pixels].

        Raises:
            MissingDependencyError: There is no OpenGL that draws without a screen.
        """
        import mujoco

        self._mujoco: Any = mujoco
        self._model = _model(self._mujoco, cell, width, height)
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
        atexit.register(self.close)  # before OpenGL itself is gone

    def draw(
        self,
        q: Vec7,
        fixture: Pose,
        *,
        force: Vec3 | None = None,
        path: Sequence[Vec3] = (),
    ) -> NDArray[np.uint8]:
        """Return a picture, shape (height, width, 3).

        Args:
            q: Joint angles [rad].
            fixture: Where the fixture is, world axes.
            force: On the tool, world axes [N]: an arrow of `FORCE_SCALE` beside it.
            path: Where the tool's end was [m], the oldest first: a line.
        """
        mujoco, data, scene = self._mujoco, self._data, self._scene
        data.qpos[:] = q
        data.mocap_pos[0], data.mocap_quat[0] = fixture
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._gl.make_current()
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value, scene,
        )  # fmt: skip
        shown = np.asarray(path, dtype=float).reshape(-1, 3)
        for begin, end in itertools.pairwise(shown):
            self._connect("mjGEOM_LINE", _LINE, begin, end, BLUE)
        if force is not None and np.linalg.norm(force) > _FORCE_MIN:  # false for nan
            tip = data.site("tcp").xpos + _BESIDE
            end = tip + 2.0 * FORCE_SCALE * force  # MuJoCo draws half of an arrow
            self._connect("mjGEOM_ARROW", _ARROW, tip, end, RED)
        picture = np.empty((*self._size, 3), dtype=np.uint8)
        whole = mujoco.MjrRect(0, 0, self._size[1], self._size[0])
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        mujoco.mjr_render(whole, scene, self._context)
        mujoco.mjr_readPixels(picture, None, whole, self._context)
        return picture[::-1]

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
            atexit.unregister(self.close)
            self._gl.make_current()
            self._context.free()
            self._gl.free()


def _model(mujoco: Any, cell: Workcell, width: int, height: int) -> Any:
    """Return the compiled cell, with a sky and light for pictures."""
    spec = cell_spec(cell)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.45, 0.45, 0.45]
    spec.visual.quality.offsamples = 0  # smooth edges halve the speed
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.98],
        rgb2=[0.72, 0.78, 0.86],
        width=64,
        height=64,
    )
    return spec.compile()
