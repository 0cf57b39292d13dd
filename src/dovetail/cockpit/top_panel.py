"""The panel that is always in view: STOP first, what the loop does, start and pace."""

import html
from collections.abc import Callable, Mapping
from typing import Any, Literal

from dovetail.cockpit.seat import Seat
from dovetail.cockpit.server import PageServer
from dovetail.cockpit.session import Session
from dovetail.cockpit.slow_browser import DRAW_LESS
from dovetail.cockpit.snapshot import Moment, Status

_SPEEDS = {"1/4": 0.25, "1/2": 0.5, "real time": 1.0, "x 2": 2.0}
_COLOURS = {
    "running": "#0b7a75",
    "led": "#0b7a75",
    "stopped": "#d9261f",
    "paused": "#b06f00",
}
_STOP_RED = (201, 30, 24)
_KEYS: Mapping[str, Literal["G", "P", "N", "R"]] = {
    "Start": "G",
    "Pause": "P",
    "Step": "N",
    "Reset": "R",
}
# In a narrow window all panels are sections of one sheet. The one that holds this stays
# at the window's top, before notes of the browser, and has no header that closes it.
_ON_TOP = """<style class="on-top">
@media (max-width: 36em) {
  div:has(> div > style.on-top) {
    position: fixed; top: 0; left: 0; right: 0;
    background: var(--mantine-color-body); box-shadow: 0 0 1em rgba(0, 0, 0, 0.2);
  }
  .mantine-Paper-root:has(style.on-top) { z-index: 1000 !important; }
  [role=button][aria-label$=" panel Drive"] { display: none !important; }
}
</style>"""
# Viser hears a key at the page's root, and some never get there: it leaves out what is
# pressed in a field or with Shift, and an icon's hint keeps the Escape that closes it.
# So Escape is pressed on the root itself, before anything else gets it. What has the
# focus still gets its own, which ends below the root: one press is one stop.
_ESCAPE = """<img alt="" src="data:," style="display: none" onerror="
if (!window.escapeStops) {
  window.escapeStops = true;
  const root = document.documentElement;
  window.addEventListener('keydown', (event) => {
    if (event.key !== 'Escape' || event.target === root) return;
    document.activeElement?.blur();
    root.dispatchEvent(new KeyboardEvent(
      'keydown', {key: 'Escape', code: 'Escape', bubbles: true}));
  }, true);
  document.body.addEventListener('keydown', (event) => {
    if (event.key === 'Escape') event.stopPropagation();
  });
}">"""


class TopPanel:
    """Stays where it is while the controls below it are scrolled."""

    def __init__(
        self,
        server: PageServer,
        session: Session,
        seat: Seat,
    ) -> None:
        """Add it above the main panel, which is docked.

        Args:
            server: The page's.
            session: What is driven.
            seat: Says who drives.
        """
        self._session, self._seat = session, seat
        self._gui = gui = server.viser.gui
        panel = gui.add_panel(order=-1.0)
        with panel.add_tab("Drive"):
            gui.add_html(_ON_TOP + _ESCAPE + DRAW_LESS)
            stop = gui.add_button("STOP  (Esc)", color=_STOP_RED)
            self._resume = gui.add_button("Resume", color="teal", visible=False)
            self._resume.on_click(lambda _: session.resume())
            self._status = gui.add_html("")
            self._add_actions()
        key = gui.add_command("Stop: hold the arm", hotkey="escape")
        server.gate.add_stops(stop, key)
        panel.dock_above(gui.main_panel)
        panel.expand()

    def _add_actions(self) -> None:
        """Add what can be done with this arm, and its keys."""
        gui, session = self._gui, self._session
        actions = _actions(session)
        self.offered = (*actions, *(("Speed",) if session.can_pace else ()))
        """Names of what can be done with this arm."""
        row = gui.add_button_group("", tuple(actions))
        row.on_click(lambda event: actions[event.target.value]())
        if session.can_pace:
            speed = gui.add_button_group("Speed", tuple(_SPEEDS))
            speed.on_click(self._set_speed)
        for name in actions:
            command: Any = gui.add_command(name, hotkey=_KEYS[name])
            command.on_trigger(lambda _, name=name: actions[name]())

    def _set_speed(self, event: Any) -> None:
        self._session.pace.speed = _SPEEDS[event.target.value]

    def show(self, moment: Moment | None, status: Status, viewers: int) -> None:
        """Say what the loop is doing."""
        if self._resume.visible != status.is_stopped:
            self._resume.visible = status.is_stopped
        colour = _COLOURS.get(status.mode, "#444444")
        lines = [
            f"<div style='font-size:1.35em;font-weight:700;color:{colour}'>"
            f"{status.mode}{' &#10003;' if status.success else ''}</div>"
        ]
        facts = [f"{100.0 * status.rate:.0f} % of its speed"]
        if moment is not None:
            facts.insert(0, f"{moment.stamp:.1f} s")
            facts.insert(1, f"depth {1e3 * moment.depth:.1f} mm")
        driver = self._seat.driver
        facts.append("nobody drives" if driver is None else f"viewer {driver} drives")
        facts.append(f"{viewers} watch" if viewers != 1 else "1 watches")
        if status.showing:
            facts.append(status.showing)
        lines.append(f"<div>{' &middot; '.join(facts)}</div>")
        if status.note:
            lines.append(f"<div><b>{html.escape(status.note)}</b></div>")
        content = "<div style='padding:0 .8em'>" + "".join(lines) + "</div>"
        if content != self._status.content:
            self._status.content = content


def _actions(session: Session) -> Mapping[str, Callable[[], None]]:
    """Return what starts, pauses and resets: only a simulation's time can stand."""

    def toggle_pause() -> None:
        session.pause(not session.is_paused)

    standing = {"Pause": toggle_pause, "Step": session.step}
    return {
        "Start": session.start,
        **(standing if session.can_pause else {}),
        "Reset": session.reset,
    }
