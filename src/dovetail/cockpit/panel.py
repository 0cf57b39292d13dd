"""The controls beside the picture; those that are always in view are above them."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dovetail.cockpit.choice import NOBODY, SCRIPT, known_places, known_words
from dovetail.cockpit.seat import Seat
from dovetail.cockpit.session import Session
from dovetail.cockpit.snapshot import Moment, Status
from dovetail.cockpit.toggle import Toggle
from dovetail.cockpit.top_panel import TopPanel
from dovetail.learn.policy import list_policies

if TYPE_CHECKING:
    import viser


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
        self.top = TopPanel(server, session, seat, self._driven)
        """What is always in view."""
        self._add_lead()
        if session.can_touch:
            self._add_touch()
        self._add_choice()
        self._add_display()

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
                session.core.is_tared,
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

    # -- shown ------------------------------------------------------------------------

    def show(self, moment: Moment | None, status: Status, viewers: int) -> None:
        """Say what the loop is doing."""
        if self._mouse.is_on != self._session.guide.has_mouse:
            self._mouse.show(self._session.guide.has_mouse)  # there was none, say
        self.top.show(moment, status, viewers)
