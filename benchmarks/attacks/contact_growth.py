"""What counts as an oscillation in a quiet section of a try.

What vibrates there at 8 Hz and more, nobody asked for: over windows of 0.25 s the RMS
of the joint velocities above 8 Hz grows where it rises three times running by a fifth
or more, ends above 0.1 rad/s, and lasts; it is sustained above 0.3 rad/s in four
windows running. What a stop shakes is no oscillation: a motion that the last line ended
as too fast, or for its limiters' work, had one only if something vibrated before.
"""

import numpy as np

from .contact_choices import Array

WINDOW = 5  # actions
GROWTH, GROWN, SUSTAINED = 1.2, 0.1, 0.3  # 1, rad/s, rad/s


def rms(vibration: Array) -> Array:
    """Return the RMS [rad/s] over windows of what vibrated per action."""
    return np.sqrt((vibration.reshape(-1, WINDOW) ** 2).mean(axis=1))


def oscillation(quiet: Array) -> tuple[float, float]:
    """Return the RMS [rad/s] of what grew in a quiet section, and of what stayed."""
    windows = rms(quiet)[1:]  # the first follows a new Target
    grows = (windows[1:] > GROWTH * windows[:-1]).all() and windows[-1] > GROWN
    return float(windows[-1]) if grows else 0.0, float(windows.min())


def lasts(grown: float, after: Array, before_end: Array | None, cause: str) -> bool:
    """Return whether what grew in a quiet section was an oscillation.

    Args:
        grown: Its RMS at the end of the section [rad/s].
        after: What vibrated per action in the second after the section [rad/s].
        before_end: The same before the last line ended the motion, or in the section if
            it had ended before; None where it did not.
        cause: What the last line saw.
    """
    if np.median(rms(after)) >= grown:
        return True
    if before_end is None:
        return False
    return cause == "oscillation" or bool((before_end > GROWN).any())
