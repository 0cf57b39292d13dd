"""The page: reads what the session says and draws it; owns no state of the arm."""

import threading
import time
from typing import Any

import numpy as np

from dovetail.cockpit.lead_gizmo import LeadGizmo
from dovetail.cockpit.panel import ControlPanel
from dovetail.cockpit.plots import LivePlots
from dovetail.cockpit.scene import CellScene
from dovetail.cockpit.seat import Seat
from dovetail.cockpit.server import PageServer, light
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import USED
from dovetail.cockpit.trace import COLUMNS
from dovetail.errors import DovetailError
from dovetail.poses import quat_about_z, theta_about_vertical

FRAME = 1.0 / 30.0
"""Time between two pictures [s]."""
PLOTS = {
    "force [N]": ("force", "pull"),
    "limits used [%]": USED,
    "reward": ("reward",),
    "time to compute 10 ms [ms]": ("work",),
}
"""Title of each plot, and its columns."""
_FAR = 100.0  # [m] to which no mouse drags anything
_PAUSE = 1.0  # [s] between two notes that a viewer only watches
_SELDOM = 6  # pictures between two updates of curves and words


class Page:
    """Draws a session for every viewer, and brings their wishes to it."""

    def __init__(
        self,
        server: PageServer,
        session: Session,
        *,
        keep_running: bool = False,
    ) -> None:
        """Build the page and begin to draw.

        Args:
            server: The page's; the caller that opened it also stops it.
            session: The session that it shows.
            keep_running: Let the arm go on when the driver leaves; otherwise it is
                held.
        """
        self._page, self._server, self._session = server, server.viser, session
        self._keeps_running = keep_running
        self._seat = Seat()
        self._is_ended = threading.Event()
        self._pulled = self._dragged = False
        self._told = -_PAUSE
        server.gate.take(
            may_drive=self._may_drive,
            tell=self._tell_watching,
            stop=lambda: session.stop(),
            gizmos=("/pull", "/drag", "/lead"),
        )
        self._build()
        self._server.on_client_disconnect(self._leave)
        self.frames = 0
        """Pictures that were sent."""
        self._thread = threading.Thread(target=self._draw, name="page", daemon=True)
        self._thread.start()

    def _build(self) -> None:
        server, session = self._server, self._session
        server.scene.reset()
        light(server.scene)
        self._version = session.version
        self._scene = CellScene(server.scene, session.core.cell)
        server.gui.reset()  # after what takes long: STOP is hardly away
        server.gui.main_panel.dock_right()  # before it: a panel is docked above
        server.gui.main_panel.set_width(320)
        self.panel = ControlPanel(self._page, session, self._seat)
        """The controls beside the picture."""
        panel = server.gui.add_panel()
        with panel.add_tab("Live"):
            self._plots = LivePlots(server.gui, PLOTS, COLUMNS)
        panel.dock_left()
        panel.set_width(280)
        self._lead = LeadGizmo(server, session, self.panel, self._seat)
        if session.can_touch:
            self._add_gizmos()

    def _add_gizmos(self) -> None:
        scene = self._server.scene
        self._grip = scene.add_transform_controls(
            "/pull", scale=0.10, disable_rotations=True, depth_test=False
        )
        self._grip.on_update(self._on_pull)
        self._handle = scene.add_transform_controls(
            "/drag", scale=0.16, active_axes=(True, True, False), depth_test=False
        )
        self._handle.on_update(self._on_drag)

    # -- what a mouse does ---------------------------------------------------------

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
        """Drag the fixture to where the gizmo is."""
        self._dragged = event.phase != "end"
        place = np.array(event.target.position, dtype=float)
        quat = np.array(event.target.wxyz, dtype=float)
        is_near = bool((np.abs(place) < _FAR).all())  # false for nan
        if not (is_near and np.isfinite(quat).all() and np.abs(quat).max() > 0.5):
            return
        if (moment := self._session.moment) is None:  # none of this cell yet
            return
        place[2] = moment.fixture.true.position[2]
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        try:
            self._session.drag(place, theta_about_vertical(quat, upright))
        except DovetailError as error:
            self._session.say(str(error))

    # -- who drives ------------------------------------------------------------------

    def _may_drive(self, viewer: int) -> bool:
        """Say whether a viewer drives, now at the latest."""
        is_standing = self._session.status.mode in ("held", "stopped")
        return self._seat.take(viewer, is_standing=is_standing)

    def _tell_watching(self, viewer: int, may_drive: bool) -> None:
        """Tell a viewer why nothing happened."""
        now = time.monotonic()
        client = self._server.get_clients().get(viewer)
        if client is None or now - self._told < _PAUSE:
            return
        self._told = now
        why = (
            "Another viewer drives this arm. It is free when that viewer closes the "
            "page, or does nothing for a minute while the arm stands."
            if may_drive
            else "This address sees everything and cannot drive."
        )
        client.add_notification(
            "You are watching", f"{why} STOP works for you, too.", auto_close_seconds=6
        )

    def _leave(self, client: Any) -> None:
        if self._seat.leave(client.client_id):
            self._pulled = self._dragged = False
            self._session.pull(None)
            self._session.use_mouse(False)
            self._session.guide.let_go()
            if not self._keeps_running:
                self._session.stop(is_pressed=False)

    # -- drawing -------------------------------------------------------------------

    def _draw(self) -> None:
        while not self._is_ended.wait(FRAME):
            if self._session.version != self._version:
                self._build()
            with self._server.atomic():
                self._draw_frame()
            self.frames += 1

    def _draw_frame(self) -> None:
        session, scene, panel = self._session, self._scene, self.panel
        moment = session.moment
        if moment is not None:
            scene.place(moment.q, moment.fixture.true, moment.fixture.seen)
            shown = panel.forces.is_on
            nothing = np.zeros(3)
            scene.point(
                moment.load.force if shown else nothing,
                moment.load.pull if shown else nothing,
            )
            self._lead.show(moment)
        if session.can_touch and moment is not None:
            self._grip.visible = panel.pulls.is_on and not panel.leads.is_on
            self._handle.visible = panel.drags.is_on
            if not self._pulled:
                self._grip.position = moment.tool.position
            if not self._dragged:
                facing = np.array(session.core.task.trial_poses[0].facing)
                yaw = theta_about_vertical(moment.fixture.true.quat_wxyz, facing)
                self._handle.position = moment.fixture.true.position
                self._handle.wxyz = quat_about_z(yaw)
        scene.walls.visible = panel.walls.is_on
        if self.frames % _SELDOM == 0:
            panel.show(moment, session.status, len(self._server.get_clients()))
            self._plots.show(session.trace.rows())
            scene.trace(session.trace.path() if panel.path.is_on else np.zeros((0, 3)))
            scene.near.visible = panel.near.is_on and moment is not None
            if moment is not None:
                scene.lay_near(*moment.fixture.near)

    def close(self) -> None:
        """Draw no more; the caller that opened the server also stops it."""
        self._is_ended.set()
        self._thread.join()
