"""Controls of the cockpit's page: STOP and Start always in view, the others below."""

import html
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from dovetail.cockpit.choice import NO_POLICY, SCRIPT, known_places, known_words
from dovetail.cockpit.server import PageServer
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import LoopStatus, Snapshot
from dovetail.cockpit.software_rendering import FRAME_LIMIT
from dovetail.learn.policy import list_policies
from dovetail.settings import values_of

if TYPE_CHECKING:
    import viser

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


class Toggle:
    """Switch of the page, a button: after a checkbox, keys would do nothing.

    The browser keeps keys for a field that was clicked last, and Escape must stop.
    """

    def __init__(
        self,
        gui: "viser.GuiApi",
        label: str,
        is_on: bool,
        act: Callable[[bool], None] = lambda _: None,
    ) -> None:
        """Add the button where the panel now is.

        Args:
            gui: The browser's panels.
            label: Name of the switch.
            is_on: State at first.
            act: Called with the new state at a click.
        """
        self._label, self._act = label, act
        self._button: Any = gui.add_button(label)
        self._button.on_click(self._turn)
        self.show(is_on)

    def _turn(self, _: Any) -> None:
        self.show(not self.is_on)
        self._act(self.is_on)

    def show(self, is_on: bool) -> None:
        """Show that it is on, or off, without acting."""
        self.is_on = is_on
        self._button.label = f"{self._label}: {'on' if is_on else 'off'}"
        self._button.color = "teal" if is_on else "gray"


class ControlPanel:
    """Controls that command the session; the gate passes on the driver's input only.

    The panel "Drive" stays where it is while the controls below it are scrolled.
    """

    def __init__(self, server: PageServer, session: Session) -> None:
        """Add every control; the main panel is docked already.

        Args:
            server: The page's.
            session: The session that is driven.
        """
        self._gui, self._session = server.viser.gui, session
        self._add_drive(server)
        self._add_lead()
        if session.can_touch:
            self._add_touch()
        self._add_choice()
        self._add_display()

    def _add_drive(self, server: PageServer) -> None:
        gui, session = self._gui, self._session
        panel = gui.add_panel(order=-1.0)
        with panel.add_tab("Drive"):
            gui.add_html(_ON_TOP + _ESCAPE + FRAME_LIMIT)
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
        """Add the actions of this arm, and their keys."""
        gui, session = self._gui, self._session
        actions: dict[str, Callable[[], None]] = {"Start": session.start}
        if session.can_touch:
            actions["Pause"] = lambda: session.pause(not session.is_paused)
            actions["Step"] = session.step
        actions["Reset"] = session.reset
        self.offered = (*actions, *(("Speed",) if session.can_pace else ()))
        """Names of the actions of this arm."""
        row = gui.add_button_group("", tuple(actions))
        row.on_click(lambda event: actions[event.target.value]())
        if session.can_pace:
            speed = gui.add_button_group("Speed", tuple(_SPEEDS))
            speed.on_click(self._set_speed)
        for name, act in actions.items():
            command: Any = gui.add_command(name, hotkey=_KEYS[name])
            command.on_trigger(lambda _, act=act: act())

    def _set_speed(self, event: Any) -> None:
        self._session.pace.speed = _SPEEDS[event.target.value]

    def _add_lead(self) -> None:
        gui, session = self._gui, self._session
        shown: dict[str, Callable[[], None]] = {
            "Begin": session.demonstrate,
            "Keep": lambda: session.end_demonstration(is_kept=True),
            "Throw away": lambda: session.end_demonstration(is_kept=False),
        }
        with gui.add_folder("Lead"):
            self.leads = Toggle(gui, "Lead the tool", False, act=self._lead)
            has_mouse = session.teleoperator.has_mouse
            self._mouse = Toggle(gui, "3D mouse", has_mouse, act=session.use_mouse)
            row = gui.add_button_group("Demonstration", tuple(shown))
            row.on_click(lambda event: shown[event.target.value]())

    def _lead(self, is_on: bool) -> None:
        if not is_on:
            self._session.teleoperator.let_go()

    def _add_touch(self) -> None:
        gui, session = self._gui, self._session
        with gui.add_folder("Touch"):
            self.pulls = Toggle(gui, "Pull the arm", True)
            self.drags = Toggle(gui, "Drag the fixture", True)
            Toggle(gui, "Cover the camera", session.is_covered, act=session.cover)

    def _add_choice(self) -> None:
        gui, session = self._gui, self._session
        choice = session.choice
        words = known_words(choice)
        settings = values_of(session.core.config) | vars(session.core.task)
        known = (choice.policy, *list_policies(), SCRIPT, NO_POLICY)
        policies = dict.fromkeys(known)
        with gui.add_folder("What runs", expand_by_default=False):
            policy = gui.add_dropdown(
                "Policy", tuple(policies), initial_value=choice.policy
            )
            policy.on_update(self._chosen(lambda v: replace(session.choice, policy=v)))
            places = known_places(choice)
            place = gui.add_dropdown("Arm", places, initial_value=places[0])
            if len(places) > 1:
                act = self._chosen(lambda v: replace(session.choice, place=v))
                place.on_update(act)
            for name, known in words.items():
                now = str(settings[name])
                box = gui.add_dropdown(name, known, initial_value=now)
                box.on_update(self._chosen(self._setting(name)))
            change = self._setting("tare")
            Toggle(
                gui,
                "Tare at a reset",
                session.core.is_tared,
                act=lambda is_on: session.choose(change(is_on)),
            )

    def _setting(self, name: str) -> Callable[[Any], Any]:
        def change(value: Any) -> Any:
            choice = self._session.choice
            return replace(choice, settings={**choice.settings, name: value})

        return change

    def _add_display(self) -> None:
        gui = self._gui
        with gui.add_folder("Show", expand_by_default=False):
            self.walls = Toggle(gui, "Walls of the tool", True)
            self.near = Toggle(gui, "Plane near contact", False)
            self.path = Toggle(gui, "Path", True)
            self.forces = Toggle(gui, "Forces", True)

    def _chosen(self, change: Callable[[Any], Any]) -> Callable[[Any], None]:
        return lambda event: self._session.choose(change(event.target.value))

    def show(
        self,
        snapshot: Snapshot | None,
        status: LoopStatus,
        driver: int | None,
        viewers: int,
    ) -> None:
        """Show the status of the loop.

        Args:
            snapshot: The newest.
            status: Of the loop.
            driver: Number of the viewer who drives, if one does.
            viewers: Number of viewers, the driver included.
        """
        if self._mouse.is_on != self._session.teleoperator.has_mouse:
            self._mouse.show(self._session.teleoperator.has_mouse)  # there was none
        if self._resume.visible != status.is_stopped:
            self._resume.visible = status.is_stopped
        facts = [f"{100.0 * status.rate:.0f} % of its speed"]
        if snapshot is not None:
            depth = f"depth {1e3 * snapshot.depth:.1f} mm"
            facts = [f"{snapshot.stamp:.1f} s", depth, *facts]
        facts.append("no one drives" if driver is None else f"viewer {driver} drives")
        others = viewers - (driver is not None)
        facts.append(f"{others} watch" if others != 1 else "1 watches")
        facts += filter(None, [status.demonstrations])
        done = " &#10003;" if status.success else ""
        style = f"color:{_COLOURS.get(status.mode, '#444444')}"
        content = (
            "<div style='padding:0 .8em'>"
            f"<div style='font-size:1.35em;font-weight:700;{style}'>"
            f"{status.mode}{done}</div>"
            f"<div>{' &middot; '.join(facts)}</div>"
            f"<div><b>{html.escape(status.note)}</b></div></div>"
        )
        if content != self._status.content:
            self._status.content = content
