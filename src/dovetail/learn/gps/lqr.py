"""Local controllers: linear-quadratic regulators that stay close to a policy.

All is in deviations dx, du from nominal trajectories, many of them at once. The dual
variable of the bound on the KL divergence is found for each by bisection.

Reference:
    Levine and Abbeel 2014, Learning neural network policies with guided policy search
    under unknown dynamics; Montgomery and Levine 2016, Guided policy search via
    approximate mirror descent.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[Any]

TEMPERATURES = (1e-6, 1e6)
"""Range in which the dual variable is looked for."""
_HALVINGS = 25


class Dynamics(NamedTuple):
    """Deviation of the next state: slope [dx, du] + offset, and noise."""

    slope: Floats
    """Shape (rollouts, steps, states, states + actions)."""
    offset: Floats
    """Shape (rollouts, steps, states)."""
    covariance: Floats
    """Of the noise, shape (rollouts, steps, states, states)."""


class Cost(NamedTuple):
    """Cost of a step: 1/2 z' curvature z + z' slope, with z = [dx, du]."""

    curvature: Floats
    """Shape (rollouts, steps, states + actions, states + actions)."""
    slope: Floats
    """Shape (rollouts, steps, states + actions)."""
    final_curvature: Floats
    """Of the state after the last step, shape (rollouts, states, states)."""
    final_slope: Floats
    """Shape (rollouts, states)."""


class Controller(NamedTuple):
    """Time-varying linear-Gaussian controller: du ~ N(gain dx + offset, covariance)."""

    gain: Floats
    """Shape (rollouts, steps, actions, states)."""
    offset: Floats
    """Shape (rollouts, steps, actions)."""
    covariance: Floats
    """Shape (rollouts, steps, actions, actions)."""


def solve(dynamics: Dynamics, cost: Cost) -> Controller:
    """Return the controllers of least cost minus entropy: Riccati, backward in time."""
    rollouts, steps, size = cost.slope.shape
    states = dynamics.offset.shape[-1]
    V, v = cost.final_curvature, cost.final_slope
    gain = np.empty((rollouts, steps, size - states, states))
    offset = np.empty((rollouts, steps, size - states))
    covariance = np.empty((rollouts, steps, size - states, size - states))
    for t in reversed(range(steps)):
        F = dynamics.slope[:, t]
        Q = cost.curvature[:, t] + _t(F) @ V @ F
        q = cost.slope[:, t] + _times(_t(F), v + _times(V, dynamics.offset[:, t]))
        Qux, qu = Q[:, states:, :states], q[:, states:]
        inverse = _symmetric(np.linalg.inv(Q[:, states:, states:]))
        covariance[:, t] = inverse
        gain[:, t], offset[:, t] = -inverse @ Qux, -_times(inverse, qu)
        V = _symmetric(Q[:, :states, :states] + _t(Qux) @ gain[:, t])
        v = q[:, :states] + _times(_t(Qux), offset[:, t])
    return Controller(gain, offset, covariance)


def divergence(
    controller: Controller, policy: Controller, dynamics: Dynamics
) -> Floats:
    """Return the KL divergence of each controller's trajectories from a policy's.

    Returns:
        Sum over the steps, at the states that the controller goes to [nat], shape
        (rollouts,).
    """
    rollouts, steps, _, states = controller.gain.shape
    mean, spread = np.zeros((rollouts, states)), np.zeros((rollouts, states, states))
    total = np.zeros(rollouts)
    precision = np.linalg.inv(policy.covariance)
    between = np.linalg.slogdet(policy.covariance)[1]
    between -= np.linalg.slogdet(controller.covariance)[1]
    for t in range(steps):
        K, S = controller.gain[:, t], controller.covariance[:, t]
        action = _times(K, mean) + controller.offset[:, t]
        other = K - policy.gain[:, t]
        apart = action - _times(policy.gain[:, t], mean) - policy.offset[:, t]
        scatter = S + other @ spread @ _t(other) + apart[:, :, None] * apart[:, None]
        trace = np.einsum("rij,rji->r", precision[:, t], scatter)
        total += (trace - S.shape[-1] + between[:, t]) / 2.0
        cross = K @ spread
        below = np.concatenate([cross, cross @ _t(K) + S], axis=2)
        joint = np.concatenate([np.concatenate([spread, _t(cross)], axis=2), below], 1)
        F = dynamics.slope[:, t]
        mean = _times(F, np.concatenate([mean, action], axis=1)) + dynamics.offset[:, t]
        spread = _symmetric(F @ joint @ _t(F) + dynamics.covariance[:, t])
    return total


def gaussian_divergence(apart: Floats, new: Floats, old: Floats) -> Floats:
    """Return the KL divergence of normal distributions from others.

    Args:
        apart: Differences of their means, shape (points, size).
        new: Covariance of the ones, shape (size, size).
        old: Covariance of those that they are measured by, shape (size, size).

    Returns:
        Divergence [nat], shape (points,).
    """
    precision = np.linalg.inv(old)
    between = np.linalg.slogdet(old)[1] - np.linalg.slogdet(new)[1]
    trace = np.trace(precision @ new) - len(old)
    far = np.einsum("pi,ij,pj->p", apart, precision, apart)
    return (trace + far + between) / 2.0


def improve(
    dynamics: Dynamics, cost: Cost, policy: Controller, bound: Floats
) -> Controller:
    """Return the controllers of least cost within a KL divergence from a policy.

    Args:
        dynamics: Fitted.
        cost: Quadratic expansion about the nominal trajectories.
        policy: Linearised there.
        bound: Largest divergence of each trajectory [nat], shape (rollouts,).
    """
    P = np.linalg.inv(policy.covariance)
    from_mean = np.concatenate(
        [-policy.gain, np.broadcast_to(np.eye(P.shape[-1]), P.shape)], axis=-1
    )
    curvature = _t(from_mean) @ P @ from_mean
    slope = -_times(_t(from_mean) @ P, policy.offset)

    def at(logarithm: Floats) -> Controller:
        share = np.exp(-logarithm)
        each = share[:, None, None]
        return solve(
            dynamics,
            Cost(
                cost.curvature * each[..., None] + curvature,
                cost.slope * each + slope,
                cost.final_curvature * each,
                cost.final_slope * share[:, None],
            ),
        )

    low, high = (np.full(len(bound), np.log(end)) for end in TEMPERATURES)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        is_far = ~(divergence(at(middle), policy, dynamics) <= bound)  # nan, too
        low, high = np.where(is_far, middle, low), np.where(is_far, high, middle)
    return at(high)


def _t(matrix: Floats) -> Floats:
    return np.swapaxes(matrix, -1, -2)


def _times(matrix: Floats, vector: Floats) -> Floats:
    return (matrix @ vector[..., None])[..., 0]


def _symmetric(matrix: Floats) -> Floats:
    return (matrix + _t(matrix)) / 2.0
