"""Page of recorded episodes: a time line, one log or two side by side."""

import html
import threading
import time
from typing import Any

import numpy as np

from dovetail.cockpit.pace import SPEED_MAX
from dovetail.cockpit.plots import LivePlots
from dovetail.cockpit.recorded import COLUMNS, Recorded
from dovetail.cockpit.scene import CellScene
from dovetail.cockpit.server import PageServer, light
from dovetail.cockpit.software_rendering import FRAME_LIMIT

_FRAME = 1.0 / 30.0  # [s]
_APART = 0.9  # [m] between two cells
_SPEEDS = {"1/4": 0.25, "1/2": 0.5, "real time": 1.0, "x 4": SPEED_MAX}
_PLOTS = {
    "force [N]": ("force",),
    "joint torque, largest [Nm]": ("torque",),
    "speed [m/s]": ("speed",),
    "reward": ("reward",),
}
_TWO = {"apart [mm]": ("apart",)}


class ReplayPage:
    """Shows one log or two at the same time since their begin."""

    def __init__(self, page: PageServer, logs: tuple[Recorded, ...]) -> None:
        """Build the page, at the begin.

        Args:
            page: The page's server; the caller that opened it also stops it.
            logs: One or two.
        """
        server = page.viser
        self._server, self._logs = server, logs
        self._end = max(log.end for log in logs)
        self._now, self._speed, self._is_playing = 0.0, 1.0, False
        self._is_ended = threading.Event()
        light(server.scene)
        shifts = [_APART * (i - 0.5 * (len(logs) - 1)) for i in range(len(logs))]
        self.scenes = [
            CellScene(
                server.scene,
                log.cell,
                name=f"/log{i}",
                shift=np.array([0.0, shift, 0.0]),
                has_believed=bool(log.believed),
            )
            for i, (log, shift) in enumerate(zip(logs, shifts, strict=True))
        ]
        """The cells that are drawn, one for each log."""
        for log, shift in zip(logs, shifts, strict=True):
            server.scene.add_label(
                f"/name/{log.name}{shift:+g}", log.name, position=(0.0, shift, 1.25)
            )
        if len(logs) == 2:
            server.initial_camera.position = (2.3, -1.2, 1.15)
            server.initial_camera.look_at = (0.25, 0.05, 0.3)
        self._add_controls()
        self._add_curves()
        page.gate.take(may_drive=lambda _: True)
        self._thread = threading.Thread(target=self._draw, name="replay", daemon=True)
        self._thread.start()

    def _add_controls(self) -> None:
        gui = self._server.gui
        gui.add_html(FRAME_LIMIT)
        self._play = gui.add_button("Play / pause  (P)")
        self._play.on_click(lambda _: self.play(not self._is_playing))
        key = gui.add_command("Play / pause", hotkey="P")
        key.on_trigger(lambda _: self.play(not self._is_playing))
        self._line = gui.add_slider(
            "Time [s]", min=0.0, max=max(self._end, 0.01), step=0.01, initial_value=0.0
        )
        self._line.on_update(self._on_line)
        speed = gui.add_button_group("Speed", tuple(_SPEEDS))
        speed.on_click(self._set_speed)
        self._words = gui.add_html("")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(300)

    def _add_curves(self) -> None:
        logs = self._logs
        curves = [log.curves for log in logs]
        plots = dict(_PLOTS)
        if len(logs) == 2:
            curves[0] = logs[0].compared(logs[1])
            curves[1] = logs[1].compared(logs[0])
            plots |= _TWO
        gui = self._server.gui
        panel = gui.add_panel()
        with panel.add_tab("Curves"):
            names = ("",) if len(logs) == 1 else tuple(log.name for log in logs)
            drawn = LivePlots(gui, plots, COLUMNS, names=names, every=1)
        panel.dock_left()
        panel.set_width(290)
        drawn.show(*curves)

    # -- commands; from any thread -----------------------------------------------------

    def play(self, is_playing: bool) -> None:
        """Play, from the begin if the end was reached; or stand still."""
        if is_playing and self._now >= self._end:
            self._now = 0.0
        self._is_playing = is_playing

    def seek(self, time: float) -> None:
        """Go to a time [s]; outside the log, to its nearest end."""
        if np.isfinite(time):
            self._now = float(min(max(time, 0.0), self._end))

    @property
    def now(self) -> float:
        """Time that is shown [s]."""
        return self._now

    def _on_line(self, event: Any) -> None:
        if event.client_id is not None:
            self._is_playing = False
            self.seek(float(event.target.value))

    def _set_speed(self, event: Any) -> None:
        self._speed = _SPEEDS[event.target.value]

    # -- drawing -----------------------------------------------------------------------

    def _draw(self) -> None:
        last, shown = time.monotonic(), -1.0
        while not self._is_ended.wait(_FRAME):
            now = time.monotonic()
            if self._is_playing:
                self._now = min(self._now + self._speed * (now - last), self._end)
                self._is_playing = self._now < self._end
            last = now
            if self._now != shown:
                shown = self._now
                with self._server.atomic():
                    self._draw_frame(shown)

    def _draw_frame(self, now: float) -> None:
        words = []
        for log, scene in zip(self._logs, self.scenes, strict=True):
            q, force, fixture = log.at(now)
            scene.place(q, fixture, log.believed_at(now), log.parts_at(now))
            scene.point(force, log.pull_at(now))
            scene.trace(log.path(now))
            size = float(np.linalg.norm(force))
            kind = " (estimated)" if log.is_estimated else ""
            text = "no force known" if np.isnan(size) else f"{size:.1f} N{kind}"
            words.append(f"<div><b>{html.escape(log.name)}</b> {text}</div>")
        self._words.content = f"<div style='padding:0 .8em'>{''.join(words)}</div>"
        if self._is_playing or abs(self._line.value - now) > 0.006:
            self._line.value = round(now, 2)

    def close(self) -> None:
        """Draw no more."""
        self._is_ended.set()
        self._thread.join()
