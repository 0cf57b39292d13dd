"""Comparison of two robots: of both ends of a wire, and of a policy's two places."""

import numpy as np

from dovetail.robots.robot import Robot

_RELATIVE, _ABSOLUTE = 1e-6, 1e-9
"""Differences of numbers that two machines may compute."""


def difference(here: Robot, there: Robot) -> str:
    """Say in which of their arrays two robots differ, with an example of both values.

    Names, postures, dry friction and drawings are not compared.

    Args:
        here: This program's.
        there: The other end's.

    Returns:
        A sentence without a full stop; empty where they are the same.
    """
    ours, theirs = here.arrays(), there.arrays()
    apart = {
        name: ~np.isclose(ours[name], theirs[name], rtol=_RELATIVE, atol=_ABSOLUTE)
        for name in ours
    }
    names = [name for name, is_other in apart.items() if is_other.any()]
    if not names:
        return ""
    first = names[0]
    index = tuple(int(i) for i in np.argwhere(apart[first])[0])
    return (
        f"{', '.join(names)} differ, for example {first}{list(index)} is "
        f"{theirs[first][index]:.6g} there and {ours[first][index]:.6g} here"
    )
