"""How many lasting calls there is room for, so that a thread is left for short ones."""

import threading

from dovetail.errors import ArmError


class NoRoomError(ArmError):
    """All the room for lasting calls of one kind is taken."""


class Room:
    """Counts the calls of one kind that last; one more than the most is refused."""

    def __init__(self, most: int, are_there: str, advice: str) -> None:
        """Offer room for some calls.

        Args:
            most: How many may last at the same time; each needs a thread.
            are_there: What is said of them behind their number.
            advice: What to do when there is no room.
        """
        self.most = most
        self._are_there, self._advice = are_there, advice
        self._lock = threading.Lock()
        self._taken = 0

    @property
    def taken(self) -> int:
        """How many calls there are now."""
        return self._taken

    def __enter__(self) -> None:
        """Take room for one call.

        Raises:
            NoRoomError: There is none; says how many calls there are and what to do.
        """
        with self._lock:
            if self._taken >= self.most:
                raise NoRoomError(
                    f"{self._taken} {self._are_there}, the most at a time: "
                    f"{self._advice}"
                )
            self._taken += 1

    def __exit__(self, *error: object) -> None:
        """Give the room back."""
        with self._lock:
            self._taken -= 1
