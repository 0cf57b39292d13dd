"""Page of the cockpit: draws the session's snapshots, knows who drives."""

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from dovetail.cockpit import gizmos
from dovetail.cockpit.panel import ControlPanel
from dovetail.cockpit.plots import LivePlots
from dovetail.cockpit.scene import CellScene
from dovetail.cockpit.server import PageServer, light
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import COLUMNS, USED

PATIENCE = 60.0
"""Time without input, while the arm stands, after which another viewer may drive [s].
A browser may keep a page that was left, and so may a closed laptop."""
_PLOTS = {
    "force [N]": ("force", "pull"),
    "limits used [%]": USED,
    "reward": ("reward",),
    "time to compute 10 ms [ms]": ("work",),
}
_FRAME = 1.0 / 30.0  # [s] between two pictures
_PAUSE = 1.0  # [s] between two notes that a viewer only watches
_SELDOM = 6  # pictures between two updates of curves and words


class DriverLock:
    """Lock of the one viewer who drives: the first to act, until that one leaves."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin free; `clock` returns the time [s]."""
        self._lock, self._clock = threading.Lock(), clock
        self._driver: int | None = None
        self._acted = 0.0  # when the driver acted last

    @property
    def driver(self) -> int | None:
        """Number of the viewer who drives; None if the lock is free."""
        return self._driver

    def acquire(self, viewer: int, *, is_standing: bool = False) -> bool:
        """Take the lock if it is free; return whether the viewer has it.

        Args:
            viewer: Number of the viewer who acts.
            is_standing: Whether nothing moves; then the lock of a driver who has not
                acted for `PATIENCE` is free.
        """
        with self._lock:
            now = self._clock()
            is_left = is_standing and now - self._acted > PATIENCE
            if self._driver is None or is_left:
                self._driver = viewer
            if self._driver == viewer:
                self._acted = now
            return self._driver == viewer

    def release(self, viewer: int) -> bool:
        """Give the lock back; return whether the viewer had it."""
        with self._lock:
            if self._driver != viewer:
                return False
            self._driver = None
            return True


class Page:
    """Draws a session for every viewer, and passes their commands to it."""

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
        self.driver_lock = DriverLock()
        """Lock of the viewer who drives."""
        self._is_ended = threading.Event()
        self._told = -_PAUSE
        server.gate.take(
            may_drive=self._may_drive,
            tell=self._tell_watching,
            stop=lambda: session.stop(),
            gizmos=gizmos.NAMES,
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
        self.panel = ControlPanel(self._page, session)
        """The controls beside the picture."""
        panel = server.gui.add_panel()
        with panel.add_tab("Live"):
            self._plots = LivePlots(server.gui, _PLOTS, COLUMNS)
        panel.dock_left()
        panel.set_width(280)
        self._gizmos = gizmos.Gizmos(server.scene, session, self.panel)

    # -- who drives ------------------------------------------------------------------

    def _may_drive(self, viewer: int) -> bool:
        """Return whether a viewer drives; take the lock for it if that is free."""
        is_standing = self._session.status.mode in ("held", "stopped")
        return self.driver_lock.acquire(viewer, is_standing=is_standing)

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
        if self.driver_lock.release(client.client_id):
            if not self._keeps_running:
                self._session.stop(is_pressed=False)
            self._gizmos.let_go()
            self._session.use_mouse(False)

    # -- drawing -------------------------------------------------------------------

    def _draw(self) -> None:
        while not self._is_ended.wait(_FRAME):
            if self._session.version != self._version:
                self._build()
            with self._server.atomic():
                self._draw_frame()
            self.frames += 1

    def _draw_frame(self) -> None:
        session, scene, panel = self._session, self._scene, self.panel
        snapshot, viewers = session.snapshot, self._server.get_clients()
        driver = self.driver_lock.driver
        if snapshot is not None:
            s = snapshot
            scene.place(s.q, s.fixture, s.believed, s.parts)
            shown = float(panel.forces.is_on)
            scene.point(shown * snapshot.force, shown * snapshot.pull)
            client = None if driver is None else viewers.get(driver)
            self._gizmos.show(snapshot, None if client is None else client.camera)
        scene.walls.visible = panel.walls.is_on
        if self.frames % _SELDOM == 0:
            panel.show(snapshot, session.status, driver, len(viewers))
            self._plots.show(session.trace.rows())
            scene.trace(session.trace.path() if panel.path.is_on else np.zeros((0, 3)))
            scene.near.visible = panel.near.is_on and snapshot is not None
            if snapshot is not None:
                scene.lay_near(*snapshot.near)

    def close(self) -> None:
        """Draw no more; the caller that opened the server also stops it."""
        self._is_ended.set()
        self._thread.join()
