"""A switch of the page that is a button: after a checkbox, keys would do nothing.

The browser keeps keys for a field that was clicked last, and Escape must stop the arm.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import viser


class Toggle:
    """Says whether it is on; each click turns it."""

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
            label: What it switches.
            is_on: At first.
            act: Called with the new state.
        """
        self._label, self._act = label, act
        self.is_on = is_on
        self._button: Any = gui.add_button(label)
        self._button.on_click(self._turn)
        self._show()

    def _turn(self, _: Any) -> None:
        self.is_on = not self.is_on
        self._show()
        self._act(self.is_on)

    def show(self, is_on: bool) -> None:
        """Show that it is on, or off, without acting."""
        self.is_on = is_on
        self._show()

    def _show(self) -> None:
        self._button.label = f"{self._label}: {'on' if self.is_on else 'off'}"
        self._button.color = "teal" if self.is_on else "gray"
