"""The controls beside the picture: stop first, then everything else."""

import html
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dovetail.cockpit.choice import NOBODY, SCRIPT, known_places, known_words
from dovetail.cockpit.seat import Seat
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import Moment, Status
from dovetail.cockpit.toggle import Toggle
from dovetail.learn.policy import list_policies

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


class ControlPanel:
    """Widgets whose callbacks tell the session what a person wishes."""

    def __init__(
        self, server: "viser.ViserServer", session: Session, seat: Seat
    ) -> None:
        """Add every widget.

        Args:
            server: The page's.
            session: What is driven.
            seat: Who may drive it; a stop is everybody's.
        """
        self._server, self._session, self._seat = server, session, seat
        gui = server.gui
        stop = gui.add_button("STOP  (Esc)", color=_STOP_RED)
        stop.on_click(lambda _: session.stop())
        self._status = gui.add_html("")
        actions: dict[str, Callable[[], None]] = {
            "Start": session.start,
            "Pause": self._toggle_pause,
            "Step": session.step,
            "Reset": session.reset,
        }
        row = gui.add_button_group("", tuple(actions))
        row.on_click(self._driven(lambda event: actions[event.target.value]()))
        speed = gui.add_button_group("Speed", tuple(_SPEEDS))
        speed.on_click(self._driven(self._set_speed))
        self._add_keys(actions)
        self._add_lead()
        if session.can_touch:
            self._add_touch()
        self._add_choice()
        self._add_display()

    def _add_keys(self, actions: dict[str, Callable[[], None]]) -> None:
        gui = self._server.gui
        key = gui.add_command("Stop: hold the arm", hotkey="escape")
        key.on_trigger(lambda _: self._session.stop())
        for name, letter in zip(actions, ("G", "P", "N", "R"), strict=True):
            command = gui.add_command(name, hotkey=letter)
            command.on_trigger(self._driven(lambda _, name=name: actions[name]()))

    def _add_lead(self) -> None:
        gui, session = self._server.gui, self._session
        shown: dict[str, Callable[[], None]] = {
            "Begin": session.demonstrate,
            "Keep": lambda: session.end_demonstration(is_kept=True),
            "Throw away": lambda: session.end_demonstration(is_kept=False),
        }
        with gui.add_folder("Lead"):
            may = self.may_drive
            self.leads = Toggle(gui, "Lead the tool", False, may=may, act=self._lead)
            has_mouse = session.guide.has_mouse
            self._mouse = Toggle(
                gui, "3D mouse", has_mouse, may=may, act=session.use_mouse
            )
            row = gui.add_button_group("Demonstration", tuple(shown))
            row.on_click(self._driven(lambda event: shown[event.target.value]()))

    def _lead(self, is_on: bool) -> None:
        if not is_on:
            self._session.guide.let_go()

    @property
    def driver(self) -> int | None:
        """Number of the viewer who drives."""
        return self._seat.driver

    def _add_touch(self) -> None:
        gui, session = self._server.gui, self._session
        may = self.may_drive
        with gui.add_folder("Touch"):
            self.pulls = Toggle(gui, "Pull the arm", True, may=may)
            self.drags = Toggle(gui, "Drag the fixture", True, may=may)
            covered = session.is_covered
            Toggle(gui, "Cover the camera", covered, may=may, act=session.cover)

    def _add_choice(self) -> None:
        gui, session = self._server.gui, self._session
        choice = session.choice
        words = known_words(choice)
        settings = session.core.config.flat() | vars(session.core.task)
        known = (choice.policy, *list_policies(), SCRIPT, NOBODY)
        policies = dict.fromkeys(known)
        with gui.add_folder("What runs", expand_by_default=False):
            policy = gui.add_dropdown(
                "Policy", tuple(policies), initial_value=choice.policy
            )
            policy.on_update(self._chosen(lambda v: replace(session.choice, policy=v)))
            place = gui.add_dropdown(
                "Arm", known_places(choice), initial_value=choice.place
            )
            place.on_update(self._chosen(lambda v: replace(session.choice, place=v)))
            for name, known in words.items():
                now = str(settings[name])
                box = gui.add_dropdown(name, known, initial_value=now)
                box.on_update(self._chosen(self._setting(name)))
            change = self._setting("tare")
            Toggle(
                gui,
                "Tare at a reset",
                bool(settings["tare"]),
                may=self.may_drive,
                act=lambda is_on: session.choose(change(is_on)),
            )

    def _setting(self, name: str) -> Callable[[Any], Any]:
        def change(value: Any) -> Any:
            choice = self._session.choice
            return replace(choice, settings={**choice.settings, name: value})

        return change

    def _add_display(self) -> None:
        gui = self._server.gui
        with gui.add_folder("Show", expand_by_default=False):
            self.walls = Toggle(gui, "Walls of the tool", True)
            self.near = Toggle(gui, "Plane near contact", False)
            self.path = Toggle(gui, "Path", True)
            self.forces = Toggle(gui, "Forces", True)

    # -- callbacks ------------------------------------------------------------------

    def _driven(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback that acts for the driver alone, and tells others so."""

        def callback(event: Any) -> None:
            if event.client_id is None:  # the program's own doing
                return
            if self.may_drive(event.client_id):
                act(event)

        return callback

    def may_drive(self, viewer: int) -> bool:
        """Say whether a viewer drives, now at the latest; tell who may not."""
        is_standing = self._session.status.mode in ("held", "stopped")
        if self._seat.take(viewer, is_standing=is_standing):
            return True
        client = self._server.get_clients().get(viewer)
        if client is not None:
            client.add_notification(
                "You are watching",
                "Another viewer drives this arm. STOP works for everybody; the arm is "
                "free when that viewer closes the page, or does nothing for a minute "
                "while the arm stands.",
                auto_close_seconds=6.0,
            )
        return False

    def _chosen(self, change: Callable[[Any], Any]) -> Callable[[Any], None]:
        return self._driven(
            lambda event: self._session.choose(change(event.target.value))
        )

    def _toggle_pause(self) -> None:
        self._session.pause(self._session.status.mode != "paused")

    def _set_speed(self, event: Any) -> None:
        self._session.pace.speed = _SPEEDS[event.target.value]

    # -- shown ------------------------------------------------------------------------

    def show(self, moment: Moment | None, status: Status, viewers: int) -> None:
        """Say what the loop is doing."""
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
        if self._mouse.is_on != self._session.guide.has_mouse:
            self._mouse.show(self._session.guide.has_mouse)  # there was none, say
        lines.append(f"<div>{' &middot; '.join(facts)}</div>")
        if status.note:
            lines.append(f"<div><b>{html.escape(status.note)}</b></div>")
        content = "<div style='padding:0 .8em'>" + "".join(lines) + "</div>"
        if content != self._status.content:
            self._status.content = content
