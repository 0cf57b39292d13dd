"""The gizmo at the tool by which its driver leads it."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dovetail.cockpit.panel import ControlPanel
from dovetail.cockpit.seat import Seat
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import Moment
from dovetail.control.task_spec import AXES
from dovetail.errors import DovetailError
from dovetail.poses import Pose, quat_multiply

if TYPE_CHECKING:
    import viser

_STILL = np.array([1.0, 0.0, 0.0, 0.0])


class LeadGizmo:
    """Gizmo by which the driver leads the tool; let go, it returns to the tool."""

    def __init__(
        self,
        server: "viser.ViserServer",
        session: Session,
        panel: ControlPanel,
        seat: Seat,
    ) -> None:
        """Add the gizmo, hidden until it is switched on.

        Args:
            server: The page's.
            session: What is led.
            panel: Says whether the gizmo is switched on.
            seat: Says who drives.
        """
        self._server, self._session, self._panel = server, session, panel
        self._seat = seat
        has_turns = bool(set(session.core.commands.axes) & set(AXES[3:]))
        self._gizmo: Any = server.scene.add_transform_controls(
            "/lead",
            scale=0.13,
            disable_rotations=not has_turns,
            depth_test=False,
            visible=False,
        )
        self._gizmo.on_update(self._on_lead)
        self._is_grabbed = False
        self._begin: Pose | None = None  # the tool's, when the gizmo was grabbed

    async def _on_lead(self, event: Any) -> None:
        """Lead while the gizmo is dragged."""
        if not self._panel.leads.is_on:
            return
        guide, moment = self._session.guide, self._session.moment
        self._is_grabbed = event.phase != "end"
        if event.phase == "end" or moment is None:
            guide.let_go()
            return
        if event.phase == "start" or self._begin is None:
            self._begin = moment.tool
        turn = np.array(event.target.wxyz, dtype=float)
        place = np.array(event.target.position, dtype=float)
        to = Pose(place, quat_multiply(turn, self._begin.quat_wxyz))
        try:
            guide.grab(to) if event.phase == "start" else guide.move(to)
        except DovetailError as error:
            self._session.say(str(error))

    def show(self, moment: Moment) -> None:
        """Put it at the tool unless it is dragged; note the driver's view direction."""
        gizmo = self._gizmo
        gizmo.visible = self._panel.leads.is_on
        if not (self._is_grabbed and self._session.guide.is_leading):
            gizmo.position, gizmo.wxyz = moment.tool.position, _STILL
        self._session.guide.heading = self._heading()

    def _heading(self) -> float:
        """Return which way the driver looks, from the world's x [rad]."""
        heading = self._session.guide.heading
        client = self._server.get_clients().get(self._seat.driver or -1)
        if client is None or not self._session.guide.has_mouse:
            return heading
        away = np.asarray(client.camera.look_at) - np.asarray(client.camera.position)
        is_level = bool(np.hypot(away[0], away[1]) > 1e-6)  # false for nan
        return math.atan2(away[1], away[0]) if is_level else heading
