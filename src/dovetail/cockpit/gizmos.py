"""Gizmos in the picture: pull the arm, drag the fixture, lead the tool."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.cockpit.panel import ControlPanel
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import Snapshot
from dovetail.control.task_spec import AXES
from dovetail.errors import DovetailError
from dovetail.poses import Pose, quat_about_z, quat_multiply, theta_about_vertical

if TYPE_CHECKING:
    import viser

NAMES = ("/pull", "/drag", "/lead")
"""Names of the gizmos in viser's scene."""
_FAR = 100.0  # [m] limit of a place that the fixture is dragged to
_STILL = np.array([1.0, 0.0, 0.0, 0.0])


class Gizmos:
    """Gizmos of one cell; let go, each returns to its body."""

    def __init__(
        self, scene: "viser.SceneApi", session: Session, panel: ControlPanel
    ) -> None:
        """Add the gizmos.

        Args:
            scene: The browser's.
            session: The session that they act on.
            panel: Its switches show and hide them.
        """
        self._session, self._panel = session, panel
        self._pulled = self._dragged = self._led = False
        self._begin: Pose | None = None  # of the tool, when the lead began
        has_turns = bool(set(session.core.commands.axes) & set(AXES[3:]))
        self._lead: Any = scene.add_transform_controls(
            "/lead",
            scale=0.13,
            disable_rotations=not has_turns,
            depth_test=False,
            visible=False,
        )
        self._lead.on_update(self._on_lead)
        if not session.can_touch:
            return
        self._pull: Any = scene.add_transform_controls(
            "/pull", scale=0.10, disable_rotations=True, depth_test=False
        )
        self._pull.on_update(self._on_pull)
        self._drag: Any = scene.add_transform_controls(
            "/drag", scale=0.16, active_axes=(True, True, False), depth_test=False
        )
        self._drag.on_update(self._on_drag)

    async def _on_pull(self, event: Any) -> None:
        """Pull while the gizmo is dragged."""
        self._pulled = event.phase != "end"
        if event.phase == "end":
            self._session.pull(None)
        else:
            place = np.array(event.target.position, dtype=float)
            if np.isfinite(place).all():
                self._session.pull(place)

    async def _on_drag(self, event: Any) -> None:
        """Drag the fixture to the gizmo."""
        self._dragged = event.phase != "end"
        place = np.array(event.target.position, dtype=float)
        quat = np.array(event.target.wxyz, dtype=float)
        is_near = bool((np.abs(place) < _FAR).all())  # false for nan
        if not (is_near and np.isfinite(quat).all() and np.abs(quat).max() > 0.5):
            return
        if (snapshot := self._session.snapshot) is None:  # none of this cell yet
            return
        place[2] = snapshot.fixture.position[2]
        try:
            self._session.drag(place, theta_about_vertical(quat, _STILL))
        except DovetailError as error:
            self._session.say(str(error))

    async def _on_lead(self, event: Any) -> None:
        """Lead the tool while the gizmo is dragged."""
        if not self._panel.leads.is_on:
            return
        teleoperator, snapshot = self._session.teleoperator, self._session.snapshot
        self._led = event.phase != "end"
        if event.phase == "end" or snapshot is None:
            teleoperator.let_go()
            return
        if event.phase == "start" or self._begin is None:
            self._begin = snapshot.tool
        turn = np.array(event.target.wxyz, dtype=float)
        place = np.array(event.target.position, dtype=float)
        to = Pose(place, quat_multiply(turn, self._begin.quat_wxyz))
        try:
            teleoperator.grab(to) if event.phase == "start" else teleoperator.move(to)
        except DovetailError as error:
            self._session.say(str(error))

    def let_go(self) -> None:
        """Let go of the gizmos: their driver has left."""
        self._pulled = self._dragged = False
        self._session.pull(None)
        self._session.teleoperator.let_go()

    def show(self, snapshot: Snapshot, camera: "viser.CameraHandle | None") -> None:
        """Put each gizmo at its body unless it is dragged.

        Args:
            snapshot: State of the cell.
            camera: The driver's: a 3D mouse leads along its view.
        """
        session, panel, tool = self._session, self._panel, snapshot.tool
        self._lead.visible = panel.leads.is_on
        if not (self._led and session.teleoperator.is_leading):
            self._lead.position, self._lead.wxyz = tool.position, _STILL
        if camera is not None and session.teleoperator.has_mouse:
            away = np.asarray(camera.look_at) - np.asarray(camera.position)
            if np.hypot(away[0], away[1]) > 1e-6:  # false for nan
                session.teleoperator.heading = math.atan2(away[1], away[0])
        if not session.can_touch:
            return
        self._pull.visible = panel.pulls.is_on and not panel.leads.is_on
        self._drag.visible = panel.drags.is_on
        if not self._pulled:
            self._pull.position = tool.position
        if not self._dragged:
            facing = np.array(session.core.task.trial_poses[0].facing)
            yaw = theta_about_vertical(snapshot.fixture.quat_wxyz, facing)
            self._drag.position = snapshot.fixture.position
            self._drag.wxyz = quat_about_z(yaw)
