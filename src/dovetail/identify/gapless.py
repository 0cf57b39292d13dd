"""Play a motion again until its log has every control cycle."""

from collections.abc import Callable
from typing import TypeVar

from dovetail.errors import ArmError
from dovetail.identify.log_checks import find_gaps
from dovetail.types import Array

TRIES = 5
"""Times that a motion is played at most."""

Played = TypeVar("Played")


def play_gapless(
    play: Callable[[], Played],
    times: Callable[[Played], list[Array]],
    period: float,
    what: str,
) -> Played:
    """Play a motion until no cycle is missing, and return what came of it.

    Args:
        play: Plays it once.
        times: Returns the times of its cycles [s], an array for each unbroken log.
        period: Control period [s].
        what: Name of the motion in the message.

    Raises:
        ArmError: Cycles were missing each time.
    """
    missing = 0
    for _ in range(TRIES):
        played = play()
        missing = sum(int(find_gaps(one, period).sum()) for one in times(played))
        if not missing:
            return played
    raise ArmError(
        f"{what} was played {TRIES} times, and cycles were missing each time, in the "
        f"last one at {missing} places: a fit needs every cycle. Mend the connection "
        "(dovetail doctor counts), end what else runs on this machine, then record on "
        "with the same command",
        "gaps",
    )
