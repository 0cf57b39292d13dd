"""The controls beside the picture; those that are always in view are above them."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from dovetail.cockpit.choice import NOBODY, SCRIPT, known_places, known_words
from dovetail.cockpit.seat import Seat
from dovetail.cockpit.server import PageServer
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import Moment, Status
from dovetail.cockpit.toggle import Toggle
from dovetail.cockpit.top_panel import TopPanel
from dovetail.learn.policy import list_policies
from dovetail.settings import values_of


class ControlPanel:
    """Widgets whose callbacks tell the session what the driver wishes.

    The gate passes on input of the driver only.
    """

    def __init__(self, server: PageServer, session: Session, seat: Seat) -> None:
        """Add every widget.

        Args:
            server: The page's.
            session: What is driven.
            seat: Says who drives it.
        """
        self._gui, self._session = server.viser.gui, session
        self.top = TopPanel(server, session, seat)
        """Widgets that are always in view."""
        self._add_lead()
        if session.can_touch:
            self._add_touch()
        self._add_choice()
        self._add_display()

    def _add_lead(self) -> None:
        gui, session = self._gui, self._session
        shown: dict[str, Callable[[], None]] = {
            "Begin": session.demonstrate,
            "Keep": lambda: session.end_demonstration(is_kept=True),
            "Throw away": lambda: session.end_demonstration(is_kept=False),
        }
        with gui.add_folder("Lead"):
            self.leads = Toggle(gui, "Lead the tool", False, act=self._lead)
            has_mouse = session.guide.has_mouse
            self._mouse = Toggle(gui, "3D mouse", has_mouse, act=session.use_mouse)
            row = gui.add_button_group("Demonstration", tuple(shown))
            row.on_click(lambda event: shown[event.target.value]())

    def _lead(self, is_on: bool) -> None:
        if not is_on:
            self._session.guide.let_go()

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
        known = (choice.policy, *list_policies(), SCRIPT, NOBODY)
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

    def show(self, moment: Moment | None, status: Status, viewers: int) -> None:
        """Say what the loop is doing."""
        if self._mouse.is_on != self._session.guide.has_mouse:
            self._mouse.show(self._session.guide.has_mouse)  # there was none, say
        self.top.show(moment, status, viewers)
