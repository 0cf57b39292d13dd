r"""Cost of the local controllers: distance to the goal, smooth, and small actions.

.. math:: \sum_i w_i (\sqrt{x_i^2 + s_i^2} - s_i) + \frac{\rho}{2} |u|^2

It is expanded by the parabola that touches it from above and has its lowest point at
the goal, as iteratively reweighted least squares does: millimetres count near the goal,
as in the logarithm of Levine et al. 2016, and a step never overshoots.

Reference:
    Levine, Finn, Darrell, Abbeel 2016, End-to-end training of deep visuomotor policies.
"""

from collections.abc import Mapping

import numpy as np

from dovetail.learn.gps.lqr import Cost, Floats

WEIGHTS: Mapping[str, tuple[float, float]] = {
    "position": (1.0, 0.0002),
    "theta": (0.1, 0.01),
    "tilt": (0.1, 0.01),
}
"""Weight [1/m, 1/rad] and smoothing [m, rad] of each column of a group."""
ACTION = 2e-4
"""Cost of an action, rho [1]."""
FINAL = 20.0
"""Steps that the last state counts for: it is to last [1]."""


def expand(
    x: Floats, u: Floats, weight: Floats, smooth: Floats, is_step: Floats
) -> Cost:
    """Return the cost about nominal trajectories.

    Args:
        x: States, shape (rollouts, steps + 1, states).
        u: Actions, shape (rollouts, steps, actions).
        weight: Of each state's distance from 0, shape (states,).
        smooth: Distance below which it is a parabola, shape (states,).
        is_step: 1 for a step that was made, 0 after the end, shape (rollouts, steps).
    """
    states, actions = x.shape[-1], u.shape[-1]
    bend = weight / np.sqrt(x**2 + smooth**2)
    diagonal = np.concatenate([bend[:, :-1], np.full(u.shape, ACTION)], axis=2)
    gradient = np.concatenate([bend[:, :-1] * x[:, :-1], ACTION * u], axis=2)
    diagonal, gradient = diagonal * is_step[..., None], gradient * is_step[..., None]
    final = FINAL * bend[:, -1]
    return Cost(
        diagonal[..., None] * np.eye(states + actions),
        gradient,
        final[..., None] * np.eye(states),
        final * x[:, -1],
    )
